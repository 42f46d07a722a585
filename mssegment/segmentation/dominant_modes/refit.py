"""Motions that share the tracks among them: each keeps what no other explains better."""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.dominant_modes.inliers import inlier_limit

ROUNDS = 10


def shared_inliers(observed_set: ObservedSet, residuals: Floats, farthest: float) -> Flags:
    """Inliers [m, P] of m motions with ``residuals`` [m, P].

    A track is an inlier of the motion it is nearest to, up to the limit of the noise that all
    motions share (the noise is the tracker's, not the motion's), at most ``farthest`` pixels.
    """
    nearest, distance = residuals.argmin(axis=0), residuals.min(axis=0)
    limit = min(inlier_limit(distance, observed_set.model), farthest)
    return np.asarray((distance <= limit) & (nearest == np.arange(len(residuals))[:, None]))


def compete(
    observed_set: ObservedSet, points: Floats, farthest: float = np.inf
) -> tuple[Floats, Flags, Floats]:
    """Alternates shared inliers and least squares from the motions ``points`` [m, ...].

    Returns the motions, their inliers [m, P] and residuals [m, P]; a motion whose inliers no
    longer determine it stays where it was.
    """
    points = points.copy()
    residuals = observed_set.residuals(points)
    inliers = np.zeros(residuals.shape, dtype=np.bool_)
    for _ in range(ROUNDS):
        before, inliers = inliers, shared_inliers(observed_set, residuals, farthest)
        if np.array_equal(inliers, before):
            break
        fitted, valid = observed_set.fit(inliers.astype(np.float64))
        valid &= inliers.sum(axis=1) >= observed_set.model.subset_size
        points[valid] = fitted[valid]
        residuals = observed_set.residuals(points)
    return points, inliers, residuals
