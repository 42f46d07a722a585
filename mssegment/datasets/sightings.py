"""Tables with one position of a track per line: ``track,frame,x,y[,label]`` under many names."""

from __future__ import annotations

from pathlib import PurePath

import numpy as np
import numpy.typing as npt

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    ScatteredTracks,
    frames_inside,
    size_that_holds,
)
from mssegment.datasets.columns import HEIGHT, LABEL, WIDTH, Sightings, first_of, sightings_of
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.matches import is_sighting_like
from mssegment.datasets.tables import Table, is_missing, number_of
from mssegment.datasets.track_columns import (
    ignored_columns,
    in_order,
    keys_of,
    labels_of,
    seen_by_columns,
)
from mssegment.errors import DataError
from mssegment.records import Floats, Integers

DIGITS = 15
"""Numbers of more digits are times, such as nanoseconds since 1970, and no numbers of frames."""
_UNNAMED = ("track", "frame", "x", "y")


def recognises(columns: Variables) -> bool:
    """Whether the columns are a track, a frame and a position."""
    if not isinstance(columns, Table):
        return False
    return sightings_of(_named(columns)) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read a table with one position per line; raises DataError if a value is not valid."""
    table = file.variables
    assert isinstance(table, Table)
    return read_sightings(table, file)


def read_sightings(table: Table, file: InputFile) -> ImportedTracks:
    """Tracks from a table with one position per line.

    The frames are the distinct values of their column: numbers, times, or names of files. A
    position without a value is not visible, and neither is one that a column says is hidden.

    Raises DataError if a value is not valid, or a track has two positions in one frame.
    """
    notes = () if table.has_header else (f"no names of columns: read as {','.join(_UNNAMED)}",)
    table = _named(table)
    columns = sightings_of(table)
    assert columns is not None
    table, dropped = _without_headings(table, columns)
    seen, hiding, hidden_notes = seen_by_columns(table)
    track, frame = keys_of(table[columns.track]), keys_of(table[columns.frame])
    x, y = _position(table, columns.x), _position(table, columns.y)
    x[~seen] = y[~seen] = np.nan
    ids, row = _numbered(track)
    names, column = _numbered(frame)
    _check_unique(row, column, ids, names, file.name)
    label = first_of(table, LABEL)
    given, label_notes = labels_of(table, label, file.name)
    visible = ~np.isnan(x) & ~np.isnan(y)
    tracks = ScatteredTracks(
        file.name,
        len(ids),
        len(names),
        row[visible],
        column[visible],
        np.stack([x, y], axis=1)[visible],
        None if given is None else _label_per_track(given, row, ids, file.name),
    )
    tracks.check()
    used = columns.used | hiding | ({label} if given is not None else set())
    indices, frame_notes = _frame_numbers(names, columns.frame)
    return ImportedTracks(
        file.path.stem,
        tracks,
        frames_inside(file.name, file.content, indices, *size_that_holds(tracks.points)),
        ids=tuple(ids),
        notes=(
            *notes,
            *dropped,
            *hidden_notes,
            *_box_note(table, columns),
            *frame_notes,
            *label_notes,
            *ignored_columns(table, used),
        ),
    )


def _box_note(table: Table, columns: Sightings) -> tuple[str, ...]:
    """A note on x, y beside a size, which some programs mean as the corner of a box."""
    has_size = first_of(table, WIDTH) is not None and first_of(table, HEIGHT) is not None
    if not has_size or (columns.x, columns.y) != (("x",), ("y",)):
        return ()
    return ("x, y are taken as they stand, and not as the corner of a box of width and height",)


def _named(table: Table) -> Table:
    """The table, with names if it has none and looks like track, frame, x, y."""
    if table.has_header or len(table) not in (4, 5):
        return table
    first, *rest = list(table)[:4]
    if not all(table.is_numeric(name) for name in rest):
        return table
    is_text = all(np.isnan(number_of(cell)) and not is_missing(cell) for cell in table[first])
    if not is_text and not table.is_numeric(first):
        return table
    # names of tracks count as numbers in the order of their appearance
    places = {cell: float(i) for i, cell in enumerate(dict.fromkeys(table[first]))}
    keys = np.array([places[c] for c in table[first]]) if is_text else table.numbers(first)
    values = np.stack([keys, *(table.numbers(name) for name in rest)], axis=1)
    if not is_sighting_like(values):
        return table
    names = list(_UNNAMED)
    if (
        not is_text
        and len(np.unique(values[:, 0])) < len(np.unique(values[:, 1]))
        and _runs(values[:, 0])
    ):
        names[:2] = ["frame", "track"]  # sorted by frame, as detectors write
    return table.renamed([*names, "column 5"][: len(table)])


def _runs(values: Floats) -> bool:
    """Whether equal values stand together, in increasing order."""
    return bool((np.diff(values) >= 0).all())


def _without_headings(table: Table, columns: Sightings) -> tuple[Table, tuple[str, ...]]:
    """Drop further lines of headings (TrackMate has three), and positions without a track."""
    wanted = [name.lstrip("+") for name in (*columns.x, *columns.y)]
    headings = []
    for i in range(min(table.rows, 8)):
        cells = [table[name][i] for name in wanted]
        if not all(is_missing(cell) or _is_words(cell) for cell in cells):
            break
        if all(is_missing(cell) for cell in cells):
            break
        headings.append(i)
    table = table.without(headings)
    alone = [i for i, cell in enumerate(table[columns.track]) if _is_none(cell)]
    if not alone:
        return table, ()
    return table.without(alone), (f"{len(alone)} positions belong to no track: left out",)


def _is_none(cell: str) -> bool:
    """Whether a tracker says that a position belongs to no track."""
    return is_missing(cell) or number_of(cell) == -1


def _is_words(cell: str) -> bool:
    return bool(np.isnan(number_of(cell))) and any(map(str.isalpha, cell))


def _position(table: Table, names: tuple[str, ...]) -> Floats:
    """One coordinate: a column, or the middle of a box."""
    first = table.numbers(names[0])
    if len(names) == 1:
        return first.copy()
    second = table.numbers(names[1].lstrip("+"))
    return first + second / 2 if names[1].startswith("+") else (first + second) / 2


def _numbered(keys: list[str]) -> tuple[list[str], npt.NDArray[np.intp]]:
    """The distinct identifiers in order, and the place of each row among them."""
    distinct = in_order(set(keys))
    place = {key: i for i, key in enumerate(distinct)}
    return distinct, np.array([place[key] for key in keys], dtype=np.intp)


def _check_unique(
    row: npt.NDArray[np.intp],
    column: npt.NDArray[np.intp],
    ids: list[str],
    names: list[str],
    path: str,
) -> None:
    _, first = np.unique(row * len(names) + column, return_index=True)
    if len(first) != len(row):
        twice = np.setdiff1d(np.arange(len(row)), first)[0]
        raise DataError(
            f"{path}: track {ids[row[twice]]} has two positions in frame {names[column[twice]]}; "
            "expected one line per track and frame"
        )


def _label_per_track(
    given: Integers, row: npt.NDArray[np.intp], ids: list[str], path: str
) -> Integers:
    labels = np.zeros(len(ids), dtype=np.int64)
    labels[row] = given
    if (labels[row] != given).any():
        wrong = ids[row[np.flatnonzero(labels[row] != given)[0]]]
        raise DataError(f"{path}: track {wrong} has two labels; expected one per track")
    return labels


def _frame_numbers(names: list[str], column: str) -> tuple[list[int], tuple[str, ...]]:
    """The numbers of the frames; for times and names of files, their place in order."""
    numbers = [name.lstrip("+") for name in names]
    if all(number.isdecimal() and len(number) <= DIGITS for number in numbers):
        return [int(number) for number in numbers], ()
    kind = "times" if all(np.isfinite(number_of(name)) for name in names) else "names"
    shown = f"{PurePath(names[0]).name} ... {PurePath(names[-1]).name}"
    return list(range(len(names))), (
        f"column '{column}' holds {kind} ({shown}): read as {len(names)} frames in this order",
    )


SIGHTINGS = DataSet(
    "sightings",
    "a table with one position of a track per line (track,frame,x,y[,label])",
    ("table",),
    recognises,
    read,
)
