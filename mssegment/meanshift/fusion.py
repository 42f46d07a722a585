"""Robust fusion of repeated measurements on a manifold (section 5.5 of the paper).

Measurements of a few true values, many of them wrong: the modes of their density are the values,
and the measurements near a mode, its support, give a mean and a covariance in the tangent space.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.blas import with_one_thread
from mssegment.errors import DataError
from mssegment.manifolds import Manifold, MatrixGroup
from mssegment.meanshift.bandwidth import AUTO_FRACTION, AUTO_SHARE, neighbour_distances
from mssegment.meanshift.estimator import MeanShift
from mssegment.meanshift.validation import InvalidPoints, numbers
from mssegment.records import Floats, Integers, Record
from mssegment.special import chi_square_quantile, quantile

MAX_CORRECTION = 0.05
"""The largest ``constraint_violation`` that projection corrects: a rotation written with two
decimals has 0.02. More is no rounding, but another convention of the numbers."""
SUPPORT = 0.99
"""The share of measurements of a value that its support keeps, if they are normally distributed."""
REWEIGHTINGS = 20
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
        The values, those with most support first.
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
        h, in the manifold's distance, or ``"auto"``.
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
    estimator.set_params(manifold=space).fit(points, sample_weight=sample_weight)
    every = np.ones(len(points)) if weights is None else weights
    found = [
        refine(space, points, every, mode, float(density), float(np.min(estimator.bandwidth_)))
        for mode, density in zip(estimator.modes_, estimator.densities_, strict=True)
        if density * every.sum() > min_share * every.sum() * 0.1
    ]
    modes = _distinct(found, min_share * float(every.sum()))
    labels = np.full(len(points), -1, dtype=np.int64)
    for i, mode in reversed(list(enumerate(modes))):
        labels[mode.support] = i
    return Fusion(space, modes, labels, float(np.min(estimator.bandwidth_)), corrected)


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

    That is the ratio of the lower quartiles of the distances to the 0.1 n-th neighbour, over the
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
    return float(quantile(distances, AUTO_SHARE)) or float(distances.max(initial=0.0))


def refine(
    manifold: Manifold,
    points: Floats,
    weights: Floats,
    start: Floats,
    density: float,
    bandwidth: float,
) -> FusedMode:
    """The mean and covariance of the measurements near a mode, reweighted until they are stable.

    The first support is what is within two bandwidths. Then it is what is within the 0.99 quantile
    of the Mahalanobis distance; the covariance is corrected for what that leaves out (Rousseeuw and
    Leroy, Robust Regression and Outlier Detection, 1987, section 7.1).
    """
    d = manifold.dim
    limit = chi_square_quantile(d, SUPPORT)
    correction = SUPPORT / _chi_square_share(d + 2, limit)
    mean = start
    at = np.broadcast_to(mean, points.shape)
    inside = manifold.dist(at, points) < 2.0 * bandwidth
    covariance = np.zeros((d, d))
    for _ in range(REWEIGHTINGS):
        at = np.broadcast_to(mean, points.shape)
        tangents = manifold.log(at, points)
        usable = np.isfinite(tangents).reshape(len(points), -1).all(axis=1)
        inside &= usable
        own = weights * inside
        total = float(own.sum())
        if total <= 0:
            break
        step = np.tensordot(own, np.nan_to_num(tangents), axes=1) / total
        mean = manifold.exp(mean, step)
        vectors = manifold.coordinates(mean, np.nan_to_num(tangents) - step)
        covariance = correction * (vectors * own[:, None]).T @ vectors / total
        if np.count_nonzero(own) <= d:
            break
        squares = _mahalanobis(vectors, covariance)
        now = (squares <= limit) & usable
        if np.array_equal(now, inside):
            break
        inside = now
    support = np.flatnonzero(inside & (weights > 0))
    return FusedMode(mean, density, support, float(weights[support].sum()), covariance)


def _mahalanobis(vectors: Floats, covariance: Floats) -> Floats:
    """v' C^-1 v of each row; in directions without spread, infinite for what is not 0 there."""
    values, basis = np.linalg.eigh(covariance)
    spread = values > 1e-12 * values[-1]
    parts = (vectors @ basis) ** 2
    flat = parts[:, ~spread].sum(axis=1) > 1e-12 * values[-1]
    squares = (parts[:, spread] / values[spread]).sum(axis=1)
    return np.where(flat, np.inf, squares)


def _chi_square_share(freedom: int, value: float) -> float:
    """The distribution function of chi-square, by bisection of its quantile."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if chi_square_quantile(freedom, middle) < value:
            low = middle
        else:
            high = middle
    return low


def _distinct(found: list[FusedMode], smallest: float) -> tuple[FusedMode, ...]:
    """The modes with enough support, most first, without those whose support is another's."""
    kept: list[FusedMode] = []
    for mode in sorted(found, key=lambda mode: -mode.weight):
        own = set(mode.support.tolist())
        shared = max((len(own & set(other.support.tolist())) for other in kept), default=0)
        if mode.weight >= smallest and len(own) and 2 * shared < len(own):
            kept.append(mode)
    return tuple(kept)
