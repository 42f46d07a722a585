"""The bandwidth by a nearest neighbour procedure, as the paper chooses it (section 5.1)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Manifold, PreparedPoints
from mssegment.records import Floats
from mssegment.special import median

SAMPLE = 256
"""Rows whose neighbour distances are looked at: their median hardly changes with more."""


def nearest_neighbour_bandwidth(
    manifold: Manifold,
    points: Floats,
    rng: np.random.Generator,
    constant: float = 0.5,
    fraction: float = 0.05,
) -> float:
    """h = ``constant`` x the median distance to the (``fraction`` n)-th nearest neighbour.

    The median is over a sample of 256 of the ``points`` [n, ...]; a point is not its own
    neighbour. Where more than half of the points coincide with so many others, half the
    smallest positive distance takes the median's place, and 1 where all points are equal.
    """
    n = len(points)
    if n < 2:
        return 1.0
    sample = points if n <= SAMPLE else points[rng.choice(n, SAMPLE, replace=False)]
    neighbour = min(max(1, round(fraction * n)), n - 1)
    prepared = manifold.prepare(points)
    blocks = [
        sample[start : start + prepared.rows] for start in range(0, len(sample), prepared.rows)
    ]
    nearest = np.concatenate([prepared.nearest(block, neighbour)[:, -1] for block in blocks])
    finite = nearest[np.isfinite(nearest)]
    usual = median(np.sqrt(np.maximum(finite, 0.0))) if finite.size else 0.0
    if usual <= np.sqrt(_ROUNDING):
        usual = 0.5 * _closest(prepared, blocks)
    return constant * usual


def _closest(prepared: PreparedPoints, blocks: list[Floats]) -> float:
    """The smallest positive distance of one of the ``blocks``, 2 where there is none."""
    closest = np.inf
    for block in blocks:
        z = prepared.block(block).scaled_sq_dist
        closest = min(closest, float(z.min(initial=np.inf, where=z > _ROUNDING)))
    return float(np.sqrt(closest)) if np.isfinite(closest) else 2.0


_ROUNDING = 1e-13
"""Squared distances below this are rounding errors of equal points."""
