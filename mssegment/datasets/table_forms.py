"""Forms of tables: names of columns over several lines, and positions in one cell."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

STACKED = "|"
"""Between the parts of a name of a column that stands in several lines."""
_LEVELS = 4
"""Lines of names that are looked for."""
_COORDINATES = frozenset(("x", "y", "z", "likelihood", "score", "confidence", "visible"))
_PAIR = re.compile(r"\s*[(\[]\s*([^\s,;()\[\]]+)\s*[,;\s]\s*([^\s,;()\[\]]+)\s*[)\]]\s*")
_SHOWN = 50
"""Cells from which it is seen whether a column holds pairs."""

Rows = list[tuple[int, list[str]]]
"""The lines of a table with their numbers."""


def unstacked(rows: Rows) -> Rows:
    """Several lines of names as one, their parts joined by ``STACKED``.

    The last of the lines has nothing but x, y and the like: those of DeepLabCut (scorer, body part,
    coordinate), or of pandas where columns have levels, which has one more line for the name of the
    index. A first part of three that all share, such as the scorer, is left out.
    """
    last = next((i for i, (_, row) in enumerate(rows[:_LEVELS]) if _are_coordinates(row)), 0)
    if last == 0:
        return rows
    levels = [[cell.strip() for cell in row] for _, row in rows[: last + 1]]
    start = next((i for i, cell in enumerate(levels[last]) if _is_coordinate(cell)), 1)
    body = rows[last + 1 :]
    if body and not any(cell.strip() for cell in body[0][1][start:]):
        body = body[1:]  # the name of the index
    is_shared = len(levels) > 2 and len(set(levels[0][start:])) == 1
    names = [STACKED.join(parts) for parts in zip(*levels[is_shared:], strict=False)]
    # labelled pictures of DeepLabCut have their folder, clip and name in three columns
    index = ["folder", "clip", "frame"][-start:] if start <= 3 else names[:start]
    return [(rows[last][0], [*index, *names[start:]]), *body]


def _are_coordinates(row: Sequence[str]) -> bool:
    """Whether a line names nothing but coordinates, from its second, third or fourth cell on."""
    cells = [cell.strip().lower() for cell in row[1:]]
    named = [cell for cell in cells if cell]
    return {"x", "y"} <= set(named) and set(named) <= _COORDINATES and len(named) > 2


def _is_coordinate(cell: str) -> bool:
    return cell.strip().lower() in _COORDINATES


def with_pairs_parted(columns: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """The columns, those of cells such as ``(102.4, 88.0)`` as two: x and y, or x1, y1, x2, y2."""
    pairs = [name for name, cells in columns.items() if _holds_pairs(cells)]
    if not pairs or {"x", "y"} & set(columns):
        return dict(columns)
    found: dict[str, list[str]] = {}
    for name, cells in columns.items():
        if name not in pairs:
            found[name] = cells
            continue
        parts = [_PAIR.fullmatch(cell) for cell in cells]
        number = str(pairs.index(name) + 1) if len(pairs) > 1 else ""
        for group, axis in enumerate("xy", start=1):
            found[f"{axis}{number}"] = [part[group] if part else "" for part in parts]
    return found


def is_pair(cell: str) -> bool:
    """Whether a cell holds two values in brackets, such as ``(102.4, 88.0)``."""
    return _PAIR.fullmatch(cell) is not None


def _holds_pairs(cells: Sequence[str]) -> bool:
    """Whether every cell is a pair or empty; the first ones decide quickly that it is not."""
    given = [cell for cell in cells[:_SHOWN] if cell.strip()]
    if not given or not all(map(is_pair, given)):
        return False
    return all(not cell.strip() or is_pair(cell) for cell in cells[_SHOWN:])
