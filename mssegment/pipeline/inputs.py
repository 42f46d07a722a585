"""What a run starts from: frames, tracks of other programs, data that is no picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from mssegment.configuration import Configuration
from mssegment.documents import STANDARD, TracksDocument, read_bytes
from mssegment.errors import DataError
from mssegment.history import entry_of
from mssegment.imaging.backdrop import check_inside, pictures_of_frames
from mssegment.records import Floats, Frame, replace

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
    sizes = None
    if source is not None:
        sizes = sizes_of(pictures_of_frames(found.frames, source.frames))
    points, notes = in_pixels(tracks.points, found, sizes)
    document = TracksDocument(
        frames=list(found.frames),
        camera=found.camera,
        tracks=replace(tracks, points=points, ids=found.ids),
        history=[entry_of("import", notes=notes)],
    )
    return document if source is None else put_on_pictures(document, source)


def in_pixels(
    points: Floats, found: ImportedTracks, sizes: Floats | None
) -> tuple[Floats, tuple[str, ...]]:
    """Positions in pixels from the centre of the upper left one, and the notes of the tracks.

    Parameters
    ----------
    points : ndarray [..., 2]
        Positions as the file has them: perhaps in units of the picture, or with y upwards.
    found : ImportedTracks
        What was read.
    sizes : ndarray [..., 2], optional
        Width and height of the picture of each position, where the pictures are given.

    Raises
    ------
    DataError
        If the positions are in units of a picture whose size is not known.
    """
    from mssegment.datasets.base import unit_range

    notes, unit = found.notes, unit_range(points)
    if unit is not None:
        low, high = (f"{value:.2g}" for value in unit)
        said = f"all positions lie between {low} and {high}, in units of the image"
        if sizes is None:
            raise DataError(
                f"{found.frames[0].path}: {said}; expected pixels: name the pictures with "
                "--images, or multiply x by the width and y by the height"
            )
        points, notes = points * sizes, (*notes, f"{said}: multiplied by its width and height")
    if found.is_upwards:
        if sizes is None:
            note = "y counts upwards: without --images everything is drawn upside down"
            return points, (*notes, note)
        points = np.stack([points[..., 0], sizes[..., 1] - points[..., 1]], axis=-1)
    # a corner of the picture is 0, 0 there; the centre of the upper left pixel is, here
    from_corner = unit is not None or found.is_upwards
    return points - 0.5 if from_corner else points, notes


def sizes_of(pictures: Sequence[Frame]) -> Floats:
    """Width and height of each picture, [F, 2]."""
    return np.array([[picture.width, picture.height] for picture in pictures], dtype=np.float64)


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
    frames = pictures_of_frames(document.frames, source.frames)
    seen = document.tracks.visible
    notes = check_inside(document.tracks.points[seen], np.nonzero(seen)[1], frames)
    history = list(document.history)
    if notes:
        last = history[-1]
        history[-1] = msgspec.structs.replace(last, notes=(*last.notes, *notes))
    return msgspec.structs.replace(document, frames=frames, history=history)
