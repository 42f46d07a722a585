"""Background: what stands still under a static camera is no motion.

The camera is static where the tracks that stand still lie all over the picture: an object that
happens to stand still fills few places. They need not be most of the tracks: texture decides that.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mssegment.manifolds import Euclidean
from mssegment.meanshift import ascend, kernel_named, shift
from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers, Record
from mssegment.special import distinct, quantile

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
LEAST_FRAMES = 0.9
"""Share of its frames in which background is where it began: over many frames a tracker slips."""
WAVERING, NEIGHBOURS = 2.0, 8
"""See ``_wavering``."""
GRID = 8
SAMPLE = 500
"""Displacements that the mean shift looks at."""
MAX_STEPS = 100
"""Bound on its steps."""
TOLERANCE = 1e-4
"""Bandwidths; a shorter step is the last one."""


class Background(Record, frozen=True):
    """``status`` [P]: -1 for background, 0 for tracks to segment; ``notes`` for the user."""

    status: Integers
    notes: tuple[str, ...] = ()

    @property
    def found(self) -> bool:
        """Whether something stands still, so that the camera does too."""
        return bool((self.status == BACKGROUND).any())


def find_background(
    points: Floats,
    *,
    frame_size: tuple[int, int],
    remove: bool | Literal["auto"] = "auto",
    min_displacement: float = 2.0,
) -> Background:
    """Which of the tracks [P, F, 2] (pixels, NaN where not seen) are background.

    A track is background where it stays within ``min_displacement`` pixels of where it began, in
    (nearly) every frame, after the sway of the camera is taken away. ``remove`` says whether to
    look; ``auto`` looks where the camera is static. ``frame_size`` is (width, height).
    """
    status = np.full(len(points), OUTLIER, dtype=np.int64)
    if remove is False or len(points) == 0:
        return Background(status)
    path = camera_path(points, STILL * float(np.hypot(*frame_size)))
    distance = distances(points, path)
    if remove == "auto":
        static, reason = is_static(points, distance, frame_size)
        if not static:
            return Background(status, (f"the camera moves ({reason}): no background removed",))
    seen = np.isfinite(distance).sum(axis=1)
    near = (distance < min_displacement).sum(axis=1)
    still = np.asarray((seen > 1) & (near >= np.ceil(LEAST_FRAMES * seen)))
    still |= _wavering(points, distance, still)
    status[still] = BACKGROUND
    note = f"background: {int(still.sum())} of {len(points)} tracks stand still"
    return Background(status, (note,))


def _wavering(points: Floats, distance: Floats, still: Flags) -> Flags:
    """Tracks [P] that move hardly more than those which are ``still``, and lie among them.

    A tracker slips along edges and near things sway more: hardly more is WAVERING times what nine
    in ten of the still tracks reach, and among them means most of the NEIGHBOURS nearest. The slow
    parts of a moving thing lie among what moves.
    """
    found = np.zeros(len(points), dtype=bool)
    judged = np.flatnonzero(np.isfinite(distance).sum(axis=1) > 1)
    if not still.any() or len(judged) <= NEIGHBOURS:
        return found
    reach = _quantile(distance[judged], LEAST_FRAMES)
    quiet = still[judged]
    weak = ~quiet & (reach < WAVERING * quantile(reach[quiet], LEAST_FRAMES))
    place = np.nanmean(points[judged], axis=1)
    asking = np.flatnonzero(weak)
    _, near = nearest(place, place[asking], NEIGHBOURS + 1)
    while True:
        joining = asking[~quiet[asking] & (quiet[near[:, 1:]].mean(axis=1) > 0.5)]
        if not joining.size:
            found[judged[quiet]] = True
            return found
        quiet[joining] = True


def camera_path(points: Floats, largest: float) -> Floats:
    """How the picture of what stands still sways, pixels [F, 2] from the first frame.

    In each frame the densest displacement, up to ``largest`` pixels, of the tracks that are seen
    in it and began earlier, each from where it began.
    """
    seen = np.asarray(np.isfinite(points).all(axis=2))
    first = seen.argmax(axis=1)
    path = np.zeros(points.shape[1:])
    for frame in range(1, len(path)):
        older = np.flatnonzero(seen[:, frame] & (first < frame))
        if not len(older):
            path[frame] = path[frame - 1]
            continue
        sample = older[np.linspace(0, len(older) - 1, min(len(older), SAMPLE)).astype(int)]
        moved = points[sample, frame] - points[sample, first[sample]] + path[first[sample]]
        small = moved[np.linalg.norm(moved, axis=1) < largest]
        path[frame] = densest(small) if len(small) else path[frame - 1]
    return path


def densest(displacements: Floats) -> Floats:
    """The mode of the kernel density of ``displacements`` [n, 2] that the densest one ascends to.

    One pass over all pairs finds the start; mean shift of all of them would find all modes.
    """
    prepared, kernel = Euclidean(2).prepare(displacements, BANDWIDTH), kernel_named("gaussian")
    _, density = shift(prepared, kernel, displacements)
    found = ascend(
        prepared,
        kernel,
        displacements[[density.argmax()]],
        tolerance=TOLERANCE,
        max_iterations=MAX_STEPS,
        accelerated=False,
    )
    return np.asarray(found.x[0])


def distances(points: Floats, path: Floats) -> Floats:
    """How far each track is in each frame from where it began, sway aside, pixels [P, F]."""
    steady = points - path
    first = np.isfinite(points).all(axis=2).argmax(axis=1)
    start = steady[np.arange(len(points)), first]
    return np.asarray(np.linalg.norm(steady - start[:, None], axis=-1))


def is_static(points: Floats, distance: Floats, frame_size: Sequence[int]) -> tuple[bool, str]:
    """Whether the camera stands still, judged in the frame that speaks most against it; why not."""
    for frame in range(1, points.shape[1]):
        # a track that begins here says nothing about the camera
        seen = np.isfinite(distance[:, frame]) & np.isfinite(distance[:, :frame]).any(axis=1)
        if not seen.any():
            continue
        near = np.asarray(distance[seen, frame] < NEAR)
        if near.mean() < LEAST_SHARE:
            return (
                False,
                f"only {near.mean():.0%} of the tracks stand still until frame {frame + 1}",
            )
        filled = _cells_filled(points[seen, frame], near, frame_size)
        if filled < LEAST_CELLS:
            return False, f"what stands still fills only {filled:.0%} of the picture"
    return True, ""


def _cells_filled(points: Floats, still: Flags, frame_size: Sequence[int]) -> float:
    """Share of the occupied cells of a grid over the picture that hold a still track."""
    size = np.maximum(frame_size, points.max(axis=0) + 1)
    cell = np.clip((points / size * GRID).astype(int), 0, GRID - 1) @ [1, GRID]
    return len(distinct(cell[still])) / len(distinct(cell))


def _quantile(values: Floats, share: float) -> Floats:
    """The quantile of each row, of what is known of it; many times faster where all is known."""
    known = np.isfinite(values).all(axis=1)
    found = np.empty(len(values))
    if known.any():
        found[known] = quantile(values[known], share)
    if not known.all():
        found[~known] = np.nanquantile(values[~known], share, axis=1)
    return found
