"""What every reader of a data set returns, and the checks that all of them share."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.records import LARGEST_COORDINATE, Camera, Floats, Frame, Integers, Record, Tracks

Variables = Mapping[str, Any]
"""The variables of a Matlab file, by name."""


class ImportedTracks(Record, frozen=True):
    """Tracks from a file that somebody else wrote.

    ``name`` is the sequence, ``group`` the part of the data set it belongs to (a fact of the data
    set, never guessed from the points; empty where there is none). ``frames`` name the file itself
    and the frame's number in it; where the file does not say how large its pictures are, the size
    is the smallest that holds every point. ``pictures`` [h, w, 3] uint8 RGB are there where the
    file holds them.
    """

    name: str
    tracks: Tracks
    frames: tuple[Frame, ...]
    camera: Camera | None = None
    group: str = ""
    pictures: tuple[npt.NDArray[np.uint8], ...] = ()

    @property
    def motions(self) -> int:
        """The true number of motions, 0 where there are no true labels."""
        labels = self.tracks.labels
        return 0 if labels is None else len(np.unique(labels[labels > 0]))


class DataSet(Record, frozen=True):
    """One data set or file format: a name, how to know its files, how to read and list them.

    ``recognises`` looks at the variables of a Matlab file, or at the header fields of a CSV;
    ``pattern`` is a glob below the folder of the whole set, empty for a plain file format.
    """

    name: str
    title: str
    suffix: str
    recognises: Callable[[Variables], bool]
    read: Callable[[Path], ImportedTracks]
    pattern: str = ""

    def files(self, folder: Path) -> list[Path]:
        """The files of the set below ``folder``, sorted by name; DataError where there are none."""
        if not folder.is_dir():
            raise DataError(f"{folder}: not a folder; give the folder that holds {self.title}")
        found = sorted(folder.glob(self.pattern), key=lambda path: path.name)
        if not found:
            raise DataError(
                f"{folder}: no file of {self.title} ({self.pattern}) below it; "
                "give the folder of the data set as published"
            )
        return found


def frames_of_file(
    path: Path, indices: Iterable[int], width: int, height: int
) -> tuple[Frame, ...]:
    """The frames with these numbers, which only exist inside the file ``path``."""
    return frames_inside(str(path), path.read_bytes(), indices, width, height)


def frames_inside(
    name: str, content: bytes, indices: Iterable[int], width: int, height: int
) -> tuple[Frame, ...]:
    """The frames with these numbers, which only exist inside ``content``, called ``name``."""
    digest = hashlib.sha256(content).hexdigest()
    return tuple(Frame(name, width, height, digest, index) for index in indices)


def size_that_holds(points: Floats) -> tuple[int, int]:
    """Width and height of the smallest picture with every point [..., 2] in it."""
    seen = points[np.isfinite(points).all(axis=-1)]
    if not len(seen):
        return 1, 1
    width, height = np.floor(seen.max(axis=0) + 0.5).astype(int) + 1
    return max(int(width), 1), max(int(height), 1)


def check_labels(
    labels: npt.ArrayLike,
    tracks: int,
    where: str,
    expected: str = "0 (outlier) or a motion 1, 2, ...",
) -> Integers:
    """Labels as int64 [tracks]; DataError unless they are whole numbers from 0 up."""
    flat = np.asarray(labels).ravel()
    if len(flat) != tracks:
        raise DataError(f"{where}: {len(flat)} labels for {tracks} tracks; expected one per track")
    try:
        numbers = flat.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{where}: labels are not numbers; expected 0, 1, 2, ...") from error
    whole = np.isfinite(numbers) & (numbers == np.round(numbers)) & (numbers >= 0)
    if not whole.all():
        raise DataError(f"{where}: found {numbers[~whole][0]:g}; expected {expected}")
    return numbers.astype(np.int64)


def check_points(points: Floats, where: str) -> None:
    """DataError unless [P, F, 2] of pixels with at least one track and two frames."""
    tracks, frames = points.shape[:2]
    if tracks < 1 or frames < 2:
        raise DataError(f"{where}: {tracks} tracks in {frames} frames; expected at least 1 and 2")
    wild = np.abs(np.nan_to_num(points, nan=0.0)) > LARGEST_COORDINATE
    if wild.any():
        track, frame, axis = np.argwhere(wild)[0]
        raise DataError(
            f"{where}: track {track} is at {points[track, frame, axis]:g} in frame {frame}; "
            f"expected pixels, at most {LARGEST_COORDINATE:g}"
        )
