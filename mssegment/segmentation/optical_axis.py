"""A word of warning: translations along the optical axis look alike.

Bodies that move along the optical axis with the camera, or against it, all have the same direction
of translation: a line in space through the camera does not know how fast, so that ``translation``
cannot tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Motion

NEAR_AXIS = 15.0
"""Degrees from the optical axis within which a translation counts as along it."""


def optical_axis_notes(motions: Sequence[Motion]) -> tuple[str, ...]:
    """A sentence for the user where translations lie along the optical axis."""
    axial = [
        motion.label
        for motion in motions
        if motion.model == "translation" and _degrees_from_axis(motion) < NEAR_AXIS
    ]
    if not axial:
        return ()
    named = ", ".join(str(label) for label in axial)
    return (
        f"motion {named} lies along the optical axis: bodies that move along it too, at any speed, "
        "have the same direction and cannot be told apart by model translation; "
        "choose model affine or factorization for them",
    )


def _degrees_from_axis(motion: Motion) -> float:
    direction = motion.parameters[:, 0]
    cosine = abs(direction[2]) / np.linalg.norm(direction)
    return float(np.degrees(np.arccos(min(cosine, 1.0))))
