"""Tables with one track per line: ``x1,y1,x2,y2[,label]``, and so on for further views."""

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
from mssegment.datasets.columns import (
    LABEL,
    TRACK,
    displacement_of,
    first_of,
    sightings_of,
    views_of,
)
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.measurements import is_matrix
from mssegment.datasets.tables import Table
from mssegment.datasets.track_columns import ignored_columns, labels_of
from mssegment.errors import DataError
from mssegment.records import Floats, Tracks


def recognises(columns: Variables) -> bool:
    """Whether the columns are positions in two views or more."""
    if not isinstance(columns, Table):
        return False
    if columns.has_header:
        if sightings_of(columns) is not None:
            return False
        return len(views_of(columns)) >= 2 or displacement_of(columns) is not None
    return len(columns) >= 4 and _layout(columns) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read a table with one track per line; raises DataError if a value is not valid."""
    table = file.variables
    assert isinstance(table, Table)
    return read_matches(table, file)


def read_matches(table: Table, file: InputFile) -> ImportedTracks:
    """Tracks from a table with one track per line.

    A position without a value is not visible. Without names of columns, four are x1, y1, x2, y2, a
    fifth of small whole numbers is the label, and each further pair is one more view; six with ones
    in the third and sixth are homogeneous.

    Raises DataError if a value is not valid.
    """
    notes: list[str] = []
    if not table.has_header:
        names = _layout(table)
        if names is None:
            raise DataError(f"{file.name}: {len(table)} columns without names; name them")
        notes.append(f"no names of columns: read as {','.join(_shortened(names))}")
        table = table.renamed(names)
    views, points, said = _positions(table)
    notes += said
    half: npt.NDArray[np.bool_] = np.asarray(np.isnan(points).any(axis=-1))
    points[half] = np.nan
    check_points(points, file.name)
    if half.any():
        lost = int(half.any(axis=1).sum())
        notes.append(
            f"{lost} of {len(points)} tracks have no position in some view: not seen there"
        )
    label, track = first_of(table, LABEL), first_of(table, TRACK)
    labels, label_notes = labels_of(table, label, file.name)
    used = {name for view in views for name in view} | {track}
    used |= {label} if labels is not None else set()
    used |= {name for name in table if name.startswith("homogeneous")}
    return ImportedTracks(
        file.path.stem,
        Tracks(points, labels=labels),
        frames_inside(file.name, file.content, range(len(views)), *size_that_holds(points)),
        ids=tuple(cell.strip() for cell in table[track]) if track else None,
        notes=(*notes, *label_notes, *ignored_columns(table, used)),
    )


def _positions(table: Table) -> tuple[list[tuple[str, str]], Floats, list[str]]:
    """The columns (x, y) of each view, the positions [P, F, 2], and what was assumed."""
    views, displacement = views_of(table), None
    if len(views) < 2:
        displacement = displacement_of(table)
        assert displacement is not None
        views = [displacement[:2], displacement[2:]]
    columns = [[table.numbers(axis) for axis in view] for view in views]
    points = np.moveaxis(np.array(columns, dtype=np.float64), -1, 0)
    if displacement is None:
        return views, points, []
    named = ", ".join(displacement[2:])
    if _cancels(points):
        return views, points, [f"{named} are read as positions in the second view"]
    points[:, 1] += points[:, 0]
    return views, points, [f"{named} are read as displacements"]


def _cancels(points: Floats) -> bool:
    """Whether the second of two columns of pairs [P, 2, 2] are positions, as the first are.

    Of positions in two views the places cancel in the differences; to displacements, which do not
    depend on the place, they add.
    """
    spread = np.nanvar(points, axis=0).sum()
    return bool(np.nanvar(points[:, 1] - points[:, 0], axis=0).sum() < spread / 2)


def _shortened(names: list[str]) -> list[str]:
    return names if len(names) <= 6 else [*names[:4], "...", *names[-2:]]


def _layout(table: Table) -> list[str] | None:
    """Names for the columns of a table without names; None if they are no positions in views."""
    if not all(table.is_numeric(name) for name in list(table)[:4]):
        return None
    values = np.stack([table.numbers(name) for name in table], axis=1)
    count = values.shape[1]
    if count == 6 and (values[:, [2, 5]] == 1).all():
        return ["x1", "y1", "homogeneous1", "x2", "y2", "homogeneous2"]
    if is_sighting_like(values) or is_matrix(values):
        return None
    views = count // 2
    if views > 2 and len(values) > 2 and not np.ptp(values[:, : 2 * views], axis=0).all():
        return None  # the coordinates of tracks differ; a column of -1 is something else
    names = [f"{axis}{view + 1}" for view in range(views) for axis in "xy"]
    if count % 2 == 0:
        return names
    last = values[:, -1]
    is_label = (last == np.round(last)).all() and len(np.unique(last)) <= max(len(last) // 2, 2)
    return [*names, "label" if is_label else "column"]


def is_sighting_like(values: Floats) -> bool:
    """Whether the first two of some columns [rows, n] identify a track and a frame.

    They are whole numbers from 0, no pair stands twice, at least one of them repeats, and positions
    do not follow them: the second position of a match lies near the first.
    """
    keys = values[:, :2]
    if len(values) < 2 or not np.isfinite(keys).all():
        return False
    whole = (keys == np.round(keys)).all() and (keys >= 0).all()
    if not whole or len(np.unique(keys, axis=0)) < len(keys):
        return False
    if min(len(np.unique(keys[:, 0])), len(np.unique(keys[:, 1]))) * 2 > len(keys):
        return False
    moves = np.nanvar(values[:, 2:4] - keys, axis=0).sum()
    # of unrelated columns the variances add; of matches the positions cancel
    return bool(moves > np.nanvar(values[:, 2:4], axis=0).sum() / 2)


MATCHES = DataSet(
    "matches",
    "a table with one track per line (x1,y1,x2,y2[,x3,y3,...][,label])",
    ("table",),
    recognises,
    read,
)
