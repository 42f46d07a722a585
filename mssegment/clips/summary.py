"""The document of a finished clip, from the files of its windows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from mssegment.clips.objects import objects_of
from mssegment.clips.store import ClipState, ClipStore
from mssegment.clips.track_clip import TrackClip
from mssegment.configuration import Configuration
from mssegment.documents.clips import ClipDocument, WindowDocument, WindowTracks
from mssegment.history import entry_of
from mssegment.imaging.streams import Clip
from mssegment.records import Frame, State, field


def summary(
    clip: Clip | TrackClip, configuration: Configuration, store: ClipStore, state: ClipState
) -> ClipDocument:
    """The document of a clip whose windows are all there; ``state`` is that after the last one.

    Raises DataError if a file of a window is missing or damaged.
    """
    counted = _Counted()
    objects = objects_of(counted.passing(store.windows(state.windows)))
    width, height = state.identities.size
    start, step, numbers = _numbers(clip)
    return ClipDocument(
        inputs=list(clip.paths),
        sha256=clip.sha256,
        start=start,
        step=step,
        numbers=numbers,
        width=width,
        height=height,
        frames=state.start,
        rate=_rate(counted.times),
        windows=counted.spans,
        cameras=counted.cameras,
        tracks=counted.tracks,
        positions=counted.positions,
        objects=objects,
        ids=list(clip.ids) if isinstance(clip, TrackClip) else [],
        history=[
            *(clip.history if isinstance(clip, TrackClip) else ()),
            *(
                entry_of(stage, configuration)
                for stage in ("detect", "match", "hypothesize", "cluster")
                if isinstance(clip, Clip) or stage in ("hypothesize", "cluster")
            ),
        ],
    )


class _Counted(State):
    """What is counted while the windows pass by."""

    spans: list[tuple[int, int]] = field(default_factory=list)
    cameras: list[str] = field(default_factory=list)
    times: list[float | None] = field(default_factory=list)
    positions: int = 0
    tracks: int = 0
    last_track: int = -1

    def passing(
        self, windows: Iterator[tuple[WindowDocument, WindowTracks]]
    ) -> Iterator[tuple[WindowDocument, WindowTracks]]:
        for document, tracks in windows:
            self.spans.append((document.start, document.stop))
            self.cameras.append(document.camera)
            self.times.extend(document.times)
            self.positions += len(tracks.points)
            new = np.unique(tracks.track[tracks.track > self.last_track])  # in their order
            self.tracks += len(new)
            self.last_track = max([self.last_track, *new[-1:].tolist()])
            yield document, tracks


def _numbers(clip: Clip | TrackClip) -> tuple[int, int, list[int]]:
    """The number of the first frame in its source and the distance of the frames.

    Where the distances differ, 0 and 1, and all numbers.
    """
    if isinstance(clip, Clip):
        return clip.start, clip.step, []
    numbers = frame_numbers(clip.frames)
    steps = {later - earlier for earlier, later in pairwise(numbers)}
    if len(steps) == 1 and min(steps) > 0:
        return numbers[0], min(steps), []
    return 0, 1, numbers


def frame_numbers(frames: Sequence[Frame]) -> list[int]:
    """The numbers of frames in their file, where all are of one; otherwise their places."""
    indices = [frame.index for frame in frames if frame.index is not None]
    if len({frame.path for frame in frames}) == 1 and len(set(indices)) == len(frames):
        return indices
    return list(range(len(frames)))


def _rate(times: list[float | None]) -> float | None:
    """Frames a second, from the times of the frames."""
    known = [time for time in times if time is not None]
    if len(known) < max(2, len(times)) or known[-1] <= known[0]:
        return None
    return round((len(known) - 1) / (known[-1] - known[0]), 6)
