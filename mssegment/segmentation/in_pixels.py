"""Motions in pixels: maps that other programs can use, beside the points on the manifold."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.geometry.affine_poses import affine_poses
from mssegment.models import of_set
from mssegment.records import ClusterResult, Floats, HypothesisSet, Motion, replace


def with_pixels(
    result: ClusterResult, sets: Sequence[HypothesisSet], points: Floats
) -> ClusterResult:
    """Add ``matrix`` and the other fields in pixels to the motions of a result.

    Parameters
    ----------
    result : ClusterResult
        The motions.
    sets : sequence of HypothesisSet
        The hypotheses that they come from.
    points : ndarray [P, F, 2]
        The tracks in pixels, NaN where a point is not visible.
    """
    motions = tuple(_with_pixels(motion, sets, points) for motion in result.motions)
    return replace(result, motions=motions)


def _with_pixels(motion: Motion, sets: Sequence[HypothesisSet], points: Floats) -> Motion:
    chosen = sets[motion.set_index]
    fields = of_set(chosen).in_pixels(motion.parameters, chosen.normalization)
    # several planes of one body have no map in common: that of the largest
    inliers = points[(motion.parts[0] if motion.parts else motion).inliers]
    if points.shape[1] > 2:
        # the set may be over two of the frames only
        fields["matrix"] = affine_poses(inliers)
    elif "matrix" in fields:
        fields |= _least_squares(chosen, inliers)
    return replace(motion, **fields)


def _least_squares(chosen: HypothesisSet, inliers: Floats) -> dict[str, Floats]:
    """The matrix that fits the inliers best; nothing where they determine none.

    The parameters were estimated robustly, before the last tracks were assigned.
    """
    model = of_set(chosen)
    observed = model.observe(inliers, chosen.normalization)
    fitted, valid = model.fit(observed, np.ones((1, len(inliers))))
    return model.in_pixels(fitted[0], chosen.normalization) if valid[0] else {}
