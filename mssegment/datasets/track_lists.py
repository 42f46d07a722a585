"""JSON with one object per track: its positions, and the frames in which it was seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    check_points,
    frames_inside,
    size_that_holds,
    unseen,
)
from mssegment.datasets.columns import FRAME, TRACK, first_of
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.track_columns import in_order, keys_of
from mssegment.errors import DataError
from mssegment.records import Floats, Tracks

_LISTS = ("tracks", "trajectories", "tracklets", "objects", "data", "")
"""Names of the list of tracks; empty if the list is the whole file."""
_POSITIONS = ("points", "positions", "trajectory", "path", "coordinates", "coords", "xy", "track")
_FRAMES = ("frames", "frame_ids", "times", "timestamps", "ts", *FRAME)

Entry = Mapping[str, Any]


def recognises(content: Variables) -> bool:
    """Whether there is a list of tracks that hold lists of positions."""
    return bool(_entries(content))


def read(file: InputFile) -> ImportedTracks:
    """Read the tracks; raises DataError if positions and frames do not fit together.

    Without frames, the positions of a track are those of the first, second, ... frame.
    """
    entries = _entries(file.variables)
    places = [_positions(entry, _where(file, i)) for i, entry in enumerate(entries)]
    frames = [
        _frames(entry, len(own), _where(file, i))
        for i, (entry, own) in enumerate(zip(entries, places, strict=True))
    ]
    names = in_order({name for own in frames for name in own})
    column = {name: i for i, name in enumerate(names)}
    points = unseen(len(entries), len(names), file.name)
    for row, (own, seen) in enumerate(zip(places, frames, strict=True)):
        points[row, [column[name] for name in seen]] = own
    check_points(points, file.name)
    id_name = first_of(entries[0], TRACK) or "id"
    return ImportedTracks(
        file.path.stem,
        Tracks(points),
        frames_inside(file.name, file.content, range(len(names)), *size_that_holds(points)),
        ids=tuple(str(entry.get(id_name, i)) for i, entry in enumerate(entries)),
        notes=(f"read as a list of {len(entries)} tracks in {len(names)} frames",),
    )


def _entries(content: Variables) -> Sequence[Entry]:
    """The list of tracks; empty if there is none."""
    for name in _LISTS:
        found = content.get(name) if isinstance(content, Mapping) else None
        if isinstance(found, np.ndarray) and found.dtype == object and found.size:
            found = [_of_cell(cell) for cell in found.ravel()]
        if isinstance(found, list) and found and all(map(_is_track, found)):
            return found
    return ()


def _of_cell(cell: Any) -> Entry | None:
    """The positions in a cell of Matlab, [n, 2], or [n, 3] with the frame first or last."""
    if not isinstance(cell, np.ndarray) or cell.ndim != 2 or cell.dtype.kind not in "fiu":
        return None
    if cell.shape[1] == 2:
        return {"points": cell.tolist()}
    if cell.shape[1] != 3:
        return None
    for axis in (0, 2):
        frames = cell[:, axis].astype(np.float64)
        if (frames == np.round(frames)).all() and (np.diff(frames) > 0).all():
            places = np.delete(cell, axis, axis=1)
            return {"points": places.tolist(), "frames": [f"{frame:.0f}" for frame in frames]}
    return None


def _is_track(entry: Any) -> bool:
    return isinstance(entry, dict) and isinstance(_given(entry), list)


def _given(entry: Entry) -> Any:
    """The positions of a track as they stand there, or as pairs of x and y; None without."""
    name = first_of(entry, _POSITIONS)
    if name is not None:
        return entry[name]
    x, y = entry.get("x"), entry.get("y")
    if isinstance(x, list) and isinstance(y, list) and len(x) == len(y):
        return [list(pair) for pair in zip(x, y, strict=True)]
    return None


def _positions(entry: Entry, where: str) -> Floats:
    """Positions [n, 2]; null and NaN are not visible."""
    rows = [[None, None] if point is None else point for point in _given(entry)]
    rows = [_of_point(point) for point in rows]
    try:
        values = np.array(rows, dtype=np.float64).reshape(len(rows), -1)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{where}: expected positions [x, y]") from None
    if len(values) and values.shape[1] != 2:
        raise DataError(f"{where}: {values.shape[1]} numbers in a position; expected x and y")
    if np.isinf(values).any():
        raise DataError(f"{where}: holds infinity; expected pixels, null where it is not seen")
    values = values.reshape(-1, 2)
    values[np.isnan(values).any(axis=1)] = np.nan
    return values


def _of_point(point: Any) -> Any:
    """The coordinates of a position, which may be an object with x and y."""
    return [point.get("x"), point.get("y")] if isinstance(point, dict) else point


def _frames(entry: Entry, count: int, where: str) -> list[str]:
    """The frame of each position."""
    name = next((n for n in _FRAMES if isinstance(entry.get(n), list)), None)
    inside = [first_of(p, FRAME) if isinstance(p, dict) else None for p in _given(entry)]
    if name is None and inside and all(inside):
        given = [p[key] for p, key in zip(_given(entry), inside, strict=True)]
    elif name is None:
        start = entry.get("start_frame", entry.get("start", 0))
        if not isinstance(start, int):
            raise DataError(f"{where}: start is {start!r}; expected the number of a frame")
        given = list(range(start, start + count))
    else:
        given = entry[name]
    names = keys_of([str(frame) for frame in given])
    if len(names) != count:
        raise DataError(f"{where}: {count} positions and {len(names)} frames; expected as many")
    if len(set(names)) < count:
        raise DataError(f"{where}: a frame stands twice; expected one position in each")
    return names


def _where(file: InputFile, index: int) -> str:
    return f"{file.name}: track {index + 1}"


TRACK_LISTS = DataSet(
    "track_lists",
    "a list of tracks with points and frames each (JSON, cells of Matlab)",
    ("json", "matlab"),
    recognises,
    read,
)
