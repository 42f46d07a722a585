"""Inliers of a motion without a user's threshold, after the paper's reference [16].

The residuals of all tracks from one motion are a one-dimensional sample. Its kernel density has a
mode near zero, made by the inliers; they are the basin of that mode, up to the first minimum. The
density is that of *log* residuals: a bandwidth in pixels that suits all tracks (n^(-1/5) MAD, as
published) is far too wide for the inliers when most tracks belong to other motions, whereas the
spread of the logarithm of a noise does not depend on its size.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.models import Flags, MotionModel
from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.special import chi_square_quantile, median, trigamma_of_half

GRID = 0.02
"""Step of the grid of log residuals (2 % of a residual)."""
LEAST_RESIDUAL = 1e-3
"""Pixels; smaller residuals are those of the elemental subset itself."""
SPARE = 3
"""Inliers that a motion needs beyond an elemental subset."""
ROUNDS = 10
MIXTURE_ROUNDS = 30
WIDEST = 4.0
"""Standard deviations beyond the typical length of the noise where inliers end at the latest."""


class Fitted(Record, frozen=True):
    """A motion fitted to the basin of its own residuals: inliers [P] and residuals [P] (pixels)."""

    point: Floats
    inliers: Flags
    residuals: Floats


def log_spread(dimension: int) -> float:
    """Bandwidth for the density of log residuals: the spread of the logarithm of pure noise.

    That is sqrt(psi'(c/2)) / 2 for c dimensions. One-dimensional noise has a long tail towards
    zero, but the flank that the minimum bounds is no wider than in two dimensions.
    """
    return 0.5 * float(np.sqrt(trigamma_of_half(max(dimension, 2))))


def first_minimum(residuals: Floats, dimension: int, least: int) -> float:
    """The residual (pixels) at which the basin of the residual mode ends.

    The first minimum of the density of the log ``residuals`` [P] with at least ``least`` tracks
    below it; infinite where the density has none.
    """
    logs = np.sort(np.log(np.maximum(residuals, LEAST_RESIDUAL)))
    logs = logs[np.isfinite(logs)]
    if len(logs) <= least:
        return float("inf")
    bandwidth = log_spread(dimension)
    # below the least-th residual no minimum counts
    grid = np.arange(logs[least - 1] - GRID, logs[-1] + GRID, GRID)
    density = np.exp(-0.5 * ((grid[:, None] - logs) / bandwidth) ** 2).sum(axis=1)
    rising = np.diff(density) > 0
    minima = np.flatnonzero(~rising[:-1] & rising[1:]) + 1
    return float(np.exp(grid[minima[0]])) if len(minima) else float("inf")


def inlier_limit(nearest: Floats, model: MotionModel) -> float:
    """Residual (pixels) up to which a track is more likely an inlier than not.

    ``nearest`` [P] are the residuals of all tracks from the motion that each is nearest to: of all
    bodies together they make one mode. Its basin is the start; where bodies move alike it ends too
    late, so the residuals are then taken apart into noise of ``model.residual_dimension``
    coordinates and tracks anywhere (expectation-maximization), and the limit is where the two are
    equally likely.
    """
    c, least = model.residual_dimension, model.subset_size + SPARE
    length = nearest * np.sqrt(model.residual_terms)
    farthest = float(length.max())
    start = length <= first_minimum(length, c, max(least, len(length) // 5))
    sigma, share = float(np.sqrt(np.mean(length[start] ** 2) / c)), float(start.mean())
    sigma = max(min(sigma, median(length[start]) / _chi_median(c)), LEAST_RESIDUAL)
    for _ in range(MIXTURE_ROUNDS):
        inlier = share * _chi_density(length / sigma, c) / sigma
        outlier = (1.0 - share) * c * length ** (c - 1) / farthest**c
        owned = inlier / np.maximum(inlier + outlier, 1e-300)
        total = max(float(owned.sum()), 1.0)
        share = min(total / len(length), 1.0 - 1.0 / len(length))
        sigma = max(float(np.sqrt((owned * length**2).sum() / (c * total))), LEAST_RESIDUAL)
    grid = sigma * np.linspace(np.sqrt(c), WIDEST + np.sqrt(c), 400)
    inlier = share * _chi_density(grid / sigma, c) / sigma
    outlier = (1.0 - share) * c * grid ** (c - 1) / farthest**c
    likely = np.flatnonzero(inlier > outlier)
    limit = grid[likely[-1]] if len(likely) else grid[0]
    return float(limit / np.sqrt(model.residual_terms))


def _chi_density(x: Floats, c: int) -> Floats:
    """Density of the length of c independent standard normal coordinates.

    By hand, because importing scipy.stats takes longer than segmenting a pair of pictures.
    """
    constant = 2.0 ** (1 - c / 2) / math.exp(math.lgamma(c / 2))
    return np.asarray(constant * x ** (c - 1) * np.exp(-0.5 * x * x))


def _chi_median(c: int) -> float:
    return float(np.sqrt(chi_square_quantile(c, 0.5)))


def fit_within(observed_set: ObservedSet, point: Floats, cut: float) -> Fitted | None:
    """``point`` fitted to its inliers within ``cut`` pixels, alternating until these stay.

    None where the motion loses its inliers on the way.
    """
    least = observed_set.model.subset_size + SPARE
    residuals = observed_set.residuals(point[None])[0]
    inliers = np.zeros(len(residuals), dtype=np.bool_)
    for _ in range(ROUNDS):
        before, inliers = inliers, np.asarray(residuals <= cut)
        if np.array_equal(inliers, before):
            break
        points, valid = observed_set.fit(inliers[None].astype(np.float64))
        if inliers.sum() < least or not valid[0]:
            return None
        point, residuals = points[0], observed_set.residuals(points)[0]
    return Fitted(point, inliers, residuals)
