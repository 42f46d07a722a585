"""Which motion other tracks belong to: those that had no part in finding the motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.models import MotionModel
from mssegment.records import OUTLIER, ClusterResult, Floats, HypothesisSet, Integers, Motion
from mssegment.segmentation.mdl.granularity import LEAST_SCALE
from mssegment.segmentation.mdl.likelihood import Noise

REACH = 6.0
"""Standard deviations of a motion's residuals beyond which no track is judged to be its."""


def assign(points: Floats, sets: Sequence[HypothesisSet], found: ClusterResult) -> Integers:
    """The label of each track [P, F, 2] (pixels) under the motions found: 1..m, or 0.

    A track belongs to the likeliest motion among those that reach so far, given the scale of each
    motion's residuals and its share of the tracks: a wide motion of few tracks passes near many
    tracks of a narrow one. A motion reaches as far as the largest residual of its own inliers, and
    no further than REACH: the far faces of a body (``continuity``) are its own, but do not fit it.
    Tracks must be seen in all frames of the sets.
    """
    if not found.motions:
        return np.full(len(points), OUTLIER, dtype=np.int64)
    rows = []
    for motion in found.motions:
        chosen = sets[motion.set_index]
        model = models.of_set(chosen)
        observed = model.observe(points[:, list(chosen.frames)], chosen.normalization)
        residuals = model.residuals(motion.parameters[None], observed, chosen.normalization)[0]
        own = found.residuals[motion.label - 1][motion.inliers]
        reach = min(float(np.nanmax(own)), REACH * motion.scale)
        rows.append(np.where(residuals <= reach, _cost(model, motion, residuals), np.inf))
    nearest = np.argmin(rows, axis=0)
    labels = np.array([motion.label for motion in found.motions])[nearest]
    return np.where(np.isfinite(np.min(rows, axis=0)), labels, OUTLIER).astype(np.int64)


def _cost(model: MotionModel, motion: Motion, residuals: Floats) -> Floats:
    """Minus the log of share times likelihood (``likelihood``), nats [P]."""
    scale = max(motion.scale, LEAST_SCALE)
    noise = Noise(
        model.residual_dimension, model.residual_terms, scale, scale, 0.0, 0.0, np.zeros(0)
    )
    gains = noise.gains(residuals[None], np.array([scale]))[0]
    return np.asarray(-gains - np.log(len(motion.inliers)))
