"""Tables that pandas keeps in HDF5 (``DataFrame.to_hdf``), as DeepLabCut and trackpy write them.

In the format ``fixed`` the values are in blocks, each with the names of its columns; in the format
``table`` there are rows, and ``foreign_reader`` adds the names, which stand outside of them.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mssegment.datasets.table_forms import STACKED
from mssegment.datasets.tables import Table
from mssegment.errors import DataError

if TYPE_CHECKING:
    from mssegment.datasets.containers import InputFile

Columns = dict[str, list[str]]


def frames_of(variables: Mapping[str, Any], path: str = "") -> dict[str, Columns]:
    """The columns of each data frame among the variables of an HDF5 file, by its name.

    Raises DataError for a column of pickled text.
    """
    found: dict[str, Columns] = {}
    for name, value in variables.items():
        if isinstance(value, dict):
            columns = _columns(value)
            if columns:
                found[path + name] = columns
            else:
                found |= frames_of(value, f"{path}{name}/")
    return found


def read_frames(frames: dict[str, Columns], file: InputFile) -> Table:
    """The data frame of a file, the one that ``FILE#NAME`` names, or all, one below the other.

    Raises DataError where several have other columns, or there is none of the name.
    """
    if file.member:
        frames = {name: own for name, own in frames.items() if name == file.member.strip("/")}
    columns = [list(own) for own in frames.values()]
    if not columns or any(own != columns[0] for own in columns):
        raise DataError(
            f"{file.name}: not one data frame of pandas; name one as {file.name}#NAME, "
            f"NAME one of {', '.join(frames) or 'those in the file'}"
        )
    ordered = sorted(frames, key=_numbers_in)
    joined = {
        column: [cell for name in ordered for cell in frames[name][column]] for column in columns[0]
    }
    rows = len(next(iter(joined.values())))
    return Table(file.name, joined, range(1, rows + 1))


def _numbers_in(name: str) -> tuple[list[int], str]:
    """The order in which trackpy numbers its frames: ``Frame_2`` before ``Frame_10``."""
    return [int(number) for number in re.findall(r"\d{1,18}", name)], name


def _columns(group: Mapping[str, Any]) -> Columns:
    """The columns of a data frame by name, in lower case; empty if the group is none.

    Raises DataError for a column of pickled text.
    """
    rows = group.get("table")
    blocks = rows if isinstance(rows, dict) else group
    found: dict[str, npt.NDArray[Any]] = {}
    for name, values in blocks.items():
        if not isinstance(values, np.ndarray) or name.endswith("_items"):
            continue
        names = _names(blocks, name.removesuffix("_values"))
        if names and values.dtype.kind not in "biufSU":
            raise DataError(
                f"the column {names[0]} of a table of pandas holds text in Python's own form, "
                'which is not read; write it with to_hdf(..., format="table"), or with to_csv'
            )
        if names and values.ndim == 2 and values.shape[1] == len(names):
            found |= dict(zip(names, values.T, strict=True))
        elif names and values.ndim == 1 and len(names) == 1:
            found[names[0]] = values
    names = _without_shared(list(found))
    return {
        name.lower(): [_cell(value) for value in values.tolist()]
        for name, values in zip(names, found.values(), strict=True)
    }


def _names(blocks: Mapping[str, Any], block: str) -> list[str]:
    """The names of the columns of a block, their levels parted by tabs; empty if it has none."""
    items = blocks.get(f"{block}_items")
    if isinstance(items, np.ndarray) and items.ndim == 1:
        return [_cell(name) for name in items.tolist()]
    levels: list[list[str]] = []
    while isinstance(own := blocks.get(f"{block}_items_level{len(levels)}"), np.ndarray):
        place = blocks.get(f"{block}_items_label{len(levels)}")
        if not _are_places(place, own):
            return []
        levels.append([_cell(name) for name in own[place].tolist()])
    return ["\t".join(parts) for parts in zip(*levels, strict=True)]


def _are_places(place: Any, values: npt.NDArray[Any]) -> bool:
    """Whether ``place`` is a list of places in the list ``values``."""
    if not isinstance(place, np.ndarray) or place.dtype.kind not in "iu":
        return False
    inside = (place >= 0) & (place < len(values))
    return place.ndim == values.ndim == 1 and bool(inside.all())


def _without_shared(names: list[str]) -> list[str]:
    """Names of several levels without a first one that all share, such as DeepLabCut's scorer."""
    split = [name.split("\t") for name in names]
    if len({own[0] for own in split}) == 1 and min(map(len, split), default=0) > 2:
        split = [own[1:] for own in split]
    return [STACKED.join(own) for own in split]


def _cell(value: Any) -> str:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return "" if value is None or value != value else str(value)
