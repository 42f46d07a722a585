"""Tracks of another program over many frames, segmented in windows like those of a clip."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Generator, Iterator, Sequence
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from mssegment.clips.store import ClipState
from mssegment.clips.windows import FullWindow, WindowBuilder
from mssegment.documents import HistoryEntry
from mssegment.imaging.frames import read_once
from mssegment.imaging.pictures import StoredPicture
from mssegment.imaging.tracking import FramePoints
from mssegment.progress import report
from mssegment.records import Camera, Floats, Frame, Integers, Record, replace
from mssegment.sequences.lifetimes import WindowLimits

if TYPE_CHECKING:
    from mssegment.datasets.base import ScatteredTracks


class TrackClip(Record, frozen=True):
    """The visible positions of tracks, frame by frame.

    Attributes
    ----------
    paths : tuple of str
        The file of the tracks, and the pictures that they were made from.
    frames : tuple of Frame
        The F frames.
    on_pictures : bool
        Whether these are pictures, or frames of a video.
    tracks : ndarray [n] of int64
        The number of the track at each position, by frame and number. Tracks are numbered in the
        order in which they appear.
    points : ndarray [n, 2]
        The positions in pixels.
    edges : ndarray [F + 1] of int64
        The positions of frame f are ``edges[f]`` to ``edges[f + 1]``.
    spans : ndarray [P, 2] of int64
        The first and the last frame of each track.
    ids : tuple of str [P]
        The names of the tracks in their file, or their places in it from 1.
    history : tuple of HistoryEntry
        How the tracks were made.
    camera : Camera or None
        The calibration, where the file has it.
    """

    paths: tuple[str, ...]
    frames: tuple[Frame, ...]
    on_pictures: bool
    tracks: Integers
    points: Floats
    edges: Integers
    spans: Integers
    ids: tuple[str, ...]
    history: tuple[HistoryEntry, ...] = ()
    camera: Camera | None = None

    @classmethod
    def of(
        cls,
        tracks: ScatteredTracks,
        frames: Sequence[Frame],
        *,
        paths: Sequence[str],
        on_pictures: bool,
        ids: Sequence[str] | None,
        history: Sequence[HistoryEntry] = (),
        camera: Camera | None = None,
    ) -> TrackClip:
        """The clip of tracks that were read."""
        order = np.lexsort((tracks.row, tracks.column))
        rows, columns = tracks.row[order], tracks.column[order]
        own, first, inverse = np.unique(rows, return_index=True, return_inverse=True)
        appearance = np.argsort(first)
        number = np.argsort(appearance)[inverse]
        again = np.lexsort((number, columns))
        last = np.zeros(len(own), dtype=np.int64)
        np.maximum.at(last, number, columns)
        names = [str(row + 1) if ids is None else ids[row] for row in own[appearance].tolist()]
        return cls(
            paths=tuple(paths),
            frames=tuple(frames),
            on_pictures=on_pictures,
            tracks=number[again],
            points=tracks.points[order][again],
            edges=np.searchsorted(columns, np.arange(tracks.frames + 1)),
            spans=np.column_stack([columns[first[appearance]], last]),
            ids=tuple(names),
            history=tuple(history),
            camera=camera,
        )

    @property
    def sha256(self) -> str:
        """Of the tracks and the records of their frames."""
        digest = hashlib.sha256()
        for array in (self.tracks, self.points, self.edges):
            digest.update(np.ascontiguousarray(array).data)
        digest.update(msgspec.json.encode([self.frames, self.ids, self.camera]))
        return digest.hexdigest()

    def points_in(self, frame: int) -> FramePoints:
        """The tracks of a frame."""
        own = slice(int(self.edges[frame]), int(self.edges[frame + 1]))
        return FramePoints(self.tracks[own], self.points[own])

    def paused(self, start: int, stop: int, seen: Integers) -> Integers:
        """The tracks that are not ``seen`` in the frames ``start`` to ``stop``, but again later."""
        later = np.flatnonzero((self.spans[:, 0] < start) & (self.spans[:, 1] >= stop))
        return np.setdiff1d(later, seen)

    def pictures(self, wanted: Collection[int] | None = None) -> Iterator[StoredPicture | None]:
        """The picture of each frame, all or only those ``wanted``; None for the others.

        Without pictures there are none at all. Raises DataError if one cannot be read.
        """
        source = read_once(self.frames) if self.on_pictures else None
        for index in range(len(self.frames)):
            is_wanted = source is not None and (wanted is None or index in wanted)
            yield source.pixels(index) if source is not None and is_wanted else None


def windows_of_tracks(
    clip: TrackClip, limits: WindowLimits, resumed: ClipState | None = None
) -> Generator[FullWindow]:
    """The windows of tracks of another program, by the rule of a clip from pixels.

    Parameters
    ----------
    clip : TrackClip
        The tracks.
    limits : WindowLimits
        How long windows are.
    resumed : ClipState, optional
        From what an interrupted clip goes on.
    """
    index, start = (0, 0) if resumed is None else (resumed.windows, resumed.start)
    shared = 0 if resumed is None else len(resumed.frames)
    builder = WindowBuilder(limits, index, start)
    again = range(start, start + shared)
    builder.begin(clip.frames[start : start + shared], [clip.points_in(f) for f in again], ())
    for number in range(start + shared, len(clip.frames)):
        report(number + 1, len(clip.frames), "frames")
        full = builder.add(clip.frames[number], clip.points_in(number), len(clip.ids))
        if full is not None:
            yield _with_paused(full, clip)
    yield _with_paused(builder.rest(len(clip.ids)), clip)


def _with_paused(window: FullWindow, clip: TrackClip) -> FullWindow:
    stop = window.start + len(window.frames)
    return replace(window, paused=clip.paused(window.start, stop, window.tracks), recent=())
