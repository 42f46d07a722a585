"""Trajectories of a finished clip for other tools, written frame by frame."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from mssegment.clips.frames import ClipFrame, frames_of
from mssegment.clips.store import ClipStore
from mssegment.documents.clips import ClipDocument
from mssegment.errors import UsageError
from mssegment.records import Floats
from mssegment.rendering.csv_text import neutral
from mssegment.rendering.regions import not_isolated

TRACKS_HEADER = ("id", "frame", "x", "y", "motion")
OBJECTS_HEADER = (
    "frame",
    "motion",
    "resting",
    "x_min",
    "y_min",
    "x_max",
    "y_max",
    "centroid_x",
    "centroid_y",
    "tracks",
)


def write_exports(
    document: ClipDocument, store: ClipStore, names: Sequence[str], folder: Path
) -> list[str]:
    """Write files of some formats; their names."""
    rows = {"tracks": _track_rows, "objects": _object_rows, "mot": _mot_rows}
    written = []
    for name in dict.fromkeys(names):
        file = "mot.txt" if name == "mot" else f"{name}.csv"
        try:
            with (folder / file).open("w", newline="", encoding="utf-8") as out:
                writer = csv.writer(out, lineterminator="\n")
                writer.writerows(rows[name](document, store))
                out.flush()
                os.fsync(out.fileno())
        except OSError as error:
            raise UsageError(f"{file}: cannot be written ({error.strerror})") from None
        written.append(file)
    return written


def _numbered(document: ClipDocument, store: ClipStore) -> Iterator[tuple[int, ClipFrame]]:
    """The frames, with the numbers that they have in their source."""
    for frame in frames_of(store, len(document.windows)):
        yield document.number(frame.number), frame


def _track_rows(document: ClipDocument, store: ClipStore) -> Iterator[Sequence[object]]:
    yield TRACKS_HEADER
    names = [neutral(name) for name in document.ids]
    for number, frame in _numbered(document, store):
        for track, (x, y), identity in zip(
            frame.tracks.tolist(), frame.points.tolist(), frame.identities.tolist(), strict=True
        ):
            yield names[track] if names else track, number, round(x, 3), round(y, 3), identity


def sightings(frame: ClipFrame) -> Iterator[tuple[int, Floats]]:
    """The objects of a frame, and the positions of their tracks without those far from all others.

    The static world, identity 0, is none of them.
    """
    for identity in np.unique(frame.identities[frame.identities > 0]).tolist():
        points = frame.points[frame.identities == identity]
        points = points[not_isolated(points)]
        if len(points):
            yield identity, points


def box_of(points: Floats) -> tuple[float, float, float, float]:
    """The box of an object in a frame: left, top, width, height in pixels.

    Tracks do not reach the border. Of n uniformly distributed points the range is on average
    (n - 1) / (n + 1) of the side, so that 1 / (n - 1) of the range is missing at each end.

    Examples
    --------
    >>> import numpy as np
    >>> box_of(np.array([[0.0, 0.0], [5.0, 2.0], [10.0, 8.0]]))
    (-5.0, -4.0, 20.0, 16.0)
    """
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = (high - low) / max(len(points) - 1, 1)
    (left, top), (wide, tall) = low - beyond, high - low + 2 * beyond
    return float(left), float(top), float(wide), float(tall)


def _object_rows(document: ClipDocument, store: ClipStore) -> Iterator[Sequence[object]]:
    yield OBJECTS_HEADER
    for number, frame in _numbered(document, store):
        for identity, points in sightings(frame):
            box = (*points.min(axis=0), *points.max(axis=0), *points.mean(axis=0))
            rounded = (round(float(value), 3) for value in box)
            yield number, identity, int(identity in frame.resting), *rounded, len(points)


def _mot_rows(document: ClipDocument, store: ClipStore) -> Iterator[Sequence[object]]:
    """``frame,id,left,top,width,height,confidence,x,y,z``; frames and pixels count from 1."""
    for frame in frames_of(store, len(document.windows)):
        for identity, points in sightings(frame):
            left, top, wide, tall = box_of(points)
            box = (left + 1, top + 1, wide, tall)
            yield frame.number + 1, identity, *(f"{value:.2f}" for value in box), 1, -1, -1, -1
