"""Tables of boxes without names of columns: MOTChallenge, KITTI, Stanford drones, AI City."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.matches import is_sighting_like
from mssegment.datasets.sightings import read_sightings
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.records import Floats, Record, replace

_FEWEST = 6
"""Columns of the shortest of these tables: frame, identifier and a box."""


class Layout(Record, frozen=True):
    """A layout of rows of boxes.

    Attributes
    ----------
    title : str
        Whose it is.
    names : tuple of str
        The columns; those beyond are numbered.
    fits : callable
        Whether a table of numbers [rows, columns] has this layout; NaN stands for text.
    """

    title: str
    names: tuple[str, ...]
    fits: Callable[[Floats], bool]


def _are_keys(keys: Floats) -> bool:
    """Whether two columns are a frame and a track: whole numbers, and no pair stands twice."""
    whole = np.isfinite(keys).all() and (keys == np.round(keys)).all() and (keys >= -1).all()
    # a box without a track may stand several times in a frame
    known = keys[(keys >= 0).all(axis=1)] if whole else keys
    return bool(whole) and len(np.unique(known, axis=0)) == len(known)


def _is_mot(values: Floats) -> bool:
    columns = values.shape[1]
    if not (_FEWEST <= columns <= 10 and np.isfinite(values).all() and _are_keys(values[:, :2])):
        return False
    if not (values[:, 4:6] > 0).all():
        return False
    if columns == _FEWEST:
        return is_sighting_like(values)
    confidence, rest = values[:, 6], values[:, 7:]
    return bool((np.abs(confidence) <= 1).all() or (rest.size and (rest == -1).all()))


def _is_kitti(values: Floats) -> bool:
    if values.shape[1] not in (17, 18) or not np.isnan(values[:, 2]).all():
        return False
    boxes = values[:, 6:10]
    right = (boxes[:, 2:] >= boxes[:, :2]).all()
    return _are_keys(values[:, :2]) and bool(right) and bool(np.isfinite(values[:, 3:]).all())


def _is_vatic(values: Floats) -> bool:
    if values.shape[1] < 10 or not np.isnan(values[:, 9]).all():
        return False
    boxes, flags = values[:, 1:5], values[:, 6:9]
    is_box = bool((boxes[:, 2:] >= boxes[:, :2]).all())
    return is_box and _are_keys(values[:, [0, 5]]) and bool(np.isin(flags, (0, 1)).all())


def _is_ai_city(values: Floats) -> bool:
    if values.shape[1] != 9 or not np.isfinite(values).all() or not (values[:, 7:] == -1).all():
        return False
    return _are_keys(values[:, 1:3]) and bool((values[:, 5:7] > 0).all())


_CORNERS = ("left", "top", "right", "bottom")
_BOX = ("bb_left", "bb_top", "bb_width", "bb_height")
_LAYOUTS = (
    Layout(
        "KITTI tracking",
        ("frame", "track", "type", "truncation", "occlusion_level", "alpha", *_CORNERS),
        _is_kitti,
    ),
    Layout(
        "VATIC, Stanford drones",
        ("track", "x_min", "y_min", "x_max", "y_max", "frame", "lost", "hidden_part", "generated"),
        _is_vatic,
    ),
    Layout("AI City", ("camera", "track", "frame", *_BOX), _is_ai_city),
    Layout("MOTChallenge", ("frame", "id", *_BOX, "considered"), _is_mot),
)


def _layout_of(table: Table) -> Layout | None:
    if table.has_header or len(table) < _FEWEST or not table.rows:
        return None
    try:
        columns = [
            table.numbers(name) if table.is_numeric(name) else np.full(table.rows, np.nan)
            for name in table
        ]
    except DataError:
        return None
    values = np.stack(columns, axis=1)
    return next((layout for layout in _LAYOUTS if layout.fits(values)), None)


def recognises(columns: Variables) -> bool:
    """Whether a table without names is one of boxes."""
    return isinstance(columns, Table) and _layout_of(columns) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the centres of the boxes; raises DataError if a value is not valid, or all ids are -1.

    Boxes that are marked as not to be considered (0 in the seventh column of MOTChallenge), that
    belong to no track, or that are lost are left out.
    """
    table = file.variables
    assert isinstance(table, Table)
    layout = _layout_of(table)
    assert layout is not None
    more = [f"other {i + 1}" for i in range(len(table) - len(layout.names))]
    named = table.renamed([*layout.names[: len(table)], *more])
    id_name = "id" if "id" in named else "track"
    without = named.numbers(id_name) == -1
    if without.all():
        raise DataError(
            f"{file.name}: detections of {layout.title}, whose boxes belong to no track (-1); run "
            "a tracker on them first"
        )
    notes = [f"{layout.title}: each track is the centre of its box"]
    if without.any():
        notes.append(f"{int(without.sum())} boxes belong to no track: left out")
    marked = np.zeros(named.rows, dtype=bool)
    if "considered" in named:
        considered = named.numbers("considered")
        marked = (considered == 0) & ~without
        if marked.any():
            notes.append(f"{int(marked.sum())} boxes are marked as not considered: left out")
    found = read_sightings(named.without(np.flatnonzero(without | marked).tolist()), file)
    rest = [note for note in found.notes if not note.startswith("column")]
    return replace(found, notes=(*notes, *rest))


BOXES = DataSet(
    "boxes",
    "boxes without names of columns: MOTChallenge (frame,id,left,top,width,height,...), KITTI "
    "tracking, VATIC and Stanford drones, AI City",
    ("table",),
    recognises,
    read,
)
