"""Tracks through a stream of frames, with memory for one window of them.

The same method as ``matching.klt``: corners are followed by pyramidal Lucas-Kanade with a backward
check under a changing brightness, and corners of every frame start new tracks where there are none.
But frames are seen once, positions are kept for one window, and the tracker can go on from what was
stored, with the same result.
"""

from __future__ import annotations

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


class FramePoints(Record, frozen=True):
    """The tracks of one frame.

    Attributes
    ----------
    tracks : ndarray [n] of int64
        Their numbers, ascending.
    points : ndarray [n, 2] of float32
        Their positions in pixels.
    """

    tracks: Integers
    points: Singles


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
    """

    def __init__(self, grey: Bytes, corners: Floats, state: TrackerState | None = None) -> None:
        if state is None:
            numbers = np.arange(len(corners), dtype=np.int64)
            state = TrackerState(
                FramePoints(numbers, corners.astype(np.float32)), next_track=len(corners)
            )
        self.state = state
        self._grey = grey

    def step(self, grey: Bytes, corners: Floats) -> FramePoints:
        """Follow the tracks into the next frame, in which ``corners`` start new ones."""
        live = self.state.live
        ends, kept = _follow_under_change(self._grey, grey, live.points)
        tracks, points = live.tracks[kept], ends[kept]
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
        return found


SAMPLED_FOR_CHANGE = 200
"""Tracks along which the change of the brightness is measured: the median of so many has a tenth of
the error of a single one."""


def dense_tracks(frames: Sequence[FramePoints]) -> tuple[Integers, Floats]:
    """The tracks [P] of some frames, and their positions [P, L, 2], NaN where not visible."""
    numbers = np.concatenate([one.tracks for one in frames])
    tracks, rows = np.unique(numbers, return_inverse=True)
    columns = np.repeat(np.arange(len(frames)), [len(one.tracks) for one in frames])
    points = np.full((len(tracks), len(frames), 2), np.nan)
    points[rows, columns] = np.concatenate([one.points for one in frames])
    return tracks, points


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
    back, returned = _lucas_kanade(after, before, end)
    error = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    ends = end.reshape(-1, 2)
    height, width = after.shape
    inside = ((ends >= 0) & (ends <= (width - 1, height - 1))).all(axis=1)
    return ends, np.asarray(found & returned & (error < RETURN_ERROR) & inside)


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
