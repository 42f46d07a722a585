"""Background: what stands still under a static camera is no motion.

The camera is static where the tracks that stand still lie all over the picture: an object that
happens to stand still fills few places. They need not be most of the tracks: texture decides that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mssegment.meanshift import MeanShift
from mssegment.motions import Flags
from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers

BANDWIDTH = 2.0
"""Pixels, for the mean shift over the displacements."""
STILL = 0.005
"""Share of the picture's diagonal up to which a common displacement is shake, not motion (4 pixels
in 640 x 480: a bridge under traffic sways by 2)."""
NEAR = 1.5
"""Pixels from the shake within which a track stands still."""
LEAST_SHARE = 0.15
"""Share of the tracks that stand still, at least, under a static camera. Low: textured objects
give many tracks and a plain wall few; where the still ones lie says more."""
LEAST_CELLS = 0.4
"""Share of the occupied cells of the grid that hold one of them, at least."""
GRID = 8
SAMPLE = 500
"""Displacements that the mean shift looks at."""


@dataclass(frozen=True)
class Background:
    """``status`` [P]: -1 for background, 0 for tracks to segment; ``notes`` for the user."""

    status: Integers
    notes: tuple[str, ...] = ()


def find_background(
    points: Floats,
    *,
    frame_size: tuple[int, int],
    remove: bool | Literal["auto"] = "auto",
    min_displacement: float = 2.0,
) -> Background:
    """Which of the tracks [P, F, 2] (pixels, NaN where not seen) are background.

    A track is background where it stays within ``min_displacement`` pixels of where it started,
    in every frame, after the shake of the camera (the most common small displacement of each frame)
    is taken away. ``remove`` says whether to look; ``auto`` looks where the camera
    is static. ``frame_size`` is (width, height).
    """
    status = np.full(len(points), OUTLIER, dtype=np.int64)
    if remove is False or len(points) == 0:
        return Background(status)
    displacement = displacements(points)
    shake = _shake(displacement, STILL * float(np.hypot(*frame_size)))
    if remove == "auto":
        static, reason = is_static(points, displacement, shake, frame_size)
        if not static:
            return Background(status, (f"the camera moves ({reason}): no background removed",))
    distance = np.linalg.norm(displacement - shake, axis=-1)
    seen_again = np.isfinite(distance).sum(axis=1) > 1
    still = seen_again & ~(distance >= min_displacement).any(axis=1)
    status[still] = BACKGROUND
    note = f"background: {int(still.sum())} of {len(points)} tracks stand still"
    return Background(status, (note,))


def displacements(points: Floats) -> Floats:
    """Of each track in each frame from where it was first seen, pixels [P, F, 2]."""
    seen = np.isfinite(points).all(axis=2)
    first = seen.argmax(axis=1)
    return np.asarray(points - points[np.arange(len(points)), first][:, None])


def is_static(
    points: Floats, displacement: Floats, shake: Floats, frame_size: Sequence[int]
) -> tuple[bool, str]:
    """Whether the camera stands still, judged in the frame that speaks most against it; why not."""
    for frame in range(1, points.shape[1]):
        seen = np.isfinite(displacement[:, frame]).all(axis=1)
        if not seen.any():
            continue
        gap = np.linalg.norm(displacement[seen, frame] - shake[frame], axis=1)
        share = float((gap < NEAR).mean())
        if share < LEAST_SHARE:
            return False, f"only {share:.0%} of the tracks stand still until frame {frame + 1}"
        filled = _cells_filled(points[seen, frame], gap < NEAR, frame_size)
        if filled < LEAST_CELLS:
            return False, f"what stands still fills only {filled:.0%} of the picture"
    return True, ""


def _shake(displacement: Floats, largest: float) -> Floats:
    """The densest displacement of each frame among those up to ``largest`` pixels, [F, 2]."""
    shake = np.zeros(displacement.shape[1:])
    for frame in range(1, len(shake)):
        moved = displacement[:, frame]
        moved = moved[np.isfinite(moved).all(axis=1)]
        if len(moved):
            sample = moved[np.linspace(0, len(moved) - 1, min(len(moved), SAMPLE)).astype(int)]
            modes = MeanShift("euclidean(2)", BANDWIDTH).fit(sample).modes_
            small = modes[np.linalg.norm(modes, axis=1) < largest]
            shake[frame] = small[0] if len(small) else 0.0
    return shake


def _cells_filled(points: Floats, still: Flags, frame_size: Sequence[int]) -> float:
    """Share of the occupied cells of a grid over the picture that hold a still track."""
    size = np.maximum(frame_size, points.max(axis=0) + 1)
    cell = np.clip((points / size * GRID).astype(int), 0, GRID - 1) @ [1, GRID]
    return len(np.unique(cell[still])) / len(np.unique(cell))
