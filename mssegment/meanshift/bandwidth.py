"""The bandwidth by a nearest neighbour procedure, as the paper chooses it (section 5.1)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Array, Cloud, Manifold
from mssegment.records import Floats

FIRST = 32
"""Rows at a time; the first of them say how far the others need to look."""
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
    everything = manifold.cloud(points)
    cloud, nearest, closest = everything, [], np.inf
    rows = min(FIRST, cloud.rows)
    for start in range(0, len(sample), rows):
        some = sample[start : start + rows]
        found, z = _found(cloud, some, neighbour)
        if not np.isfinite(found).all():
            found, z = _found(everything, some, neighbour)
        nearest.append(found)
        closest = min(closest, float(z.min(initial=np.inf, where=z > _ROUNDING)))
        if cloud.selective and start == 0 and np.isfinite(found).all() and found.max() > 0:
            cloud = manifold.cloud(points, reach=1.5 * float(np.sqrt(found.max())))
    distances = np.sqrt(np.concatenate(nearest))
    finite = distances[np.isfinite(distances)]
    median = float(np.median(finite)) if finite.size else 0.0
    if median <= np.sqrt(_ROUNDING):
        median = 0.5 * float(np.sqrt(closest)) if np.isfinite(closest) else 1.0
    return constant * median


def _found(cloud: Cloud, rows: Floats, neighbour: int) -> tuple[Floats, Array]:
    """The squared distance of each of the ``rows`` to its ``neighbour``, and all of them."""
    z = cloud.seen_from(rows).z
    z.partition(neighbour, axis=1)
    return np.maximum(z[:, neighbour], 0.0), z


_ROUNDING = 1e-13
"""Squared distances below this are rounding errors of equal points."""
