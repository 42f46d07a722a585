"""Tables with a row per frame and two columns per point, as motion analysis programs write them."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    check_points,
    frames_inside,
    size_that_holds,
    unseen,
)
from mssegment.datasets.columns import CONFIDENCE, FRAME, LONGEST, TRACK, first_of, plain
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.tables import Table
from mssegment.datasets.track_columns import LIKELY, ignored_columns, in_order, keys_of
from mssegment.errors import DataError
from mssegment.records import Floats, Tracks

_AXIS_LAST = re.compile(r"(\w+?)_?([xy])")
_AXIS_FIRST = re.compile(r"([xy])_?(\w+)")
_OF_VIEWS = re.compile(r"(view|image|img|im|frame|f|t|cam|camera)?_?\d+|[a-z]|left|right|src|dst")
"""Names of views; their columns are one track per line, not one frame."""
_LIKELIHOOD = (*CONFIDENCE, "score", "visible")


def recognises(columns: Variables) -> bool:
    """Whether each row is a frame: named points, or numbered ones beside a column of times."""
    if not isinstance(columns, Table) or not columns.has_header:
        return False
    time = first_of(columns, FRAME)
    rest = [name for name in columns if name != time]
    track = first_of(rest, TRACK)
    points = _points_of(name for name in rest if name != track)
    named = [name for name in points if not _OF_VIEWS.fullmatch(name)]
    if track is not None:  # several named points of each object
        return time is not None and len(named) == len(points) >= 2
    if time is None:
        # words; numbered ones, such as p1 to p8, may be the views of one track
        return len(named) >= 3 and not any(re.search(r"\d", name) for name in points)
    return len(points) >= 3 or (len(points) == 2 and len(named) == 2)


def read(file: InputFile) -> ImportedTracks:
    """Read the positions of the points, in the order of time.

    Those less likely than not are not visible. Raises DataError if a value is not valid.
    """
    table = file.variables
    assert isinstance(table, Table)
    time = first_of(table, FRAME)
    track = first_of([name for name in table if name != time], TRACK)
    columns = _points_of(name for name in table if name not in (time, track))
    points = np.stack([_positions(table, *axes) for axes in columns.values()])
    used = {time, track, *(name for axes in columns.values() for name in axes)}
    for row, point in enumerate(columns):
        likely = _likelihood(table, point)
        if likely is not None:
            used.add(likely)
            points[row, ~(table.numbers(likely) >= LIKELY)] = np.nan
    ids = list(columns)
    if time is not None and track is not None:
        points, ids = _by_object(points, ids, table, time, track)
    elif time is not None:
        points = points[:, _order(table, time)]
    check_points(points, file.name)
    notes = [f"read as a row per frame: {points.shape[1]} frames of {len(points)} points"]
    return ImportedTracks(
        file.path.stem,
        Tracks(points),
        frames_inside(file.name, file.content, range(points.shape[1]), *size_that_holds(points)),
        ids=tuple(ids),
        notes=(*notes, *ignored_columns(table, used)),
    )


def _points_of(names: Iterable[str]) -> dict[str, tuple[str, str]]:
    """The columns (x, y) of each point, by its name, in their order."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        short = plain(name)
        if len(short) > LONGEST:
            continue
        if match := _AXIS_LAST.fullmatch(short):
            found.setdefault(match[1], {}).setdefault(match[2], name)
        elif match := _AXIS_FIRST.fullmatch(short):
            found.setdefault(match[2], {}).setdefault(match[1], name)
    return {point: (axes["x"], axes["y"]) for point, axes in found.items() if len(axes) == 2}


def _by_object(
    points: Floats, ids: list[str], table: Table, time: str, track: str
) -> tuple[Floats, list[str]]:
    """Positions [points, rows, 2] as those of each object in each frame.

    Raises DataError if an object has two rows in a frame.
    """
    objects, times = keys_of(table[track]), keys_of(table[time])
    names, frames = in_order(set(objects)), in_order(set(times))
    found = unseen(len(points) * len(names), len(frames), table.name)
    row, column = ({key: i for i, key in enumerate(keys)} for keys in (names, frames))
    cells = [
        row[own] * len(frames) + column[when] for own, when in zip(objects, times, strict=True)
    ]
    first = {cell: i for i, cell in reversed(list(enumerate(cells)))}
    if len(first) < len(cells):
        twice = next(i for i, cell in enumerate(cells) if first[cell] < i)
        raise DataError(
            f"{table.name}: line {table.lines[twice]}: {track} {objects[twice]} has a second row "
            f"in frame {times[twice]}; expected one row for each object and frame"
        )
    found = found.reshape(len(names) * len(frames), len(points), 2)
    found[cells] = np.swapaxes(points, 0, 1)
    found = found.reshape(len(names), len(frames), len(points), 2).swapaxes(1, 2)
    named = [f"{own} {point}" for own in names for point in ids]
    return found.reshape(len(named), len(frames), 2), named


def _positions(table: Table, x: str, y: str) -> Floats:
    """Positions [F, 2], NaN where one coordinate is missing."""
    places = np.stack([table.numbers(x), table.numbers(y)], axis=-1)
    half: npt.NDArray[np.bool_] = np.asarray(np.isnan(places).any(axis=-1))
    places[half] = np.nan
    return places


def _likelihood(table: Table, point: str) -> str | None:
    """The column that says how likely a point is where it is."""
    wanted = {f"{point}_{word}" for word in _LIKELIHOOD}
    return next((name for name in table if plain(name) in wanted), None)


def _order(table: Table, time: str) -> npt.NDArray[np.int64]:
    """The rows in the order of time, as they stand if it is text.

    Raises DataError if two have the same.
    """
    cells = [cell.strip() for cell in table[time]]
    seen: set[str] = set()
    for row, cell in enumerate(cells):
        if cell in seen:
            raise DataError(
                f"{table.name}: line {table.lines[row]}: {time} {cell} a second time; expected a "
                "row per frame, or a column that names the track"
            )
        seen.add(cell)
    if not table.is_numeric(time):
        return np.arange(len(cells))
    return np.asarray(np.argsort(table.numbers(time), kind="stable"), dtype=np.int64)


TIMELINES = DataSet(
    "timelines",
    "a table with a row per frame and columns x, y of each point",
    ("table",),
    recognises,
    read,
)
