"""MOTChallenge: ``frame,id,left,top,width,height,confidence,...``, without names of columns."""

from __future__ import annotations

import numpy as np

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.sightings import read_sightings
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.records import replace

_NAMES = ("frame", "id", "bb_left", "bb_top", "bb_width", "bb_height", "considered")
_COLUMNS = range(7, 11)


def recognises(columns: Variables) -> bool:
    """Whether a table without names is one of boxes: frame, identifier, left, top, size."""
    if not isinstance(columns, Table) or columns.has_header or len(columns) not in _COLUMNS:
        return False
    try:
        values = np.stack([columns.numbers(name) for name in list(columns)[:7]], axis=1)
    except DataError:
        return False
    keys = values[:, :2]
    return bool(
        len(values)
        and (keys == np.round(keys)).all()
        and (keys >= -1).all()
        and (values[:, 4:6] > 0).all()
        and (np.abs(values[:, 6]) <= 1).all()
        and ((keys[:, 1] == -1).all() or len(np.unique(keys, axis=0)) == len(keys))
    )


def read(file: InputFile) -> ImportedTracks:
    """Read the centres of the boxes; raises DataError if a value is not valid, or all ids are -1.

    Boxes that are marked as not to be considered (0 in the seventh column) are left out.
    """
    table = file.variables
    assert isinstance(table, Table)
    names = [*_NAMES, "class", "visible_part", "z"][: len(table)]
    named = Table(file.name, dict(zip(names, table.values(), strict=True)), table.lines)
    if (named.numbers("id") == -1).all():
        raise DataError(
            f"{file.name}: detections of MOTChallenge, whose boxes belong to no track (-1); run a "
            "tracker on them first"
        )
    considered = named.numbers("considered")
    left_out = np.flatnonzero(considered == 0)
    found = read_sightings(named.without(left_out.tolist()), file)
    notes = ["MOTChallenge: each track is the centre of its box"]
    if len(left_out):
        notes.append(f"{len(left_out)} boxes are marked as not considered: left out")
    rest = [note for note in found.notes if not note.startswith("column")]
    return replace(found, notes=(*notes, *rest))


MOT = DataSet(
    "mot",
    "MOTChallenge boxes (frame,id,left,top,width,height,confidence,...)",
    ("table",),
    recognises,
    read,
)
