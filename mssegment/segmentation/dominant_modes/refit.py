"""Refit several motions that compete for the tracks."""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.dominant_modes.inliers import inlier_limit

COMPETITION_ROUNDS = 10


def exclusive_inliers(observed_set: ObservedSet, residuals: Floats, max_limit: float) -> Flags:
    """Assign each track to the nearest motion, up to a common inlier limit.

    The limit is the same for all motions because the noise is that of the tracker.

    Parameters
    ----------
    observed_set : ObservedSet
        The tracks and their model.
    residuals : ndarray [m, P]
        Residuals in pixels of all tracks from m motions.
    max_limit : float
        Upper bound of the limit in pixels.

    Returns
    -------
    ndarray [m, P] of bool
    """
    nearest, distance = residuals.argmin(axis=0), residuals.min(axis=0)
    limit = min(inlier_limit(distance, observed_set.model), max_limit)
    return np.asarray((distance <= limit) & (nearest == np.arange(len(residuals))[:, None]))


def compete(
    observed_set: ObservedSet, points: Floats, max_limit: float = np.inf
) -> tuple[Floats, Flags, Floats]:
    """Alternate between exclusive inliers and least squares.

    Parameters
    ----------
    observed_set : ObservedSet
        The tracks and their model.
    points : ndarray [m, ...]
        Initial motions.
    max_limit : float
        Upper bound of the inlier limit in pixels.

    Returns
    -------
    points : ndarray [m, ...]
        The motions; one whose inliers no longer determine it is not changed.
    inliers : ndarray [m, P] of bool
    residuals : ndarray [m, P]
        In pixels.
    """
    points = points.copy()
    residuals = observed_set.residuals(points)
    inliers = np.zeros(residuals.shape, dtype=np.bool_)
    for _ in range(COMPETITION_ROUNDS):
        before, inliers = inliers, exclusive_inliers(observed_set, residuals, max_limit)
        if np.array_equal(inliers, before):
            break
        fitted, valid = observed_set.fit(inliers.astype(np.float64))
        valid &= inliers.sum(axis=1) >= observed_set.model.subset_size
        points[valid] = fitted[valid]
        residuals = observed_set.residuals(points)
    return points, inliers, residuals
