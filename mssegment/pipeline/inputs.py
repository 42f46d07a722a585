"""What a run starts from: frames, tracks of other programs, data that is no picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from mssegment.configuration import Configuration
from mssegment.documents import STANDARD, TracksDocument, read_bytes
from mssegment.history import entry_of
from mssegment.records import replace

if TYPE_CHECKING:
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
    from mssegment.datasets import read, read_content

    found = read_content(read_bytes(path), "standard input") if path == STANDARD else read(path)
    points, notes = found.tracks.points, found.notes
    if found.is_upwards and source is not None:
        # the lower left corner is 0, 0 there; the centre of the upper left pixel is, here
        points = points * [1.0, -1.0] + [-0.5, source.frames[0].height - 0.5]
    elif found.is_upwards:
        notes += ("y counts upwards: without --images everything is drawn upside down",)
    document = TracksDocument(
        frames=list(found.frames),
        camera=found.camera,
        tracks=replace(found.tracks, points=points, ids=found.ids),
        history=[entry_of("import", notes=notes)],
    )
    return document if source is None else put_on_pictures(document, source)


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
    notes = check_inside(document.tracks.points, frames)
    history = list(document.history)
    if notes:
        last = history[-1]
        history[-1] = msgspec.structs.replace(last, notes=(*last.notes, *notes))
    return msgspec.structs.replace(document, frames=frames, history=history)
