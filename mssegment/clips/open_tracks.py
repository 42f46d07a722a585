"""Long clips of tracks from what was read: a document, or the file of another program."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import msgspec

from mssegment import pipeline
from mssegment.clips.track_clip import TrackClip
from mssegment.datasets.base import ImportedTracks, ScatteredTracks
from mssegment.documents import TracksDocument
from mssegment.history import entry_of
from mssegment.imaging.backdrop import check_inside, pictures_of_frames
from mssegment.results import is_file_of_tracks

if TYPE_CHECKING:
    from mssegment.imaging.frames import FrameSource


def clip_of_tracks(path: str, found: ImportedTracks, source: FrameSource | None) -> TrackClip:
    """The clip of tracks of another program, on the pictures that they were made from.

    Raises DataError if a frame has no picture, or most positions lie outside them.
    """
    tracks = found.scattered
    frames, sizes = list(found.frames), None
    if source is not None:
        frames = pictures_of_frames(frames, source.frames)
        sizes = pipeline.sizes_of(frames)[tracks.column]
    points, notes = pipeline.in_pixels(tracks.points, found, sizes)
    tracks = msgspec.structs.replace(tracks, points=points)
    if source is not None:
        notes += check_inside(points, tracks.column, frames)
    if tracks.labels is not None:
        notes += (UNUSED_LABELS,)
    return TrackClip.of(
        tracks,
        frames,
        paths=(path, *_pictures(source)),
        on_pictures=source is not None,
        ids=found.ids,
        history=[entry_of("import", notes=notes)],
        camera=found.camera,
    )


def clip_of_document(path: str, document: TracksDocument) -> TrackClip:
    """The clip of a document of tracks, on its pictures where they are there."""
    tracks = document.tracks
    pictures = dict.fromkeys(frame.path for frame in document.frames)
    return TrackClip.of(
        ScatteredTracks.of(tracks, path),
        document.frames,
        paths=(path,),
        on_pictures=not is_file_of_tracks(document) and all(map(os.path.exists, pictures)),
        ids=tracks.ids,
        history=document.history,
        camera=document.camera,
    )


UNUSED_LABELS = "the true labels of the tracks are not compared: windows have motions of their own"


def _pictures(source: FrameSource | None) -> list[str]:
    """The files of the pictures."""
    return [] if source is None else list(dict.fromkeys(frame.path for frame in source.frames))
