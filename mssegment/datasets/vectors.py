"""Vectors named like the columns of a table: Matlab variables, npz arrays, JSON records."""

from __future__ import annotations

from typing import Any

import numpy as np

from mssegment.datasets import matches, sightings
from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.json_tables import columns_of
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.inputs import limits

RECOGNISED_ROWS = 1000
"""Rows from which the columns are recognised."""
BYTES_OF_CELL = 20
"""Of the text of a number."""


def recognises(content: Variables) -> bool:
    """Whether vectors or records have the names of the columns of a table of tracks."""
    table = _table(content, "", RECOGNISED_ROWS)
    return table is not None and (matches.recognises(table) or sightings.recognises(table))


def read(file: InputFile) -> ImportedTracks:
    """Read vectors as a table is read; raises DataError if a value is not valid."""
    table = _table(file.variables, file.name)
    if table is None:
        raise DataError(f"{file.name}: no vectors of one length; expected x1, y1, x2, y2")
    if matches.recognises(table):
        return matches.read_matches(table, file)
    return sightings.read_sightings(table, file)


def _table(content: Variables, name: str, most: int | None = None) -> Table | None:
    """The vectors of one length as the text of a table, or its first rows, at ``most`` so many.

    Raises DataError if the text is longer than ``limits.text_bytes``.
    """
    listed = {} if _has_arrays(content) else columns_of(content)
    if listed:
        columns = {key: [_cell(value) for value in cells] for key, cells in listed.items()}
    else:
        vectors = {key: value for key, value in content.items() if _is_vector(value)}
        lengths = [_size(value) for value in vectors.values()]
        usual = max(set(lengths), key=lengths.count, default=0)
        vectors = {key: value for key, value in vectors.items() if _size(value) == usual > 1}
        if most is None:
            text = BYTES_OF_CELL * usual * len(vectors)
            limits.check("text_bytes", text, f"{name}: {len(vectors)} vectors of {usual} values")
        columns = {key: _cells(value, most) for key, value in vectors.items()}
    if not columns:
        return None
    lower = {key.lower(): cells for key, cells in columns.items()}
    return Table(name, lower, range(1, len(next(iter(lower.values()))) + 1))


def _has_arrays(content: Variables) -> bool:
    """Whether the file is none of JSON: arrays have no records in them."""
    return any(isinstance(value, np.ndarray) for value in content.values())


def _is_vector(value: Any) -> bool:
    if isinstance(value, list):
        return not any(isinstance(part, list | dict) for part in value)
    return isinstance(value, np.ndarray) and value.dtype.kind in "biufUS" and _long(value.shape)


def _long(shape: tuple[int, ...]) -> bool:
    return len([n for n in shape if n != 1]) <= 1 and bool(shape)


def _size(value: Any) -> int:
    return len(value) if isinstance(value, list) else int(value.size)


def _cells(value: Any, most: int | None) -> list[str]:
    parts = value[:most] if isinstance(value, list) else value.ravel()[:most].tolist()
    return [_cell(part) for part in parts]


def _cell(value: Any) -> str:
    if value is None:
        return ""
    return repr(value) if isinstance(value, float) else str(value)


VECTORS = DataSet(
    "vectors",
    "vectors named x1, y1, x2, y2 or track, frame, x, y (.mat, .npz, JSON, HDF5)",
    ("matlab", "numpy", "json", "hdf5", "yaml"),
    recognises,
    read,
)
