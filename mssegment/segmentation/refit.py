"""Motions that share the tracks among them: each keeps what no other explains better."""

from __future__ import annotations

import numpy as np

from mssegment.motions import Flags
from mssegment.records import Floats
from mssegment.segmentation.inliers import SPARE, first_minimum
from mssegment.segmentation.selection import View

ROUNDS = 10


def shared_inliers(view: View, residuals: Floats) -> Flags:
    """Inliers [m, P] of m motions with ``residuals`` [m, P].

    Of each motion the basin of its residual mode, among the tracks that no other motion is nearer
    to: the tracks of the other bodies would fill the minimum that ends the basin.
    """
    nearest = residuals.argmin(axis=0)
    inliers = np.zeros(residuals.shape, dtype=np.bool_)
    least = view.model.subset_size + SPARE
    for j, row in enumerate(residuals):
        own = nearest == j
        cut = first_minimum(row[own], view.model.residual_dimension, least)
        inliers[j] = own & (row <= cut)
    return inliers


def compete(view: View, points: Floats) -> tuple[Floats, Flags, Floats]:
    """Alternates shared inliers and least squares from the motions ``points`` [m, ...].

    Returns the motions, their inliers [m, P] and residuals [m, P]; a motion whose inliers no
    longer determine it stays where it was.
    """
    points = points.copy()
    residuals = view.residuals(points)
    inliers = np.zeros(residuals.shape, dtype=np.bool_)
    for _ in range(ROUNDS):
        before, inliers = inliers, shared_inliers(view, residuals)
        if np.array_equal(inliers, before):
            break
        fitted, sound = view.fit(inliers.astype(np.float64))
        sound &= inliers.sum(axis=1) >= view.model.subset_size
        points[sound] = fitted[sound]
        residuals = view.residuals(points)
    return points, inliers, residuals
