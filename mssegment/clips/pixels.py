"""From the pictures of a clip to full windows: corners are detected and followed."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import closing

import numpy as np
import numpy.typing as npt

from mssegment.clips.choice import limits_of
from mssegment.clips.store import ClipState, LiveTracks
from mssegment.clips.windows import FullWindow, WindowBuilder
from mssegment.configuration import Configuration
from mssegment.errors import DataError
from mssegment.imaging.corners import DISTANCE_SEQUENCE, LIMIT_SEQUENCE, QUALITY, detect
from mssegment.imaging.pictures import white_level
from mssegment.imaging.streams import Clip, grey_bytes, in_background
from mssegment.imaging.tracking import FramePoints, StreamTracker, TrackerState
from mssegment.progress import report
from mssegment.records import Floats, Frame, Record

Bytes = npt.NDArray[np.uint8]


class _SeenFrame(Record, frozen=True):
    """A frame as the reader passes it on."""

    frame: Frame
    grey: Bytes
    corners: Floats


def windows_of_pixels(
    clip: Clip, configuration: Configuration, resumed: ClipState | None = None
) -> Generator[FullWindow]:
    """Follow tracks through the pictures of a clip, and give each window that is full.

    Parameters
    ----------
    clip : Clip
        The pictures. A thread decodes them and detects their corners.
    configuration : Configuration
        The settings.
    resumed : ClipState, optional
        From what an interrupted clip goes on.

    Raises DataError if a frame cannot be read, or there is none.
    """
    with closing(_Followed(clip, configuration, resumed).windows()) as windows:
        yield from windows


class _Followed:
    """The tracks of a clip, and the windows that they fill."""

    def __init__(self, clip: Clip, configuration: Configuration, resumed: ClipState | None) -> None:
        self._clip, self._configuration, self._resumed = clip, configuration, resumed
        self._tracker: StreamTracker | None = None
        self._recent: list[FramePoints] = []
        self._earlier: list[tuple[Bytes, FramePoints]] = []
        index, start = (0, 0) if resumed is None else (resumed.windows, resumed.start)
        self._builder = WindowBuilder(limits_of(configuration), index, start)
        self._first = start
        if resumed is not None:
            self._recent = live(resumed.recent)
            self._builder.begin(resumed.frames, live(resumed.shared), self._recent)
            self._first += len(resumed.shared) - len(self._recent)

    def windows(self) -> Generator[FullWindow]:
        read = in_background(_read(self._clip, self._configuration, self._first))
        with closing(read):
            for number, seen in enumerate(read, start=self._first + 1):
                if len(self._earlier) < len(self._recent):
                    self._again(seen)
                    continue
                points = self._step(seen)
                report(number, None, "frames")
                full = self._builder.add(seen.frame, points, self._next_track)
                if full is not None:
                    yield full
        if self._tracker is None:
            raise DataError(f"{self._clip.paths[0]}: no frames")
        yield self._builder.rest(self._next_track)

    @property
    def _next_track(self) -> int:
        assert self._tracker is not None
        return self._tracker.state.next_track

    def _again(self, seen: _SeenFrame) -> None:
        """A frame that the windows before have had; with the last of them the tracker goes on."""
        self._earlier.append((seen.grey, self._recent[len(self._earlier)]))
        if self._resumed is not None and len(self._earlier) == len(self._recent):
            state = TrackerState(self._recent[-1], self._resumed.next_track)
            self._tracker = StreamTracker(seen.grey, seen.corners, state, self._earlier[:-1])

    def _step(self, seen: _SeenFrame) -> FramePoints:
        if self._tracker is not None:
            return self._tracker.step(seen.grey, seen.corners)
        self._tracker = StreamTracker(seen.grey, seen.corners)
        return self._tracker.state.live


def live(tracks: Sequence[LiveTracks]) -> list[FramePoints]:
    """The tracks of some frames, as they were before they were stored."""
    return [FramePoints(own.tracks, own.points.astype(np.float32)) for own in tracks]


def _read(clip: Clip, configuration: Configuration, first: int) -> Generator[_SeenFrame]:
    """Frames from ``first`` on, with their corners."""
    settings = configuration.detect
    white = 255.0
    for number, (frame, picture) in enumerate(clip.frames(first)):
        if number == 0:
            white = white_level(picture)
        grey = grey_bytes(picture, white)
        corners = detect(
            grey.astype(np.float32),
            levels=1 if settings.levels == "auto" else settings.levels,
            limit=LIMIT_SEQUENCE if settings.max_corners == "auto" else settings.max_corners,
            distance=(
                DISTANCE_SEQUENCE if settings.min_distance == "auto" else settings.min_distance
            ),
            quality=QUALITY if settings.quality == "auto" else settings.quality,
            even=True,
        )
        yield _SeenFrame(frame, grey, corners.points)
