"""Whether measurements agree by more than chance.

A mode with most of the measurements is a value, as in all robust statistics, unless its support
goes around a compact manifold. Others are put to an a-contrario test: among measurements that lie
about evenly, some always happen to be near each other. A mode with k measurements in an ellipsoid
is meaningful if the expected number of ellipsoids with as many, were those in some larger,
concentric one spread evenly over it, is below one. There are as many tests as elemental subsets,
and numbers of measurements, and volumes.

References
----------
Desolneux, Moisan and Morel, From Gestalt theory to image analysis, 2008.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.meanshift.trajectories import Mask
from mssegment.records import Floats
from mssegment.special import binomial_log_tail

MAX_LOG_NFA = math.log(0.01)
"""Largest logarithm of the expected number of false alarms: one in a hundred sets of data."""
MAX_VOLUMES = 60
"""Concentric ellipsoids, each with twice the volume of the last, as far as there are others."""
LOG_2 = math.log(2.0)
RANDOM_POINTS = 200
"""Points that tell how far a compact manifold extends."""


def is_meaningful(
    manifold: Manifold,
    mean: Floats,
    radii: Floats,
    lengths: Floats,
    support: Mask,
    weights: Floats,
    rng: np.random.Generator,
) -> bool:
    """Whether a mode is a value.

    Parameters
    ----------
    manifold
        The manifold, of dimension d.
    mean
        The mode.
    radii
        The Mahalanobis distance of the measurements [n] from it.
    lengths
        Their distances [n]; infinite where the mode has no logarithm.
    support
        Whether each is of the support [n].
    weights
        How often each counts [n].
    rng
        Draws the points that tell how far a compact manifold extends.
    """
    if not support.any():
        return False
    reach = float(lengths[support].max())
    farthest = _farthest(manifold, mean, rng) if manifold.is_compact else math.inf
    if 2.0 * weights[support].sum() > weights.sum() and 2.0 * reach <= farthest:
        return True
    if not manifold.is_compact:
        farthest = float(lengths[np.isfinite(lengths)].max())
    wider = farthest / reach if reach > 0 else math.inf
    d = manifold.dim
    # an ellipsoid, which d + 1 measurements make, or a ball, which two make
    shapes = ((radii, d + 1), (lengths, 2))
    found = [log_nfa(each, support, weights, size, d, wider) for each, size in shapes]
    return math.log(len(shapes)) + min(found) < MAX_LOG_NFA


def _farthest(manifold: Manifold, mean: Floats, rng: np.random.Generator) -> float:
    """The distance of points of a compact manifold that are far from ``mean``."""
    others = manifold.random_point(rng, RANDOM_POINTS)
    away = manifold.norm(mean, manifold.log(np.broadcast_to(mean, others.shape), others))
    return float(away[np.isfinite(away)].max(initial=0.0))


def log_nfa(
    distances: Floats, support: Mask, weights: Floats, size: int, d: int, wider: float
) -> float:
    """Log of the expected number of false alarms for one shape, made by ``size`` measurements.

    It is compared with shapes that are up to ``wider`` times as wide; the ``distances`` [n] are 1
    where the shape ends, or any multiple of it.
    """
    radius = float(distances[support].max())
    inside, total = float(weights[distances <= radius].sum()), float(weights.sum())
    volumes = MAX_VOLUMES
    if math.isfinite(wider):
        volumes = min(volumes, int(d * math.log2(wider)))
    if inside <= size or volumes < 1:
        return math.inf
    doubled = np.arange(1, volumes + 1)
    limits = radius * 2.0 ** (doubled / d)
    within = np.array([float(weights[distances <= limit].sum()) for limit in limits])
    tails = [
        float(binomial_log_tail(np.array([inside - size]), n - size, np.array([-k * LOG_2]))[0])
        for n, k in zip(within.tolist(), doubled.tolist(), strict=True)
    ]
    subsets = math.lgamma(total + 1) - math.lgamma(size + 1) - math.lgamma(total - size + 1)
    return subsets + math.log(total * volumes) + min(tails)
