"""Tracks through a stream of frames, with memory for one window of them.

The same method as ``matching.klt``: corners are followed by pyramidal Lucas-Kanade with a backward
check under a changing brightness, and corners of every frame start new tracks where there are none.
But frames are seen once, positions are kept for one window, and the tracker can go on from what was
stored, with the same result.

A track that was at rest ends where something else takes it along: what passes covers its window of
the picture, and Lucas-Kanade follows what is in the window. What is there then does not look like
what was at rest (Shi & Tomasi 1994 compare with the first frame in the same way).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.imaging.corners import select_apart
from mssegment.imaging.matching.klt import (
    PYRAMID_LEVELS,
    RETURN_ERROR,
    SEARCH_WINDOW,
    TRACK_DISTANCE,
    far_from,
)
from mssegment.imaging.matching.photometric import (
    ABRUPT_GAIN,
    PhotometricChange,
    change_along_tracks,
    stretched_contrast,
)
from mssegment.records import Floats, Integers, Record

Bytes = npt.NDArray[np.uint8]
Singles = npt.NDArray[np.float32]

REST = 4
"""Frames of rest, and frames after it in which a track leaves its place: half of
``sequences.parts.LONGEST_STEP``."""
RECENT = 3 * REST
"""Frames before the present one that say whether a track was at rest, and then left."""
AT_REST = 1.0
"""Pixels; a track that moves less in ``REST`` frames is at rest: twice ``RETURN_ERROR``."""
LEAVES = 2.0
"""Pixels; a track that moves more in ``REST`` frames leaves its place, as in
``preprocessing.background``."""
STILL = RETURN_ERROR / 10
"""Pixels; a point that moves less from one frame to the next is not followed back: the windows are
nearly the same with the frames exchanged. Of 100 000 such points before static cameras 0.1 % failed
the backward check, of those that move 5 to 50 %."""
LEAST_ALIKE = 0.5
"""Correlation of the windows around a track at rest and after it left: half of the variance is then
explained. It is less than that with its old place where something only passes."""


class FramePoints(Record, frozen=True):
    """The tracks of one frame.

    Attributes
    ----------
    tracks : ndarray [n] of int64
        Their numbers, ascending.
    points : ndarray [n, 2] of float32
        Their positions in pixels; float64 for tracks that were made elsewhere.
    """

    tracks: Integers
    points: Singles | Floats


class TrackerState(Record, frozen=True):
    """From what a tracker goes on: the tracks in the last frame, and the number of the next one."""

    live: FramePoints
    next_track: int


class StreamTracker:
    """Follows corners from frame to frame.

    Parameters
    ----------
    grey : uint8 array [height, width]
        The first frame, or that of ``state``.
    corners : ndarray [n, 2]
        Its corners, which start tracks; not used with a ``state``.
    state : TrackerState, optional
        The tracks in that frame, from an earlier tracker.
    recent : sequence of (array, FramePoints)
        The frames before it and their tracks, at least ``RECENT`` less one if there are so many.
    """

    def __init__(
        self,
        grey: Bytes,
        corners: Floats,
        state: TrackerState | None = None,
        recent: Sequence[tuple[Bytes, FramePoints]] = (),
    ) -> None:
        if state is None:
            numbers = np.arange(len(corners), dtype=np.int64)
            state = TrackerState(
                FramePoints(numbers, corners.astype(np.float32)), next_track=len(corners)
            )
        self.state = state
        self._grey = grey
        self._recent = deque([*recent, (grey, state.live)], maxlen=RECENT)

    def step(self, grey: Bytes, corners: Floats) -> FramePoints:
        """Follow the tracks into the next frame, in which ``corners`` start new ones."""
        live = self.state.live
        ends, kept = _follow_under_change(self._grey, grey, np.asarray(live.points, np.float32))
        tracks, points = live.tracks[kept], ends[kept]
        own = ~self._taken_along(grey, tracks, points)
        tracks, points = tracks[own], points[own]
        apart = select_apart(points, TRACK_DISTANCE / 2)
        tracks, points = tracks[apart], points[apart]
        fresh = far_from(corners, points.astype(np.float64), TRACK_DISTANCE)
        first = self.state.next_track
        numbers = np.arange(first, first + len(fresh), dtype=np.int64)
        found = FramePoints(
            np.concatenate([tracks, numbers]),
            np.concatenate([points, fresh.astype(np.float32)]),
        )
        self.state = TrackerState(found, first + len(fresh))
        self._grey = grey
        self._recent.append((grey, found))
        return found

    def _taken_along(self, grey: Bytes, tracks: Integers, points: Singles) -> npt.NDArray[np.bool_]:
        """Tracks [n] that were at rest, and leave with another picture in their window."""
        found = np.zeros(len(tracks), dtype=bool)
        for frames in range(2 * REST, min(len(self._recent), RECENT) + 1, REST):
            rested, start = self._recent[-frames]
            middle = self._recent[REST - frames][1]
            before, at_rest = _rows(start.tracks, tracks)
            since, known = _rows(middle.tracks, tracks)
            rows = np.flatnonzero(at_rest & known & ~found)
            one, two, now = start.points[before[rows]], middle.points[since[rows]], points[rows]
            earlier, later = np.linalg.norm(two - one, axis=1), np.linalg.norm(now - two, axis=1)
            leaves = (earlier < AT_REST) & (later > LEAVES)
            stops = (earlier > LEAVES) & (later < AT_REST)
            for row, place, left in zip(
                rows[leaves | stops], one[leaves | stops], leaves[leaves | stops], strict=True
            ):
                here = _correlation(rested, place, grey, points[row])
                there = _correlation(rested, place, grey, place) if left else LEAST_ALIKE
                found[row] = here < max(LEAST_ALIKE, there)
        return found


SAMPLED_FOR_CHANGE = 100
"""Tracks along which the change of the brightness is measured: the median of so many has an eighth
of the error of a single one."""


def dense_tracks(frames: Sequence[FramePoints]) -> tuple[Integers, Floats]:
    """The tracks [P] of some frames, and their positions [P, L, 2], NaN where not visible."""
    numbers = np.concatenate([one.tracks for one in frames])
    tracks, rows = np.unique(numbers, return_inverse=True)
    columns = np.repeat(np.arange(len(frames)), [len(one.tracks) for one in frames])
    points = np.full((len(tracks), len(frames), 2), np.nan)
    points[rows, columns] = np.concatenate([one.points for one in frames])
    return tracks, points


def _rows(tracks: Integers, wanted: Integers) -> tuple[Integers, npt.NDArray[np.bool_]]:
    """Where the ``wanted`` numbers [n] are among ``tracks``, ascending, and which are there."""
    place = np.minimum(np.searchsorted(tracks, wanted), max(len(tracks) - 1, 0))
    if not len(tracks):
        return place, np.zeros(len(wanted), dtype=bool)
    return place, np.asarray(tracks[place] == wanted)


def _correlation(one: Bytes, place: Singles, other: Bytes, moved: Singles) -> float:
    """Of the windows around a point in two frames, whatever gain and offset of the brightness."""
    side = (SEARCH_WINDOW, SEARCH_WINDOW)
    first, second = (
        cv2.getRectSubPix(picture, side, (float(x), float(y)), patchType=cv2.CV_32F)
        for picture, (x, y) in ((one, place), (other, moved))
    )
    return float(cv2.matchTemplate(first, second, cv2.TM_CCOEFF_NORMED)[0, 0])


def _follow_under_change(
    before: Bytes, after: Bytes, points: Singles
) -> tuple[Singles, npt.NDArray[np.bool_]]:
    """Follow points [n, 2], and a second time if the first shows that the brightness changed."""
    contrast = stretched_contrast(before)
    before, after = _undone(contrast, before), _undone(contrast, after)
    after = _undone(_abrupt(before, after), after)
    ends, kept = _follow(before, after, points)
    if kept.any():
        step = max(1, int(kept.sum()) // SAMPLED_FOR_CHANGE)
        sample = np.flatnonzero(kept)[::step]
        further = change_along_tracks(
            before, after, points[sample].astype(np.float64), ends[sample].astype(np.float64)
        )
        if further.is_noticeable:
            ends, kept = _follow(before, _undone(further, after), points)
    return ends, kept


def _follow(before: Bytes, after: Bytes, points: Singles) -> tuple[Singles, npt.NDArray[np.bool_]]:
    """Positions of points [n, 2] in the next frame, and which pass the backward check."""
    if not len(points):
        return points, np.zeros(0, bool)
    start = points.reshape(-1, 1, 2)
    end, found = _lucas_kanade(before, after, start)
    ends = end.reshape(-1, 2)
    height, width = after.shape
    kept = found & ((ends >= 0) & (ends <= (width - 1, height - 1))).all(axis=1)
    doubtful = np.flatnonzero(kept & (np.linalg.norm(ends - points, axis=1) >= STILL))
    if len(doubtful):
        back, returned = _lucas_kanade(after, before, end[doubtful])
        error = np.linalg.norm((back - start[doubtful]).reshape(-1, 2), axis=1)
        kept[doubtful] = returned & (error < RETURN_ERROR)
    return ends, np.asarray(kept)


def _undone(change: PhotometricChange, grey: Bytes) -> Bytes:
    """The picture before a change of its brightness."""
    if change == PhotometricChange():
        return grey
    values = (np.arange(256) - change.offset) / change.gain
    return np.asarray(cv2.LUT(grey, np.clip(np.rint(values), 0, 255).astype(np.uint8)), np.uint8)


def _abrupt(before: Bytes, after: Bytes) -> PhotometricChange:
    """As ``photometric.abrupt_change``, without floating-point pictures."""
    (mean1, deviation1), (mean2, deviation2) = (
        (float(m[0, 0]), float(d[0, 0])) for m, d in map(cv2.meanStdDev, (before, after))
    )
    gain = deviation2 / max(deviation1, 1e-6)
    if 1 / ABRUPT_GAIN < gain < ABRUPT_GAIN or gain < 1e-6:
        return PhotometricChange()
    return PhotometricChange(gain, mean2 - gain * mean1)


def _lucas_kanade(
    before: Bytes, after: Bytes, start: Singles
) -> tuple[Singles, npt.NDArray[np.bool_]]:
    """End points [n, 1, 2], and which of them OpenCV found."""
    side = (SEARCH_WINDOW, SEARCH_WINDOW)
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, np.empty_like(start), winSize=side, maxLevel=PYRAMID_LEVELS
    )
    return np.asarray(ends, np.float32), np.asarray(found).ravel() == 1
