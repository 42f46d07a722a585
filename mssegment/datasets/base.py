"""The type that every reader returns, the type of a registry entry, and shared checks."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mssegment.datasets.containers import InputFile, Variables
from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.records import (
    LARGEST_COORDINATE,
    LARGEST_LABEL,
    Camera,
    Floats,
    Frame,
    Integers,
    Record,
    Tracks,
)


class ScatteredTracks(Record, frozen=True):
    """Tracks as the list of their visible positions.

    An array has a place for every track in every frame, of which thousands of tracks of some frames
    each, over thousands of frames, fill hardly a hundredth.

    Attributes
    ----------
    where : str
        The file, which opens messages.
    tracks, frames : int
        How many there are.
    row, column : ndarray [n] of int64
        The track and the frame of each position.
    points : ndarray [n, 2]
        The positions in pixels, without NaN.
    labels : ndarray [tracks] of int64, optional
        True labels.
    """

    where: str
    tracks: int
    frames: int
    row: Integers
    column: Integers
    points: Floats
    labels: Integers | None = None

    @classmethod
    def of(cls, tracks: Tracks, where: str) -> ScatteredTracks:
        """The visible positions of an array of tracks."""
        row, column = np.nonzero(tracks.visible)
        count, frames = tracks.points.shape[:2]
        return cls(where, count, frames, row, column, tracks.points[row, column], tracks.labels)

    def dense(self) -> Tracks:
        """The array of all tracks and frames; raises DataError above ``limits.positions``."""
        points = unseen(self.tracks, self.frames, self.where)
        points[self.row, self.column] = self.points
        return Tracks(points, labels=self.labels)

    def check(self) -> None:
        """Validate as ``check_points`` does; raises DataError."""
        _check_counts(self.tracks, self.frames, self.where)
        wild = np.argwhere(np.abs(self.points) > LARGEST_COORDINATE - 1)
        if len(wild):
            position, axis = wild[0]
            value = self.points[position, axis]
            raise _too_far(self.row[position], self.column[position], value, self.where)


class ImportedTracks(Record, frozen=True):
    """Tracks read from a file.

    Attributes
    ----------
    name : str
        The name of the sequence.
    given : Tracks or ScatteredTracks
        The tracks, with true labels if the file has them, as an array [P, F, 2] or as the list of
        the positions that are visible; in pixels, unless ``unit_range`` says that all are in units
        of the image.
    frames : tuple of Frame
        One per frame: the path of the file and the index of the frame in it. If the file does not
        state the size of its images, it is the smallest that contains every point.
    camera : Camera or None
        The calibrated camera, if the file has one.
    group : str
        The part of the data set that the sequence belongs to, as defined by the data set and never
        guessed from the points; empty if there is none.
    pictures : tuple of ndarray [h, w, 3] of uint8
        The images in RGB order, if the file contains them.
    ids : tuple of str, or None
        The identifiers of the tracks in the file; None where it has none.
    notes : tuple of str
        What was assumed and what was ignored, for the user.
    is_upwards : bool
        Whether y counts upwards from the lower edge of the picture, whose height is not known.
    """

    name: str
    given: Tracks | ScatteredTracks
    frames: tuple[Frame, ...]
    camera: Camera | None = None
    group: str = ""
    pictures: tuple[npt.NDArray[np.uint8], ...] = ()
    ids: tuple[str, ...] | None = None
    notes: tuple[str, ...] = ()
    is_upwards: bool = False

    @property
    def tracks(self) -> Tracks:
        """The array of the tracks.

        Raises DataError if it has more positions than ``limits.positions``.
        """
        return self.given.dense() if isinstance(self.given, ScatteredTracks) else self.given

    @property
    def scattered(self) -> ScatteredTracks:
        """The visible positions of the tracks."""
        if isinstance(self.given, ScatteredTracks):
            return self.given
        return ScatteredTracks.of(self.given, self.frames[0].path)

    @property
    def motions(self) -> int:
        """The true number of motions; 0 if there are no true labels."""
        labels = self.given.labels
        return 0 if labels is None else len(np.unique(labels[labels > 0]))


class Published(Record, frozen=True):
    """A published result: the mean misclassification in percent on ``group``, as text."""

    method: str
    group: str
    mean: str
    source: str


class Benchmark(Record, frozen=True):
    """How a data set is run: common settings, settings by group, and published results."""

    settings: dict[str, object]
    by_group: dict[str, dict[str, object]]
    published: tuple[Published, ...]


class DataSet(Record, frozen=True):
    """A data set or file format: how to recognize, read and list its files.

    Attributes
    ----------
    name : str
        The name in ``DATASETS`` and on the command line.
    title : str
        The name in messages and in the documentation, with what a file holds.
    containers : tuple of str
        The kinds of files that it may be in, as in ``containers.CONTAINERS``.
    recognises : callable
        Whether a file has this format, from its content as its container gives it.
    reader : callable
        Reads an opened file and returns ``ImportedTracks``.
    pattern : str
        Glob pattern of the files below the folder of the data set; empty for a plain file format.
    benchmark : Benchmark or None
        How ``mssegment benchmark`` runs the data set; None for a plain file format.
    """

    name: str
    title: str
    containers: tuple[str, ...]
    recognises: Callable[[Variables], bool]
    reader: Callable[[InputFile], ImportedTracks]
    pattern: str = ""
    benchmark: Benchmark | None = None

    def read(self, path: Path | str) -> ImportedTracks:
        """Read a file of this format; raises DataError if that fails."""
        return self.reader(InputFile.opened(path))

    def files(self, folder: Path) -> list[Path]:
        """The files of the data set below ``folder``, sorted by name.

        Raises DataError if ``folder`` is not a folder or has no such files.
        """
        if not folder.is_dir():
            raise DataError(f"{folder}: not a folder; expected the folder that holds {self.title}")
        found = sorted(folder.glob(self.pattern), key=lambda path: path.name)
        if not found:
            raise DataError(
                f"{folder}: no file of {self.title} ({self.pattern}) below it; "
                "expected the folder of the data set as published"
            )
        return found


def frames_inside(
    name: str, content: bytes, indices: Iterable[int], width: int, height: int
) -> tuple[Frame, ...]:
    """The frames with these indices, which exist only inside ``content``, the file ``name``."""
    digest = hashlib.sha256(content).hexdigest()
    return tuple(Frame(name, width, height, digest, index) for index in indices)


def unseen(tracks: int, frames: int, where: str) -> Floats:
    """Positions [P, F, 2] that are all NaN, to be filled.

    Raises DataError above ``limits.positions``; ``where`` opens the message.
    """
    limits.check("positions", tracks * frames, f"{where}: {tracks} tracks over {frames} frames")
    return np.full((tracks, frames, 2), np.nan)


def size_that_holds(points: Floats) -> tuple[int, int]:
    """Width and height of the smallest image, in pixels, that contains all points [..., 2]."""
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
    """Validate true labels.

    Parameters
    ----------
    labels : array_like
        One label per track, of any shape.
    tracks : int
        The number of tracks.
    where : str
        The file and variable, which opens the error message.
    expected : str
        The accepted values, for the error message.

    Returns
    -------
    ndarray [tracks] of int64

    Raises
    ------
    DataError
        If the number of labels differs, or one is not a whole number of at least 0.
    """
    flat = np.asarray(labels).ravel()
    if len(flat) != tracks:
        raise DataError(f"{where}: {len(flat)} labels for {tracks} tracks; expected one per track")
    try:
        numbers = flat.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{where}: the labels are not numbers; expected 0, 1, 2, ...") from error
    whole = np.isfinite(numbers) & (numbers == np.round(numbers)) & (numbers >= 0)
    if not whole.all():
        raise DataError(f"{where}: found {numbers[~whole][0]:g}; expected {expected}")
    if len(numbers) and numbers.max() > LARGEST_LABEL:
        raise DataError(
            f"{where}: found {numbers.max():g}; expected labels up to {LARGEST_LABEL:,}"
        )
    return numbers.astype(np.int64)


def check_points(points: Floats, where: str) -> None:
    """Validate the tracks ``points`` [P, F, 2] in pixels; ``where`` opens the error message.

    Raises DataError unless there are at least one track and two frames, and no coordinate exceeds
    ``LARGEST_COORDINATE``.
    """
    _check_counts(points.shape[0], points.shape[1], where)
    # less than the limit, not equal to it: the frame is one pixel wider than its last position
    wild = np.abs(np.nan_to_num(points, nan=0.0)) > LARGEST_COORDINATE - 1
    if wild.any():
        track, frame, axis = np.argwhere(wild)[0]
        raise _too_far(track, frame, points[track, frame, axis], where)


def _check_counts(tracks: int, frames: int, where: str) -> None:
    if tracks < 1 or frames < 2:
        raise DataError(
            f"{where}: {tracks} track{'s' * (tracks != 1)} over {frames} "
            f"frame{'s' * (frames != 1)}; expected at least 1 track and 2 frames"
        )


def _too_far(track: int, frame: int, value: float, where: str) -> DataError:
    return DataError(
        f"{where}: track {track} is at {value:g} in frame {frame}; expected pixels, less than "
        f"{LARGEST_COORDINATE:g}"
    )


def unit_range(points: Floats) -> tuple[float, float] | None:
    """The least and largest coordinate of ``points`` [..., 2] in units of the image.

    None if they are in pixels: not all between 0 and 1, or all at one place.
    """
    seen = points[np.isfinite(points).all(axis=-1)]
    # a single pixel holds no motion that could be found, so these are no pixels
    if len(seen) > 1 and seen.min() >= 0 and seen.max() <= 1 and np.ptp(seen, axis=0).any():
        return float(seen.min()), float(seen.max())
    return None
