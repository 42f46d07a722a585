"""The measurement matrix W [2F, P] of factorization, with or without its third row of ones.

References
----------
C. Tomasi and T. Kanade, "Shape and motion from image streams under orthography: a factorization
method", IJCV 9, 1992.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    check_points,
    frames_inside,
    size_that_holds,
)
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.records import Floats, Tracks

_NAMES = ("W", "measurements", "measurement_matrix", "measurement")


_FEWEST = 12
"""Columns of a text that can be tracks; lists of boxes have up to ten."""
_SMOOTHER = 0.25
"""Mean square of steps below which the rows of a text are coordinates and not tracks, over that of
the tracks that the rows would be; of tracks that are none it is that of unrelated points."""


def recognises(content: Variables) -> bool:
    """Whether there is a matrix of an even number of rows, named as the measurement matrix is.

    Of a text without names of columns, whether its columns are tracks rather than its rows.
    """
    if isinstance(content, Table):
        return not content.has_header and is_matrix(_numbers(content))
    return _chosen(content) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the matrix; raises DataError if its values are not valid.

    The rows of x and y alternate, or all of x come first. Which of the two is found from the
    values: a track moves little from frame to frame.
    """
    if isinstance(file.variables, Table):
        where, values = file.name, _numbers(file.variables)
    else:
        name = _chosen(file.variables)
        assert name is not None
        where = f"{file.name}: array '{name}'"
        values = np.asarray(file.variables[name], dtype=np.float64)
    if np.isinf(values).any():
        raise DataError(f"{where} holds infinity; expected pixels, NaN where a point is not seen")
    points, in_halves = _tracks(values)
    points[np.isnan(points).any(axis=-1)] = np.nan
    check_points(points, where)
    rows = "all rows of x, then all of y" if in_halves else "rows of x and y in turn"
    shape = f"[{values.shape[0]}, {values.shape[1]}]"
    what = where.removeprefix(f"{file.name}: ") if where != file.name else "matrix"
    return ImportedTracks(
        file.path.stem,
        Tracks(points),
        frames_inside(file.name, file.content, range(len(values) // 2), *size_that_holds(points)),
        notes=(f"{what} {shape}: read as {rows}",),
    )


def is_matrix(values: Floats) -> bool:
    """Whether the columns of a table of numbers [n, m] are tracks, and not its rows."""
    rows, columns = values.shape
    if rows < 4 or rows % 2 or columns < _FEWEST or not np.ptp(values, axis=0).all():
        return False
    as_rows = values[:, : columns // 2 * 2].reshape(rows, -1, 2)
    return _steps(_tracks(values)[0]) < _SMOOTHER * _steps(as_rows)


def _tracks(values: Floats) -> tuple[Floats, bool]:
    """The tracks [P, F, 2] of a matrix, and whether all rows of x come first."""
    frames = len(values) // 2
    alternating = np.moveaxis(values.reshape(frames, 2, -1), -1, 0)
    in_halves = np.moveaxis(values.reshape(2, frames, -1), (2, 1), (0, 1))
    halves = _steps(in_halves) < _steps(alternating)
    return (in_halves if halves else alternating).copy(), halves


def _numbers(table: Table) -> Floats:
    """The cells of a table as numbers [rows, columns], empty where one is text."""
    if not all(table.is_numeric(name) for name in table):
        return np.zeros((0, 0))
    return np.stack([table.numbers(name) for name in table], axis=1)


def _chosen(content: Variables) -> str | None:
    return next((name for name in _NAMES if name in content and _fits(content[name])), None)


def _fits(array: Any) -> bool:
    """Whether an array can be [2F, P] with at least two frames."""
    return (
        isinstance(array, np.ndarray)
        and array.dtype.kind in "fiu"
        and array.ndim == 2
        and array.shape[0] >= 4
        and array.shape[0] % 2 == 0
        and array.shape[1] > 0
    )


def _steps(points: Floats) -> float:
    """Mean square of the steps from frame to frame of tracks [P, F, 2]."""
    squares = np.diff(points, axis=1) ** 2
    seen = np.isfinite(squares)
    return float(np.where(seen, squares, 0.0).sum() / max(int(seen.sum()), 1))


MEASUREMENTS = DataSet(
    "measurements",
    "a measurement matrix W [2 frames, tracks] (.mat, .npz, HDF5, text)",
    ("table", "matlab", "numpy", "hdf5"),
    recognises,
    read,
)
