"""Tracks as CSV: one match per line, or one observation of a track per line.

The columns are ``x1,y1,x2,y2[,label]`` for matches between two frames, or
``track,frame,x,y[,label]`` for tracks, all in pixels.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    Variables,
    check_labels,
    check_points,
    frames_inside,
    size_that_holds,
)
from mssegment.errors import DataError
from mssegment.records import Floats, Integers, Tracks

MATCHES = ("x1", "y1", "x2", "y2")
SIGHTINGS = ("track", "frame", "x", "y")
LOCATED = ("x", "y", "label")
_FORMATS = "x1,y1,x2,y2[,label] or track,frame,x,y[,label]"


def read_table(path: Path) -> dict[str, Floats]:
    """Read a table of numbers.

    Parameters
    ----------
    path : Path
        A UTF-8 file whose first line names the columns. Fields are separated by commas, semicolons
        (then a comma may be the decimal separator) or tabs.

    Returns
    -------
    dict of str to ndarray [rows] of float64
        The columns by name, in lower case.

    Raises
    ------
    DataError
        If the file cannot be read or a cell is not a finite number; with the line.
    """
    return _columns(_text(_content_of(path), str(path)), str(path))


def _columns(text: str, path: str) -> dict[str, Floats]:
    rows = csv.reader(text.splitlines(), delimiter=(between := _delimiter(text)))
    lines = [(number, row) for number, row in enumerate(rows, 1) if any(map(str.strip, row))]
    if not lines:
        raise DataError(f"{path}: empty; expected a header line such as {_FORMATS}")
    header = [name.strip().lower() for name in lines[0][1]]
    if len(set(header)) != len(header):
        raise DataError(f"{path}: line {lines[0][0]}: two columns have the same name; rename one")
    values = np.empty((len(lines) - 1, len(header)))
    for position, (number, row) in enumerate(lines[1:]):
        if len(row) != len(header):
            raise DataError(f"{path}: line {number}: {len(row)} fields; expected {len(header)}")
        for column, cell in enumerate(row):
            # with semicolons as separators, a comma may be the decimal separator
            own = cell.replace(",", ".") if between == ";" else cell
            values[position, column] = _number(own, path, number, header[column])
    return {name: values[:, column] for column, name in enumerate(header)}


def _content_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file; check the name") from error
    except IsADirectoryError as error:
        raise DataError(f"{path}: this is a folder; expected a CSV file") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error


def _text(content: bytes, path: str) -> str:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: not UTF-8 text; expected a CSV such as {_FORMATS}") from error
    if text.lstrip().startswith("{"):
        raise DataError(
            f"{path}: found JSON; expected a CSV such as {_FORMATS}. A tracks document needs no "
            "import: pass it to `mssegment hypothesize`"
        )
    return text


def _delimiter(text: str) -> str:
    """The separator: whichever of comma, semicolon and tab is most frequent in the header."""
    header = next((line for line in text.splitlines() if line.strip()), "")
    return max(",;\t", key=header.count)


def recognises(columns: Variables) -> bool:
    """Whether the columns are those of a table of tracks."""
    return set(MATCHES) <= set(columns) or set(SIGHTINGS) <= set(columns)


def read(path: Path) -> ImportedTracks:
    """Read a CSV of tracks in either format.

    In the format with one observation per line the frames are the distinct frame numbers, in
    order. Raises DataError as ``read_content`` does, or if the file cannot be read.
    """
    return read_content(_content_of(path), str(path))


def read_content(content: bytes, name: str) -> ImportedTracks:
    """Read a CSV of tracks from its bytes, such as those of standard input.

    Parameters
    ----------
    content : bytes
        The CSV in UTF-8.
    name : str
        The name of the source in error messages and in the frames.

    Returns
    -------
    ImportedTracks

    Raises
    ------
    DataError
        If a column is missing, a cell is not a finite number, or two lines contradict each other.
    """
    columns = _columns(_text(content, name), name)
    if set(MATCHES) <= set(columns):
        points, labels = _read_matches(columns, name)
        numbers = [0, 1]
    elif set(SIGHTINGS) <= set(columns):
        points, labels, numbers = _read_sightings(columns, name)
    else:
        raise DataError(f"{name}: found columns {','.join(columns)}; expected {_FORMATS}")
    check_points(points, name)
    frames = frames_inside(name, content, numbers, *size_that_holds(points))
    return ImportedTracks(Path(name).stem, Tracks(points, labels=labels), frames)


def _read_matches(columns: dict[str, Floats], path: str) -> tuple[Floats, Integers | None]:
    points = np.stack([columns[name] for name in MATCHES], axis=1).reshape(-1, 2, 2)
    if "label" not in columns:
        return points, None
    return points, check_labels(columns["label"], len(points), f"{path}: column 'label'")


def _read_sightings(
    columns: dict[str, Floats], path: str
) -> tuple[Floats, Integers | None, list[int]]:
    keys = {}
    for name in ("track", "frame"):
        keys[name] = check_labels(
            columns[name], len(columns[name]), f"{path}: column '{name}'", "0, 1, 2, ..."
        )
    tracks, row = np.unique(keys["track"], return_inverse=True)
    frames, column = np.unique(keys["frame"], return_inverse=True)
    pairs, first = np.unique(np.stack([row, column]), axis=1, return_index=True)
    if pairs.shape[1] != len(row):
        twice = np.setdiff1d(np.arange(len(row)), first)[0]
        raise DataError(
            f"{path}: track {keys['track'][twice]} has two positions in frame "
            f"{keys['frame'][twice]}; expected one line per track and frame"
        )
    points = np.full((len(tracks), len(frames), 2), np.nan)
    points[row, column] = np.stack([columns["x"], columns["y"]], axis=1)
    labels = None
    if "label" in columns:
        given = check_labels(columns["label"], len(row), f"{path}: column 'label'")
        labels = np.zeros(len(tracks), dtype=np.int64)
        labels[row] = given
        if (labels[row] != given).any():
            wrong = keys["track"][np.flatnonzero(labels[row] != given)[0]]
            raise DataError(f"{path}: track {wrong} has two labels; expected one per track")
    return points, labels, [int(frame) for frame in frames]


def _number(cell: str, path: str, line: int, column: str) -> float:
    try:
        value = float(cell)
    except ValueError as error:
        raise DataError(
            f"{path}: line {line}: '{cell.strip()}' in column '{column}'; expected a number"
        ) from error
    if not np.isfinite(value):
        raise DataError(f"{path}: line {line}: {value} in column '{column}'; expected a number")
    return value


CSV_TRACKS = DataSet("csv", f"a CSV of tracks ({_FORMATS})", ".csv", recognises, read)
