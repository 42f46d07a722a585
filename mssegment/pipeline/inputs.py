"""What a run starts from: frames, tracks of other programs, data that is no picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec
import numpy as np

from mssegment.configuration import Configuration
from mssegment.documents import STANDARD, TracksDocument, read_bytes
from mssegment.history import entry_of
from mssegment.records import Floats, replace

if TYPE_CHECKING:
    from mssegment.datasets import ImportedTracks
    from mssegment.imaging.frames import FrameSource


def open_input(configuration: Configuration) -> FrameSource:
    """Open the frames of ``input.*``; raises DataError like ``imaging.frames.open_frames``."""
    from mssegment.imaging.frames import open_frames

    read = configuration.input
    return open_frames(read.images, read.start, read.stop, read.step)


def import_tracks(path: str, source: FrameSource | None = None) -> TracksDocument:
    """Read tracks that another program wrote.

    Parameters
    ----------
    path : str
        A file of a format in ``datasets``, or ``-`` for standard input.
    source : FrameSource, optional
        The pictures that the tracks were made from.

    Returns
    -------
    TracksDocument
        On these pictures, if they are given.

    Raises
    ------
    DataError
        If the file cannot be read, a frame has no picture, or most positions lie outside them.
    """
    return document_of(read_tracks(path), source)


def read_tracks(path: str) -> ImportedTracks:
    """Read tracks that another program wrote, from a file or ``-``, standard input.

    Raises DataError if it cannot be read.
    """
    from mssegment.datasets import read, read_content

    return read_content(read_bytes(path), "standard input") if path == STANDARD else read(path)


def document_of(found: ImportedTracks, source: FrameSource | None = None) -> TracksDocument:
    """The document of tracks that were read, on the pictures that they were made from.

    Raises DataError if there are too many for an array, a frame has no picture, or most positions
    lie outside them.
    """
    tracks = found.tracks
    points, notes = upright(tracks.points, found, source)
    document = TracksDocument(
        frames=list(found.frames),
        camera=found.camera,
        tracks=replace(tracks, points=points, ids=found.ids),
        history=[entry_of("import", notes=notes)],
    )
    return document if source is None else put_on_pictures(document, source)


def upright(
    points: Floats, found: ImportedTracks, source: FrameSource | None
) -> tuple[Floats, tuple[str, ...]]:
    """Positions [..., 2] with y counted downwards, and the notes of the tracks."""
    if not found.is_upwards:
        return points, found.notes
    if source is None:
        note = "y counts upwards: without --images everything is drawn upside down"
        return points, (*found.notes, note)
    # the lower left corner is 0, 0 there; the centre of the upper left pixel is, here
    return points * [1.0, -1.0] + [-0.5, source.frames[0].height - 0.5], found.notes


def import_points(path: str) -> TracksDocument:
    """Read data that is no picture: a table, a point cloud, matched 3-D points.

    Parameters
    ----------
    path : str
        A table, a NumPy file, PLY, PCD or XYZ; or ``-`` for standard input.

    Returns
    -------
    TracksDocument
        With frames that have no size.

    Raises
    ------
    DataError
        If the file cannot be read.
    """
    from mssegment.datasets.containers import InputFile
    from mssegment.datasets.points import read_points

    file = (
        InputFile("standard input", read_bytes(path))
        if path == STANDARD
        else InputFile.opened(path)
    )
    found = read_points(file)
    return TracksDocument(
        frames=list(found.frames),
        tracks=replace(found.tracks, ids=found.ids),
        history=[entry_of("import", notes=found.notes)],
    )


def put_on_pictures(document: TracksDocument, source: FrameSource) -> TracksDocument:
    """The document with the pictures that its tracks were made from as its frames.

    Raises DataError if a frame has no picture, or most positions lie outside the pictures.
    """
    from mssegment.imaging.backdrop import check_inside, pictures_of_frames

    frames = pictures_of_frames(document.frames, source.frames)
    seen = document.tracks.visible
    notes = check_inside(document.tracks.points[seen], np.nonzero(seen)[1], frames)
    history = list(document.history)
    if notes:
        last = history[-1]
        history[-1] = msgspec.structs.replace(last, notes=(*last.notes, *notes))
    return msgspec.structs.replace(document, frames=frames, history=history)
