"""Robust fusion of repeated measurements on a manifold (section 5.5 of the paper).

Measurements of a few true values, many of them wrong: the modes of their density are the values,
and the measurements near a mode, its support, give a mean and a covariance in the tangent space.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.blas import with_one_thread
from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import Manifold, MatrixGroup
from mssegment.meanshift.bandwidth import (
    AUTO_FRACTION,
    auto_bandwidth,
    neighbour_distances,
    widest_deviation,
)
from mssegment.meanshift.estimator import MeanShift
from mssegment.meanshift.significance import is_meaningful
from mssegment.meanshift.validation import (
    InvalidPoints,
    generator,
    numbers,
    positive_number,
    shown,
)
from mssegment.records import Floats, Integers, Record
from mssegment.special import chi_square_quantile, quantile

MAX_CORRECTION = 0.05
"""The largest ``constraint_violation`` that projection corrects: a rotation written with two
decimals has 0.02. More is no rounding, but another convention of the numbers."""
SUPPORT = 0.99
"""The share of the measurements of a value, if they are normal, in whose ellipsoid others are
counted."""
MAX_ROUNDS, SAME_LIKELY = 100, 1e-3
"""Rounds of expectation and maximization, which end when no probability changes by more."""
DENSEST = 0.1
"""Values have at least this share of the measurements: the bandwidth is that of the densest tenth,
where most measurements are wrong."""
MIN_SHARE = 0.05
"""A mode with less support than this share of the measurements is not reported by default."""


class FusedMode(Record, frozen=True):
    """One value that measurements agree on.

    Attributes
    ----------
    point
        The mean of the support, a point [*point_shape].
    density
        The kernel density at the mode of mean shift that it started from.
    support
        The indices of the measurements that agree with it.
    weight
        The sum of their weights; their number without weights.
    covariance
        Of one measurement, in the coordinates of ``Manifold.tangent_basis`` [d, d]. That of the
        mean is this over ``weight``.
    """

    point: Floats
    density: float
    support: Integers
    weight: float
    covariance: Floats


class Fusion(Record, frozen=True):
    """The result of :func:`fuse`.

    Attributes
    ----------
    manifold
        The manifold, with the length scale that was used.
    modes
        The values, those with most support first; none where no measurements agree by more than
        chance.
    labels
        The mode of each measurement [n], -1 for none.
    bandwidth
        h.
    corrected
        The largest ``constraint_violation`` of a measurement, which was projected.
    """

    manifold: Manifold
    modes: tuple[FusedMode, ...]
    labels: Integers
    bandwidth: float
    corrected: float


@with_one_thread
def fuse(
    X: npt.ArrayLike,
    manifold: Manifold | str,
    sample_weight: Any = None,
    *,
    bandwidth: float | str = "auto",
    length_scale: float | str = "auto",
    min_share: float = MIN_SHARE,
    random_state: Any = None,
) -> Fusion:
    """The values that measurements agree on, with support and covariance.

    Parameters
    ----------
    X
        Measurements [n, *point_shape], or with all entries of one in a row. Small errors, such as
        those of numbers with four decimals, are corrected by projection.
    manifold
        A manifold or its name, such as ``"se3"``.
    sample_weight
        Nonnegative weights of the measurements [n].
    bandwidth
        h, in the manifold's distance, or ``"auto"``: right where a tenth of the measurements agree.
    length_scale
        For rigid motions named without one: the length that weighs as much as a radian. ``"auto"``
        is the ratio of the spreads of translations and rotations, so that the unit does not matter.
    min_share
        Modes with less support than this share of the weights are left out.
    random_state
        Seed or generator.

    Returns
    -------
    Fusion

    Raises
    ------
    DataError
        For measurements that are not near the manifold.
    ConfigurationError
        For an unknown manifold, or parameters that are none.

    Examples
    --------
    >>> import numpy as np
    >>> angles = np.array([0.50, 0.51, 0.49, 0.50, 2.0, -1.0])
    >>> c, s = np.cos(angles), np.sin(angles)
    >>> turns = np.stack([c, -s, s, c], axis=1).round(4).reshape(-1, 2, 2)
    >>> found = fuse(turns, "so2", bandwidth=0.05, min_share=0.5)
    >>> found.modes[0].support.tolist()
    [0, 1, 2, 3]
    """
    _check_parameters(bandwidth, length_scale, min_share)
    raw = numbers(X)
    estimator = MeanShift(manifold, bandwidth, random_state=random_state, min_count=1)
    space = estimator._manifold_of(raw)
    if len(raw) == 0:
        raise InvalidPoints("there are no measurements: at least 1 is needed")
    points, corrected = project_measurements(space, raw)
    if length_scale == "auto":
        space = with_length_scale(space, points) if isinstance(manifold, str) else space
    elif isinstance(space, MatrixGroup):
        space = space.with_length_scale(float(length_scale))
    weights = estimator._weights(sample_weight, len(points))
    rng = generator(random_state)
    if isinstance(bandwidth, str):
        bandwidth = auto_bandwidth(space, points, rng, weights, DENSEST)
    estimator.set_params(manifold=space, bandwidth=bandwidth)
    estimator.fit(points, sample_weight=sample_weight)
    every = np.ones(len(points)) if weights is None else weights
    modes = _values(space, points, every, estimator, min_share, rng)
    labels = np.full(len(points), -1, dtype=np.int64)
    for i, mode in reversed(list(enumerate(modes))):
        labels[mode.support] = i
    return Fusion(space, modes, labels, float(bandwidth), corrected)


def _check_parameters(bandwidth: Any, length_scale: Any, min_share: Any) -> None:
    for name, value in (("bandwidth", bandwidth), ("length_scale", length_scale)):
        if not (isinstance(value, str) and value == "auto") and not positive_number(value):
            raise ConfigurationError(
                f"{name} must be 'auto' or a positive number, found {shown(value)}"
            )
    share = min_share if isinstance(min_share, (int, float, np.floating)) else -1.0
    if isinstance(min_share, bool) or not 0.0 <= share <= 1.0:
        raise ConfigurationError(
            f"min_share must be a number from 0 to 1, found {shown(min_share)}"
        )


def project_measurements(manifold: Manifold, raw: Floats) -> tuple[Floats, float]:
    """The points nearest to measurements, and the largest correction.

    Raises
    ------
    DataError
        Naming the first measurement that is further from the manifold than rounding explains.
    """
    shape = manifold.point_shape
    if raw.ndim == 2 and raw.shape[1:] != shape and raw.shape[1] == int(np.prod(shape)):
        raw = raw.reshape(len(raw), *shape)
    manifold.check_finite(raw)
    violation = manifold.constraint_violation(raw)
    wrong = ~(violation <= MAX_CORRECTION)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise DataError(
            f"measurement {i} is no point of {manifold.name}: it is {violation[i]:.3g} away from "
            f"it, and {MAX_CORRECTION} is the most that rounding explains"
        )
    return manifold.project(raw), float(violation.max(initial=0.0))


def with_length_scale(manifold: Manifold, points: Floats) -> Manifold:
    """The group with the length that makes rotations and translations count alike.

    That is the ratio of the lower deciles of the distances to the 0.1 n-th neighbour, over the
    translations and over the rest alone. Other manifolds, and groups that have a length scale, are
    returned as they are.
    """
    if not isinstance(manifold, MatrixGroup) or manifold.free_rows == manifold.size:
        return manifold
    if manifold.length_scale != 1.0 or len(points) < 2:
        return manifold
    still = points.copy()
    still[:, : manifold.free_rows, -1] = 0.0
    moved = np.broadcast_to(np.eye(manifold.size), points.shape).copy()
    moved[:, : manifold.free_rows, -1] = points[:, : manifold.free_rows, -1]
    turns, lengths = (_spread(manifold, each) for each in (still, moved))
    return manifold.with_length_scale(lengths / turns) if turns > 0 and lengths > 0 else manifold


def _spread(manifold: Manifold, points: Floats) -> float:
    distances = neighbour_distances(manifold, points, AUTO_FRACTION)
    return float(quantile(distances, DENSEST)) or float(distances.max(initial=0.0))


def _values(
    manifold: Manifold,
    points: Floats,
    weights: Floats,
    estimator: MeanShift,
    min_share: float,
    rng: np.random.Generator,
) -> tuple[FusedMode, ...]:
    """The modes that are values, refined; where there is none, the one that a wider start finds."""
    h, total = float(np.min(estimator.bandwidth_)), float(weights.sum())
    reached = np.bincount(estimator.labels_, weights=weights, minlength=len(estimator.modes_))
    starts = [
        (mode, float(density))
        for mode, density, own in zip(estimator.modes_, estimator.densities_, reached, strict=True)
        if own >= 0.5 * min_share * total
    ]
    found = [refine(manifold, points, weights, mode, density, h, rng) for mode, density in starts]
    modes = _distinct([mode for mode in found if mode is not None], min_share * total)
    if modes:
        return modes
    densest, density = estimator.modes_[0], float(estimator.densities_[0])
    farthest = np.nan_to_num(manifold.dist(np.broadcast_to(densest, points.shape), points)).max()
    # until the start has all measurements, however narrow their density is
    while widest_deviation(h, manifold.dim, total) < farthest:
        h *= 2.0
        wider = refine(manifold, points, weights, densest, density, h, rng)
        if wider is not None:
            return _distinct([wider], min_share * total)
    return ()


def refine(
    manifold: Manifold,
    points: Floats,
    weights: Floats,
    start: Floats,
    density: float,
    bandwidth: float,
    rng: np.random.Generator,
) -> FusedMode | None:
    """The mean and covariance of the measurements near a mode, by expectation and maximization.

    The measurements are normal about the mean, and others lie about them with an even density: that
    of the shell which has the volume of the ellipsoid with ``SUPPORT`` of the normal ones, and
    surrounds it. The support is what is more likely normal. It starts from the widest round cluster
    for which the bandwidth may be right, one that has all measurements. None if the measurements
    agree by chance (``significance``).
    """
    d = manifold.dim
    limit = chi_square_quantile(d, SUPPORT)
    deviation = widest_deviation(bandwidth, d, float(weights.sum()))
    mean, covariance, round_ = start, np.zeros((d, d)), True
    likely, unit = np.zeros(len(points)), float(weights[weights > 0].mean())
    for _ in range(MAX_ROUNDS):
        tangents = manifold.log(np.broadcast_to(mean, points.shape), points)
        usable = np.isfinite(tangents).reshape(len(points), -1).all(axis=1)
        tangents = np.where(usable.reshape(-1, *[1] * (tangents.ndim - 1)), tangents, 0.0)
        vectors = manifold.coordinates(mean, tangents)
        lengths = manifold.norm(mean, tangents) ** 2
        squares = lengths / deviation**2 if round_ else _mahalanobis(vectors, covariance)
        squares[~usable] = np.inf
        before, likely = likely, _likely(squares, weights, limit, d)
        own = weights * likely
        total = float(own.sum())
        if total <= 0 or np.abs(likely - before).max() < SAME_LIKELY:
            break
        step = own @ vectors / total
        mean = manifold.exp(mean, np.tensordot(own, tangents, axes=1) / total)
        # unbiased, since it is about their own mean; otherwise the few shut each other out
        count = total / unit
        unbiased = count / (count - 1.0) if count >= 2.0 else 1.0
        covariance = (vectors * own[:, None]).T @ vectors / total - np.outer(step, step)
        covariance *= unbiased
        # so few measurements lie on an ellipsoid without volume
        round_ = bool(np.count_nonzero(likely > 0.5) <= d)
        deviation = math.sqrt(unbiased * float(own @ lengths) / total / d)
        if round_ and deviation == 0.0:
            break
    near = (likely > 0.5) & (weights > 0)
    support = np.flatnonzero(near)
    radii, lengths = np.sqrt(squares), np.where(usable, np.sqrt(lengths), np.inf)
    counts = weights if np.all(weights == np.round(weights)) else weights / weights.mean()
    if not is_meaningful(manifold, mean, radii, lengths, near, counts, rng):
        return None
    return FusedMode(mean, density, support, float(weights[support].sum()), covariance)


def _likely(squares: Floats, weights: Floats, limit: float, d: int) -> Floats:
    """The probability [n] that a measurement is a normal one, from squared Mahalanobis distances.

    At least one measurement in the volume of the ellipsoid is taken to be another.
    """
    inside = float(weights[squares <= limit].sum())
    shell = (squares > limit) & (squares <= limit * 2.0 ** (2.0 / d))
    unit = float(weights[weights > 0].mean())
    others = max(float(weights[shell].sum()) - (1.0 - SUPPORT) * inside, unit)
    # normal over even density: the determinant of the covariance cancels
    volume = 0.5 * d * math.log(0.5 * limit) - math.lgamma(0.5 * d + 1.0)
    normal = math.log(max(inside - others, 0.5 * unit)) + volume - 0.5 * squares
    return np.asarray(1.0 / (1.0 + others * np.exp(-np.maximum(normal, -700.0))))


def _mahalanobis(vectors: Floats, covariance: Floats) -> Floats:
    """v' C^-1 v of each row; in directions without spread, infinite for what is not 0 there."""
    values, basis = np.linalg.eigh(covariance)
    spread = values > 1e-12 * values[-1]
    parts = (vectors @ basis) ** 2
    flat = parts[:, ~spread].sum(axis=1) > 1e-12 * values[-1]
    squares = (parts[:, spread] / values[spread]).sum(axis=1)
    return np.where(flat, np.inf, squares)


def _distinct(found: list[FusedMode], smallest: float) -> tuple[FusedMode, ...]:
    """The modes with enough support, most first, without those whose support is a denser one's."""
    kept: list[FusedMode] = []
    for mode in sorted(found, key=lambda mode: -mode.density):
        own = set(mode.support.tolist())
        shared = max((len(own & set(other.support.tolist())) for other in kept), default=0)
        if mode.weight >= smallest and 2 * shared < len(own):
            kept.append(mode)
    return tuple(sorted(kept, key=lambda mode: -mode.weight))
