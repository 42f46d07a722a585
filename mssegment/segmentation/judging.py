"""Which motion other tracks belong to: those that had no part in finding the motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import motions as models
from mssegment.records import OUTLIER, Floats, HypothesisSet, Integers, Segmentation


def judge(points: Floats, sets: Sequence[HypothesisSet], found: Segmentation) -> Integers:
    """The label of each track [P, F, 2] (pixels) under the motions found: 1..m, or 0.

    A track belongs to the motion whose residual is smallest among those that reach so far: a motion
    reaches as far as the largest residual of its own inliers. Tracks must be seen in all frames of
    the sets.
    """
    if not found.motions:
        return np.full(len(points), OUTLIER, dtype=np.int64)
    rows = []
    for motion in found.motions:
        chosen = sets[motion.set]
        model = models.make(
            motion.model, frames=len(chosen.frames), rank=motion.parameters.shape[-1]
        )
        observed = model.observe(points[:, list(chosen.frames)], chosen.coordinates)
        residuals = model.residuals(motion.parameters[None], observed, chosen.coordinates)[0]
        reach = np.nanmax(found.residuals[motion.label - 1][motion.inliers])
        rows.append(np.where(residuals <= reach, residuals, np.inf))
    nearest = np.argmin(rows, axis=0)
    labels = np.array([motion.label for motion in found.motions])[nearest]
    return np.where(np.isfinite(np.min(rows, axis=0)), labels, OUTLIER).astype(np.int64)
