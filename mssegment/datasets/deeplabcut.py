"""DeepLabCut: a row per frame, and columns x, y, likelihood of each body part."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    check_points,
    frames_inside,
    size_that_holds,
)
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.table_forms import STACKED
from mssegment.datasets.tables import Table
from mssegment.datasets.track_columns import LIKELY
from mssegment.errors import DataError
from mssegment.records import Tracks


def recognises(columns: Variables) -> bool:
    """Whether the columns have stacked names that end in x, y and likelihood."""
    names = [name.split(STACKED) for name in columns if STACKED in name]
    return isinstance(columns, Table) and {"x", "y"} <= {name[-1] for name in names}


def read(file: InputFile) -> ImportedTracks:
    """Read the positions of the body parts; those less likely than not are not visible.

    Raises DataError if a value is not valid.
    """
    table = file.variables
    assert isinstance(table, Table)
    parts = [name.rpartition(STACKED)[0] for name in table if name.endswith(f"{STACKED}x")]
    alone = next((part for part in parts if f"{part}{STACKED}y" not in table), None)
    if alone is not None:
        name = alone.replace(STACKED, " ")
        raise DataError(f"{file.name}: {name} has x without y; export the table again")
    points = np.stack(
        [
            np.stack([table.numbers(f"{part}{STACKED}{axis}") for axis in "xy"], axis=-1)
            for part in parts
        ]
    )
    hidden: npt.NDArray[np.bool_] = np.asarray(np.isnan(points).any(axis=-1))
    for row, part in enumerate(parts):
        name = f"{part}{STACKED}likelihood"
        if name in table:
            hidden[row] |= ~(table.numbers(name) >= LIKELY)
    points[hidden] = np.nan
    check_points(points, file.name)
    count = int(hidden.sum())
    why = f"empty, or likelihood below {LIKELY:g}"
    note = f"{count} of {hidden.size} positions are not visible ({why})"
    return ImportedTracks(
        file.path.stem,
        Tracks(points),
        frames_inside(file.name, file.content, range(points.shape[1]), *size_that_holds(points)),
        ids=tuple(part.replace(STACKED, " ") for part in parts),
        notes=(note,) if count else (),
    )


DEEPLABCUT = DataSet(
    "deeplabcut", "DeepLabCut, CSV or HDF5 (body parts as tracks)", ("table",), recognises, read
)
