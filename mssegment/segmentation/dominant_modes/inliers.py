"""Inliers of a motion without a user-defined threshold, following the paper's reference [16].

The residuals of all tracks from one motion are a one-dimensional sample. Its kernel density has a
mode near zero, the inliers, which end at the first minimum. The density is that of the *logarithm*
of the residuals. A bandwidth in pixels that suits all tracks (n^(-1/5) MAD, as published) is much
too large for the inliers if most tracks belong to other motions, whereas the spread of the
logarithm of noise does not depend on its scale.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.models import Flags, MotionModel
from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.special import chi_square_quantile, median, trigamma_of_half

LOG_STEP = 0.02
"""Step of the grid of log residuals (2 % of a residual)."""
MIN_RESIDUAL = 1e-3
"""Smallest residual in pixels; smaller ones are those of the elemental subset itself."""
EXTRA_INLIERS = 3
"""Inliers that a motion must have in addition to an elemental subset."""
FIT_ROUNDS = 10
EM_ROUNDS = 30
MAX_DEVIATIONS = 4.0
"""Upper bound of the inlier limit, in standard deviations beyond the typical norm of the noise."""


class Fitted(Record, frozen=True):
    """A motion fitted to its inliers [P], and residuals [P] in pixels."""

    point: Floats
    inliers: Flags
    residuals: Floats


def log_spread(dimension: int) -> float:
    """Bandwidth for the density of log residuals: the standard deviation of the logarithm of noise.

    It is sqrt(psi'(c/2)) / 2 for c dimensions. For c = 1 the logarithm has a long tail towards
    zero, but the side towards the minimum is no wider than for c = 2.
    """
    return 0.5 * float(np.sqrt(trigamma_of_half(max(dimension, 2))))


def first_minimum(residuals: Floats, dimension: int, least: int) -> float:
    """The residual at which the inliers end.

    Parameters
    ----------
    residuals : ndarray [P]
        Residuals of all tracks from a motion, in pixels.
    dimension : int
        Dimension of the residual vectors.
    least : int
        Number of tracks below the minimum, at least.

    Returns
    -------
    float
        The first minimum of the density of the log residuals, in pixels; infinite if there is none.
    """
    logs = np.sort(np.log(np.maximum(residuals, MIN_RESIDUAL)))
    logs = logs[np.isfinite(logs)]
    if len(logs) <= least:
        return float("inf")
    bandwidth = log_spread(dimension)
    # minima below the least-th residual are ignored
    grid = np.arange(logs[least - 1] - LOG_STEP, logs[-1] + LOG_STEP, LOG_STEP)
    density = np.exp(-0.5 * ((grid[:, None] - logs) / bandwidth) ** 2).sum(axis=1)
    rising = np.diff(density) > 0
    minima = np.flatnonzero(~rising[:-1] & rising[1:]) + 1
    return float(np.exp(grid[minima[0]])) if len(minima) else float("inf")


def inlier_limit(nearest: Floats, model: MotionModel) -> float:
    """The residual up to which a track is more likely an inlier than an outlier.

    The first minimum of the residuals from the nearest motion is the start. Where objects move
    alike it is too large, so a mixture of noise in ``model.residual_dimension`` coordinates and
    uniform outliers is then fitted by EM. The limit is where the two are equally likely.

    Parameters
    ----------
    nearest : ndarray [P]
        Residual of each track from its nearest motion, in pixels.
    model : MotionModel
        The motion model.

    Returns
    -------
    float
        The limit in pixels.
    """
    c, least = model.residual_dimension, model.subset_size + EXTRA_INLIERS
    length = nearest * np.sqrt(model.residual_terms)
    largest = float(length.max())
    start = length <= first_minimum(length, c, max(least, len(length) // 5))
    sigma, share = float(np.sqrt(np.mean(length[start] ** 2) / c)), float(start.mean())
    sigma = max(min(sigma, median(length[start]) / _chi_median(c)), MIN_RESIDUAL)
    for _ in range(EM_ROUNDS):
        inlier = share * _chi_density(length / sigma, c) / sigma
        outlier = (1.0 - share) * c * length ** (c - 1) / largest**c
        posterior = inlier / np.maximum(inlier + outlier, 1e-300)
        total = max(float(posterior.sum()), 1.0)
        share = min(total / len(length), 1.0 - 1.0 / len(length))
        sigma = max(float(np.sqrt((posterior * length**2).sum() / (c * total))), MIN_RESIDUAL)
    grid = sigma * np.linspace(np.sqrt(c), MAX_DEVIATIONS + np.sqrt(c), 400)
    inlier = share * _chi_density(grid / sigma, c) / sigma
    outlier = (1.0 - share) * c * grid ** (c - 1) / largest**c
    likely = np.flatnonzero(inlier > outlier)
    limit = grid[likely[-1]] if len(likely) else grid[0]
    return float(limit / np.sqrt(model.residual_terms))


def _chi_density(x: Floats, c: int) -> Floats:
    """Density of the norm of c independent standard normal coordinates.

    Not from scipy.stats, whose import takes longer than segmenting an image pair.
    """
    constant = 2.0 ** (1 - c / 2) / math.exp(math.lgamma(c / 2))
    return np.asarray(constant * x ** (c - 1) * np.exp(-0.5 * x * x))


def _chi_median(c: int) -> float:
    """Median of the norm of c independent standard normal coordinates."""
    return float(np.sqrt(chi_square_quantile(c, 0.5)))


def fit_within(observed_set: ObservedSet, point: Floats, limit: float) -> Fitted | None:
    """Fit a motion to its inliers within ``limit`` pixels, until the inliers no longer change.

    None if the motion loses its inliers.
    """
    least = observed_set.model.subset_size + EXTRA_INLIERS
    residuals = observed_set.residuals(point[None])[0]
    inliers = np.zeros(len(residuals), dtype=np.bool_)
    for _ in range(FIT_ROUNDS):
        before, inliers = inliers, np.asarray(residuals <= limit)
        if np.array_equal(inliers, before):
            break
        points, valid = observed_set.fit(inliers[None].astype(np.float64))
        if inliers.sum() < least or not valid[0]:
            return None
        point, residuals = points[0], observed_set.residuals(points)[0]
    return Fitted(point, inliers, residuals)
