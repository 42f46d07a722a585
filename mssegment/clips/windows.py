"""From the tracks of a stream of frames to windows that are full."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from mssegment.imaging.tracking import RECENT, FramePoints, Singles, dense_tracks
from mssegment.records import Floats, Frame, Integers, Record, field
from mssegment.sequences.lifetimes import (
    LONGEST_WINDOW,
    MOVED,
    SHORTEST_WINDOW,
    WindowLimits,
    rate_of_endings,
)


class FullWindow(Record, frozen=True):
    """The tracks of a window, and what the next one starts with.

    Attributes
    ----------
    index : int
        The number of the window.
    start : int
        The number of its first frame.
    own : int
        How many of its frames are in no later window.
    frames : tuple of Frame
        Its L frames.
    tracks : ndarray [P] of int64
        The numbers of the tracks.
    points : ndarray [P, L, 2]
        Their positions in pixels, NaN where they are not visible.
    shared : tuple of FramePoints
        The tracks of the frames that the next window shares.
    recent : tuple of FramePoints
        Those of the last frames, from which the tracker goes on.
    next_track : int
        The number of the next new track.
    is_last : bool
        Whether the clip ends with this window.
    paused : ndarray of int64
        Tracks that earlier windows and later ones show, and this one does not.
    """

    index: int
    start: int
    own: int
    frames: tuple[Frame, ...]
    tracks: Integers
    points: Floats
    shared: tuple[FramePoints, ...]
    recent: tuple[FramePoints, ...]
    next_track: int
    is_last: bool = False
    paused: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


class WindowBuilder:
    """Collects frames until a window is full.

    A full window is held back until the next one has enough frames of its own: at the end of the
    clip a few frames more belong to the last window.

    Parameters
    ----------
    limits : WindowLimits
        How long windows are.
    index, start : int
        The number of the first window, and of its first frame.
    """

    def __init__(self, limits: WindowLimits, index: int = 0, start: int = 0) -> None:
        self._limits = limits
        self._least = min(
            SHORTEST_WINDOW, LONGEST_WINDOW if limits.length == "auto" else limits.length
        )
        self._index = index
        self._open = _OpenWindow(start)
        self._held: _OpenWindow | None = None
        self._recent: deque[FramePoints] = deque(maxlen=RECENT)

    def begin(
        self,
        frames: Sequence[Frame],
        shared: Sequence[FramePoints],
        recent: Sequence[FramePoints],
    ) -> None:
        """Start with frames that the window before had too, and the last ones up to them."""
        self._open.begin(frames, shared)
        self._recent.extend(recent)

    def add(self, frame: Frame, points: FramePoints, next_track: int) -> FullWindow | None:
        """Append a frame; the window before, if it is complete."""
        opened = self._open
        opened.add(frame, points, next_track)
        self._recent.append(points)
        complete = None
        if self._held is not None and len(opened.frames) >= self._least:
            complete = self._complete(self._held, self._held.own)
            self._held = None
        if self._held is None and self._limits.is_full(np.array(opened.rates)):
            shared = self._limits.shared(np.array(opened.rates))
            opened.own = len(opened.frames) - shared
            opened.recent = tuple(self._recent)
            self._held, self._open = opened, _OpenWindow(opened.start + opened.own)
            self._open.begin(opened.frames[opened.own :], opened.points[opened.own :])
        return complete

    def rest(self, next_track: int) -> FullWindow:
        """The last window, with all frames that are left."""
        last = self._open
        if self._held is not None:
            new = len(self._held.frames) - self._held.own
            last = self._held
            last.frames += self._open.frames[new:]
            last.points += self._open.points[new:]
        last.next_track = next_track
        return self._complete(last, len(last.frames), is_last=True)

    def _complete(self, window: _OpenWindow, own: int, *, is_last: bool = False) -> FullWindow:
        tracks, dense = dense_tracks(window.points)
        complete = FullWindow(
            index=self._index,
            start=window.start,
            own=own,
            frames=tuple(window.frames),
            tracks=tracks,
            points=dense,
            shared=tuple(window.points[own:]),
            recent=window.recent,
            next_track=window.next_track,
            is_last=is_last,
        )
        self._index += 1
        return complete


class _OpenWindow:
    """The frames of a window that is not full, and the rate at which its tracks end."""

    def __init__(self, start: int) -> None:
        self.start = start
        self.own = 0
        self.next_track = 0
        self.frames: list[Frame] = []
        self.points: list[FramePoints] = []
        self.recent: tuple[FramePoints, ...] = ()
        self.rates: list[float] = []
        self._moved = _Moved()

    def begin(self, frames: Sequence[Frame], points: Sequence[FramePoints]) -> None:
        for frame, own in zip(frames, points, strict=True):
            self.add(frame, own, 0)

    def add(self, frame: Frame, points: FramePoints, next_track: int) -> None:
        if self.frames:
            self.rates.append(rate_of_endings(*self._moved.and_ended(points)))
        self.frames.append(frame)
        self.points.append(points)
        self._moved.update(points)
        self.next_track = next_track


class _Moved:
    """Which tracks have moved since the first frame of the window that shows them."""

    def __init__(self) -> None:
        self._tracks = np.zeros(0, dtype=np.int64)
        self._starts: Singles | Floats = np.zeros((0, 2), dtype=np.float32)
        self._has_moved = np.zeros(0, dtype=bool)

    def update(self, points: FramePoints) -> None:
        """The tracks of the next frame."""
        place = np.searchsorted(self._tracks, points.tracks)
        known = place < len(self._tracks)
        known[known] = self._tracks[place[known]] == points.tracks[known]
        starts = points.points.copy()
        starts[known] = self._starts[place[known]]
        self._tracks, self._starts = points.tracks, starts
        self._has_moved = np.linalg.norm(points.points - starts, axis=1) > MOVED

    def and_ended(self, following: FramePoints) -> tuple[int, int]:
        """How many tracks of the frame have moved, and how many of these end there."""
        moved = self._tracks[self._has_moved]
        return len(moved), int((~np.isin(moved, following.tracks)).sum())
