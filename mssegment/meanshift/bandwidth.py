"""The bandwidth by nearest neighbour rules: that of the paper (section 5.1), and ``auto``."""

from __future__ import annotations

import math

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.records import Floats
from mssegment.special import chi_square_quantile, median, quantile

SAMPLE_SIZE = 256
"""Points whose neighbour distances are computed: their quantiles hardly change with more."""
COARSE = 1e-13
"""Squared distances below this, in the unit of the data, may be rounding errors of the fast
computation, and are computed again one by one."""
ROUNDING = 8.0
"""Distances below this many times the largest distance of a point from itself are rounding errors
of equal points."""
HYPOTHESES_ROUNDING, POINTS_ROUNDING = 3e-7, 1e-13
"""Distances below these shares of a typical one are rounding errors: of hypotheses, which fits to
noise-free tracks compute with a loss of digits, and of points as they are given."""
SMALL_CHANGE = 2.0**-26
"""A relative change of which the square is a rounding error."""
COINCIDENT = 0.25
"""Where most points coincide, h is this share of the smallest distance, at which two equal heaps of
points are two modes (they are up to h = half their distance)."""
AUTO_FRACTION, AUTO_SHARE = 0.1, 0.25
"""The rule ``auto``: the lower quartile of the distances to the 0.1 n-th neighbour. A quartile, as
the densest quarter of the points is in clusters even where most are outliers; a tenth, since a
cluster has more points than that."""
CLUSTER_SHARE = 1.0 / 3.0
"""The share of the points that a cluster is taken to have, to tell its standard deviation from that
distance, and how many points it has."""
OVER_REFERENCE = 5.0 / 3.0
"""``auto`` over the bandwidth that is best for the gradient of a normal density: with that one, a
cluster has some modes of single points far from its centre."""
AUTO_SAMPLE = 2048
"""Points over which that quartile is taken; up to as many, it does not depend on their order."""


