"""Tracks as CSV: a match per line, or a sighting of a track per line; with or without labels."""

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
    frames_of_file,
    size_that_holds,
)
from mssegment.errors import DataError
from mssegment.records import Floats, Integers, Tracks

MATCHES = ("x1", "y1", "x2", "y2")
SIGHTINGS = ("track", "frame", "x", "y")
LOCATED = ("x", "y", "label")
_FORMATS = "x1,y1,x2,y2[,label] or track,frame,x,y[,label]"


def read_table(path: Path) -> dict[str, Floats]:
    """The columns of a CSV file of numbers, by the names in its first line."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise DataError(f"{path}: no such file") from error
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"{path}: cannot be read as text ({error})") from error
    lines = [(number, row) for number, row in enumerate(csv.reader(text.splitlines()), 1) if row]
    if not lines:
        raise DataError(f"{path}: empty; expected a header such as {_FORMATS}")
    header = [name.strip().lower() for name in lines[0][1]]
    if len(set(header)) != len(header):
        raise DataError(f"{path}: line {lines[0][0]}: a column is named twice")
    values = np.empty((len(lines) - 1, len(header)))
    for position, (number, row) in enumerate(lines[1:]):
        if len(row) != len(header):
            raise DataError(f"{path}: line {number}: {len(row)} fields; expected {len(header)}")
        for column, cell in enumerate(row):
            values[position, column] = _number(cell, path, number, header[column])
    return {name: values[:, column] for column, name in enumerate(header)}


def recognises(columns: Variables) -> bool:
    """Whether the named columns are a table of tracks."""
    return set(MATCHES) <= set(columns) or set(SIGHTINGS) <= set(columns)


def read(path: Path) -> ImportedTracks:
    """Read a CSV of tracks, either format; frames are the distinct frame numbers in order."""
    columns = read_table(path)
    if set(MATCHES) <= set(columns):
        points, labels = _read_matches(columns, path)
        numbers = [0, 1]
    elif set(SIGHTINGS) <= set(columns):
        points, labels, numbers = _read_sightings(columns, path)
    else:
        raise DataError(f"{path}: columns {','.join(columns)}; expected {_FORMATS}")
    check_points(points, str(path))
    frames = frames_of_file(path, numbers, *size_that_holds(points))
    return ImportedTracks(path.stem, Tracks(points, labels=labels), frames)


def _read_matches(columns: dict[str, Floats], path: Path) -> tuple[Floats, Integers | None]:
    points = np.stack([columns[name] for name in MATCHES], axis=1).reshape(-1, 2, 2)
    if "label" not in columns:
        return points, None
    return points, check_labels(columns["label"], len(points), f"{path}: column 'label'")


def _read_sightings(
    columns: dict[str, Floats], path: Path
) -> tuple[Floats, Integers | None, list[int]]:
    keys = {}
    for name in ("track", "frame"):
        keys[name] = check_labels(columns[name], len(columns[name]), f"{path}: column '{name}'")
    tracks, row = np.unique(keys["track"], return_inverse=True)
    frames, column = np.unique(keys["frame"], return_inverse=True)
    pairs, first = np.unique(np.stack([row, column]), axis=1, return_index=True)
    if pairs.shape[1] != len(row):
        twice = np.setdiff1d(np.arange(len(row)), first)[0]
        raise DataError(
            f"{path}: track {keys['track'][twice]} is at two places in frame "
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


def _number(cell: str, path: Path, line: int, column: str) -> float:
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
