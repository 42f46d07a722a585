"""What the readers of tables share: labels, identifiers of tracks and frames, visibility."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

import numpy as np
import numpy.typing as npt

from mssegment.datasets.base import check_labels
from mssegment.datasets.columns import CONFIDENCE, OCCLUDED, VISIBLE, first_of
from mssegment.datasets.tables import Table, is_missing, number_of
from mssegment.errors import DataError
from mssegment.records import Integers

LIKELY = 0.5
"""A position that its tracker thinks rather wrong than right (a probability) is not used."""
_TRUE = frozenset({"true", "t", "yes", "y", "1"})
_FALSE = frozenset({"false", "f", "no", "n", "0"})


def labels_of(table: Table, name: str | None, path: str) -> tuple[Integers | None, tuple[str, ...]]:
    """The true labels in a column, and notes on them.

    Parameters
    ----------
    table : Table
        The table.
    name : str or None
        The column.
    path : str
        The name of the file, for errors.

    Returns
    -------
    labels : ndarray [rows] of int64, or None
        None if there is no such column, or it holds text. -1 and empty cells are outliers, as
        clustering programs write them.
    notes : tuple of str

    Raises
    ------
    DataError
        For a number that is no label.
    """
    if name is None or not table.is_numeric(name):
        return None, ()
    values = table.numbers(name)
    noise = np.isnan(values) | (values == -1)
    notes: tuple[str, ...] = ()
    if noise.any():
        values = np.where(noise, 0.0, values)
        notes = (f"{int(noise.sum())} labels are -1 or empty: read as 0, outlier",)
    return check_labels(values, len(values), f"{path}: column '{name}'"), notes


def ignored_columns(table: Table, used: Collection[str | None]) -> tuple[str, ...]:
    """A note that names the columns that are not used, if there are any."""
    rest = [name for name in table if name not in used]
    if not rest:
        return ()
    shown = ", ".join(rest[:8]) + (f" and {len(rest) - 8} more" if len(rest) > 8 else "")
    return (f"column{'s' * (len(rest) > 1)} ignored: {shown}",)


def natural_key(text: str) -> list[tuple[int, int, str]]:
    """Sort key that compares numbers inside names by value."""
    parts = re.split(r"(\d+)", text)
    return [(1, int(p), p) if p.isdecimal() else (0, 0, p) for p in parts]


def keys_of(cells: Sequence[str]) -> list[str]:
    """Cells as identifiers: whole numbers that are written as ``3.0`` become ``3``."""
    short = {}
    for cell in set(cells):
        text = cell.strip()
        short[cell] = re.sub(r"^([-+]?\d+)[.,]0*$", r"\1", text)
    return [short[cell] for cell in cells]


def in_order(keys: Collection[str]) -> list[str]:
    """Distinct identifiers in order: by value if they are numbers, otherwise as file names are."""
    values = {key: number_of(key) for key in keys}
    if all(np.isfinite(value) for value in values.values()):
        whole = all(re.fullmatch(r"[-+]?\d+", key) for key in values)
        return sorted(values, key=int if whole else values.__getitem__)
    return sorted(values, key=natural_key)


def seen_by_columns(table: Table) -> tuple[npt.NDArray[np.bool_], set[str], tuple[str, ...]]:
    """Which rows are visible by the columns visible, occluded and confidence.

    Returns
    -------
    seen : ndarray [rows] of bool
    used : set of str
        The columns that were used.
    notes : tuple of str
    """
    seen = np.ones(table.rows, dtype=bool)
    used: set[str] = set()
    notes = []
    for names, hides in ((VISIBLE, False), (OCCLUDED, True)):
        name = first_of(table, names)
        if name is not None:
            seen &= _flags(table, name) != hides
            used.add(name)
            notes.append(name)
    name = first_of(table, CONFIDENCE)
    if name is not None and table.is_numeric(name):
        values = table.numbers(name)
        if np.nanmin(values, initial=1) >= 0 and np.nanmax(values, initial=0) <= 1:
            seen &= ~(values < LIKELY)
            used.add(name)
            notes.append(f"{name} below {LIKELY:g}")
    hidden = int((~seen).sum())
    if not hidden:
        return seen, used, ()
    return seen, used, (f"{hidden} of {len(seen)} positions are not visible ({', '.join(notes)})",)


def _flags(table: Table, name: str) -> npt.NDArray[np.bool_]:
    """A column of truth values: 0 and 1, true and false, or a probability."""
    flags = np.empty(table.rows, dtype=bool)
    for i, cell in enumerate(table[name]):
        word = cell.strip().lower()
        value = number_of(word)
        if word in _TRUE or word in _FALSE:
            flags[i] = word in _TRUE
        elif is_missing(cell):
            flags[i] = False
        elif 0 <= value <= 1:
            flags[i] = value >= LIKELY
        else:
            raise DataError(
                f"{table.name}: line {table.lines[i]}: '{word}' in column '{name}'; expected 0 or 1"
            )
    return flags