def nearest_neighbour_bandwidth(
    manifold: Manifold,
    points: Floats,
    rng: np.random.Generator,
    constant: float = 0.5,
    fraction: float = 0.05,
    share: float = 0.5,
    sample_size: int = SAMPLE_SIZE,
    rounding: float = HYPOTHESES_ROUNDING,
) -> float:
    """The bandwidth h = ``constant`` x a quantile of the distances to a near neighbour.

    Parameters
    ----------
    manifold
        The manifold, whose distance is used.
    points
        The data points [n, ...].
    rng
        Draws the sample of the points over which the quantile is taken.
    constant
        The factor.
    fraction
        The neighbour is the (``fraction`` n)-th nearest other point, at least the first.
    share
        The quantile: 0.5 is the median.
    sample_size
        The number of points in that sample.
    rounding
        Distances below this share of a typical one are rounding errors of equal points.

    Returns
    -------
    float
        h, in the manifold's distance; always positive. Where more than ``share`` of the points
        coincide with that many others, h is a quarter of the smallest positive distance, or 1 where
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
    sample = points if n <= sample_size else points[rng.choice(n, sample_size, replace=False)]
    neighbour = min(max(1, round(fraction * n)), n - 1)
    noise = ROUNDING * float(manifold.dist(sample, sample).max(initial=0.0))
    noise = max(noise, rounding * _relative_distance(manifold, sample))
    unit = _unit_of_distance(manifold, sample, noise)
    prepared = manifold.prepare(points, unit)
    starts = range(0, len(sample), prepared.block_rows)
    nearest = np.concatenate(
        [
            prepared.nearest(sample[start : start + prepared.block_rows], neighbour)[:, -1]
            for start in starts
        ]
    )
    scaled = _quantile(np.maximum(nearest, 0.0), share)
    noise = max(noise, rounding * unit)
    if scaled <= max(np.sqrt(COARSE), noise / unit):
        found, smallest = _one_by_one(manifold, points, sample, neighbour, share, noise)
        return constant * found if found > noise else COINCIDENT * smallest
    return constant * scaled * unit


def _relative_distance(manifold: Manifold, sample: Floats) -> float:
    """How far a change of the entries moves a point, per relative change: its size in distances.

    Where all points are equal, their distances are rounding errors and cannot be their own measure.
    """
    # an irregular change: a regular one may be a direction that the manifold does not have
    change = np.cos(np.arange(sample[0].size) ** 2.0).reshape(sample.shape[1:])
    moved = manifold.dist(sample, sample * (1.0 + SMALL_CHANGE * change))
    finite = moved[np.isfinite(moved)]
    return median(finite) / SMALL_CHANGE if finite.size else 0.0


def _unit_of_distance(manifold: Manifold, sample: Floats, noise: float) -> float:
    """A power of two of the size of the distances in ``sample``; 1 where all points are equal.

    In this unit the computation is the same to the last bit whatever the scale of the data.
    """
    apart = manifold.dist(sample, np.roll(sample, len(sample) // 2, axis=0))
    positive = apart[np.isfinite(apart) & (apart > noise)]
    return float(2.0 ** np.round(np.log2(median(positive)))) if positive.size else 1.0


def _quantile(squares: Floats, share: float) -> float:
    """The quantile of the square roots of what is finite, 0 where nothing is."""
    roots = np.sqrt(squares[np.isfinite(squares)])
    if not roots.size:
        return 0.0
    return median(roots) if share == 0.5 else float(quantile(roots, share))


def _one_by_one(
    manifold: Manifold, points: Floats, sample: Floats, neighbour: int, share: float, noise: float
) -> tuple[float, float]:
    """The quantile from ``Manifold.dist``; the smallest distance above ``noise``, 4 if none is."""
    nearest, smallest = [], np.inf
    for point in sample:
        distances = manifold.dist(np.broadcast_to(point, points.shape), points)
        nearest.append(np.partition(distances, neighbour)[neighbour])
        smallest = min(smallest, distances.min(initial=np.inf, where=distances > noise))
    ordered = np.sort([distance for distance in nearest if np.isfinite(distance)])
    found = float(ordered[int(share * (len(ordered) - 1))]) if len(ordered) else 0.0
    return found, float(smallest) if np.isfinite(smallest) else 1.0 / COINCIDENT


def auto_bandwidth(
    manifold: Manifold,
    points: Floats,
    rng: np.random.Generator,
    weights: Floats | None = None,
    share: float = AUTO_SHARE,
) -> float:
    """The bandwidth of ``MeanShift(bandwidth="auto")``.

    Parameters
    ----------
    manifold
        The manifold, whose distance is used.
    points
        The data points [n, ...].
    rng
        Draws 2048 of them where there are more.
    weights
        The weights of the points [n]: how often each counts.
    share
        The quantile of the neighbour distances: clusters have at least so many of the points.

    Returns
    -------
    float
        h: from that quantile, over the points, of the distance to the 0.1 n-th neighbour, the
        standard deviation of a normal cluster with a third of the points; 5/3 of the bandwidth
        that estimates the gradient of its density best. Where most points coincide, as for
        ``nearest_neighbour_bandwidth``.

    References
    ----------
    J. E. Chacon, T. Duong and M. P. Wand, "Asymptotics for general multivariate kernel density
    derivative estimators", Statistica Sinica 21, 2011.
    """
    if weights is None:
        return nearest_neighbour_bandwidth(
            manifold,
            points,
            rng,
            _over_neighbour_distance(manifold.dim, len(points)),
            AUTO_FRACTION,
            share,
            AUTO_SAMPLE,
            POINTS_ROUNDING,
        )
    counts = weights if np.all(weights == np.round(weights)) else weights / weights.mean()
    distances = neighbour_distances(manifold, points, AUTO_FRACTION, counts)
    found = _weighted_quantile(distances, counts, share)
    if found > 0:
        return _over_neighbour_distance(manifold.dim, float(counts.sum())) * found
    sample = points[:: -(-len(points) // SAMPLE_SIZE)]
    noise = ROUNDING * float(manifold.dist(sample, sample).max(initial=0.0))
    noise = max(noise, POINTS_ROUNDING * _unit_of_distance(manifold, sample, noise))
    return COINCIDENT * _one_by_one(manifold, points, sample, 0, share, noise)[1]


def _over_neighbour_distance(dim: int, count: float) -> float:
    """The rule ``auto`` over the distance to the 0.1 n-th neighbour, for ``count`` points.

    That distance, near the centre of a normal cluster, is a quantile of a chi distribution, in
    standard deviations: 0.39 in one dimension, 2.0 in six.
    """
    radius = math.sqrt(chi_square_quantile(dim, AUTO_FRACTION / CLUSTER_SHARE))
    return _over_deviation(dim, count) / radius


def _over_deviation(dim: int, count: float) -> float:
    """The rule ``auto`` over the standard deviation of a cluster, for ``count`` points in all.

    The bandwidth that estimates the gradient of a normal density best, and with it the mode, is
    (4 / (d + 4))^(1 / (d + 6)) n^(-1 / (d + 6)) standard deviations.
    """
    own = max(CLUSTER_SHARE * count, 1.0)
    return float(OVER_REFERENCE * (4.0 / ((dim + 4) * own)) ** (1.0 / (dim + 6)))


def widest_deviation(bandwidth: float, dim: int, count: float) -> float:
    """The standard deviation of a cluster with all of ``count`` points that has this bandwidth.

    The rule ``auto`` takes it to have a third of them, and so to be less wide.
    """
    wider = chi_square_quantile(dim, AUTO_FRACTION / CLUSTER_SHARE) / chi_square_quantile(
        dim, AUTO_FRACTION
    )
    return math.sqrt(wider) * bandwidth / _over_deviation(dim, count)


def neighbour_distances(
    manifold: Manifold, points: Floats, fraction: float, counts: Floats | None = None
) -> Floats:
    """The distance [n] of each point to its (``fraction`` n)-th neighbour, at least the first.

    With ``counts`` [n] each point stands for so many equal ones.
    """
    n = len(points)
    counts = np.ones(n) if counts is None else counts
    neighbour = max(1, round(fraction * float(counts.sum())))
    sample = points[:: -(-n // SAMPLE_SIZE)]
    noise = ROUNDING * float(manifold.dist(sample, sample).max(initial=0.0))
    unit = _unit_of_distance(manifold, sample, noise)
    prepared = manifold.prepare(points, unit)
    out = np.empty(n)
    for start in range(0, n, prepared.block_rows):
        z = prepared.block(points[start : start + prepared.block_rows]).scaled_sq_dist
        order = np.argsort(z, axis=1)
        reached = np.cumsum(counts[order], axis=1) > neighbour
        place = np.where(reached.any(axis=1), reached.argmax(axis=1), n - 1)
        rows = np.arange(len(z))
        out[start : start + len(z)] = z[rows, order[rows, place]]
    distances = unit * np.sqrt(np.maximum(out, 0.0))
    return np.where(distances > max(noise, unit * np.sqrt(COARSE)), distances, 0.0)


def _weighted_quantile(values: Floats, counts: Floats, share: float) -> float:
    """The quantile of ``values``, each taken as often as its count says."""
    order = np.argsort(values)
    ordered, reached = values[order], np.cumsum(counts[order])
    place = share * (reached[-1] - 1)
    last = len(values) - 1
    low, high = (
        ordered[min(int(np.searchsorted(reached, index, side="right")), last)]
        for index in (np.floor(place), np.floor(place) + 1)
    )
    return float(low + (high - low) * (place - np.floor(place)))
