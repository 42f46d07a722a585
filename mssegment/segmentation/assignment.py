"""Assign further tracks to the motions of a segmentation that was found without them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.models import MotionModel
from mssegment.records import OUTLIER, ClusterResult, Floats, HypothesisSet, Integers, Motion
from mssegment.segmentation.mdl.granularity import MIN_SCALE
from mssegment.segmentation.mdl.likelihood import Noise

MAX_DEVIATIONS = 6.0
"""A track is never assigned to a motion if its residual exceeds this many standard deviations."""


def assign(points: Floats, sets: Sequence[HypothesisSet], found: ClusterResult) -> Integers:
    """Label tracks by the motions of a segmentation.

    A track is assigned to the most likely of the motions within whose limit it is, given the scale
    of the residuals of each motion and its share of the tracks. (A motion with large residuals and
    few tracks is close to many tracks of a precise motion.) The limit of a motion is the largest
    residual of its inliers, but at most ``MAX_DEVIATIONS``: distant faces of an object belong to it
    but do not fit its motion (``mdl.continuity``).

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, visible in all frames of the sets.
    sets : sequence of HypothesisSet
        The sets of hypotheses of the segmentation.
    found : ClusterResult
        The segmentation.

    Returns
    -------
    ndarray [P] of int
        Labels 1..m, or ``OUTLIER``.
    """
    if not found.motions:
        return np.full(len(points), OUTLIER, dtype=np.int64)
    costs = []
    for motion in found.motions:
        hypotheses = sets[motion.set_index]
        model, normalization = models.of_set(hypotheses), hypotheses.normalization
        observed = model.observe(points[:, list(hypotheses.frames)], normalization)
        residuals = model.residuals(motion.parameters[None], observed, normalization)[0]
        of_inliers = found.residuals[motion.label - 1][motion.inliers]
        limit = min(float(np.nanmax(of_inliers)), MAX_DEVIATIONS * motion.scale)
        costs.append(np.where(residuals <= limit, _cost(model, motion, residuals), np.inf))
    best = np.argmin(costs, axis=0)
    labels = np.array([motion.label for motion in found.motions])[best]
    return np.where(np.isfinite(np.min(costs, axis=0)), labels, OUTLIER).astype(np.int64)


def _cost(model: MotionModel, motion: Motion, residuals: Floats) -> Floats:
    """Negative logarithm of share times likelihood, in nats [P]."""
    scale = max(motion.scale, MIN_SCALE)
    noise = Noise(
        model.residual_dimension, model.residual_terms, scale, scale, 0.0, 0.0, np.zeros(0)
    )
    gains = noise.gains(residuals[None], np.array([scale]))[0]
    return np.asarray(-gains - np.log(len(motion.inliers)))
