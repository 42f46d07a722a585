"""The bandwidth by a nearest neighbour rule, as the paper chooses it (section 5.1)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Manifold, PreparedPoints
from mssegment.records import Floats
from mssegment.special import median

SAMPLE_SIZE = 256
"""Points whose neighbour distances are computed: their median hardly changes with more."""
ROUNDING = 1e-13
"""Squared distances below this are rounding errors of equal points."""


def nearest_neighbour_bandwidth(
    manifold: Manifold,
    points: Floats,
    rng: np.random.Generator,
    constant: float = 0.5,
    fraction: float = 0.05,
) -> float:
    """The bandwidth h = ``constant`` x the median distance to a near neighbour.

    Parameters
    ----------
    manifold
        The manifold, whose distance is used.
    points
        The data points [n, ...].
    rng
        Draws the sample of 256 points over which the median is taken.
    constant
        The factor.
    fraction
        The neighbour is the (``fraction`` n)-th nearest other point, at least the first.

    Returns
    -------
    float
        h, in the manifold's distance; always positive. Where more than half of the points coincide
        with that many others, half the smallest positive distance replaces the median, or 1 where
        all points are equal. Fewer than two points give h = 1.

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.manifolds import Euclidean
    >>> points = np.arange(10.0)[:, None]
    >>> nearest_neighbour_bandwidth(Euclidean(1), points, np.random.default_rng(0))
    0.5
    """
    n = len(points)
    if n < 2:
        return 1.0
    sample = points if n <= SAMPLE_SIZE else points[rng.choice(n, SAMPLE_SIZE, replace=False)]
    neighbour = min(max(1, round(fraction * n)), n - 1)
    prepared = manifold.prepare(points)
    starts = range(0, len(sample), prepared.block_rows)
    blocks = [sample[start : start + prepared.block_rows] for start in starts]
    nearest = np.concatenate([prepared.nearest(block, neighbour)[:, -1] for block in blocks])
    finite = nearest[np.isfinite(nearest)]
    distance = median(np.sqrt(np.maximum(finite, 0.0))) if finite.size else 0.0
    if distance <= np.sqrt(ROUNDING):
        distance = 0.5 * _smallest_distance(prepared, blocks)
    return constant * distance


def _smallest_distance(prepared: PreparedPoints, blocks: list[Floats]) -> float:
    """The smallest positive distance from a point in ``blocks``, 2 where there is none."""
    smallest = np.inf
    for block in blocks:
        z = prepared.block(block).scaled_sq_dist
        smallest = min(smallest, float(z.min(initial=np.inf, where=z > ROUNDING)))
    return float(np.sqrt(smallest)) if np.isfinite(smallest) else 2.0
