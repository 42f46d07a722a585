"""Readers of public data sets and other file formats: one module each, named in ``registry.py``."""

from __future__ import annotations

from pathlib import Path

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.labels import (
    labels_from_masks,
    labels_from_points,
    read_located_labels,
)
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.registry import DATASETS

__all__ = [
    "DATASETS",
    "DataSet",
    "ImportedTracks",
    "InputFile",
    "labels_from_masks",
    "labels_from_points",
    "read",
    "read_content",
    "read_located_labels",
    "recognise",
]

EXPECTED = "x1,y1,x2,y2[,label] or track,frame,x,y[,label]"
"""The two plain tables, for messages."""
_SHOWN = 8


def recognise(path: Path | str) -> DataSet:
    """Determine the format of a file from its content.

    Parameters
    ----------
    path : Path or str
        A file of tracks; ``FILE#PART`` names a part of it.

    Returns
    -------
    DataSet
        The entry of ``DATASETS`` that can read the file.

    Raises
    ------
    DataError
        If the file cannot be read or has none of the known formats.
    """
    return _recognise(InputFile.opened(path))


def read(path: Path | str, dataset: str | None = None) -> ImportedTracks:
    """Read a file of tracks.

    Parameters
    ----------
    path : Path or str
        The file; ``FILE#PART`` names a part of it.
    dataset : str, optional
        A name in ``DATASETS``; by default the format is determined from the content.

    Returns
    -------
    ImportedTracks
        The tracks in pixels, with labels, camera and pictures if the file has them.

    Raises
    ------
    DataError
        If the file cannot be read, has an unknown format, or holds invalid values.
    """
    if dataset is not None and dataset not in DATASETS:
        raise DataError(f"unknown data set {dataset!r}; expected one of {', '.join(DATASETS)}")
    file = InputFile.opened(path)
    entry: DataSet = DATASETS[dataset] if dataset is not None else _recognise(file)
    found = entry.reader(file)
    if not file.was_member_read and file.member:
        raise DataError(
            f"{file.name}: read as {entry.title}, which has no parts; leave out '#{file.member}'"
        )
    return found


def read_content(content: bytes, name: str) -> ImportedTracks:
    """Read tracks from bytes, such as those of standard input; see ``read``.

    ``name`` is what the source is called in messages and in the frames.
    """
    file = InputFile(name, content)
    return _recognise(file).reader(file)


def _recognise(file: InputFile) -> DataSet:
    if not file.content.strip():
        raise DataError(f"{file.name}: empty; expected tracks, such as a table {EXPECTED}")
    # HDF5 may hold a table of pandas
    kind = "table" if isinstance(file.variables, Table) else file.container
    entry: DataSet
    for entry in DATASETS.values():
        if kind in entry.containers and entry.recognises(file.variables):
            return entry
    raise DataError(f"{file.name}: {_looks_like(file.variables)}")


def _looks_like(content: Variables) -> str:
    """What the content looks like, and what would be read."""
    if isinstance(content, Table):
        if not content.has_header:
            return (
                f"a table of {len(content)} columns without names; expected a first line that "
                f"names them: {EXPECTED}"
            )
        return f"a table with the columns {_listed(list(content))}; expected {EXPECTED}"
    if isinstance(content.get("people"), list):
        return (
            "key points of one picture (OpenPose), in which nobody has an identity; track them "
            f"first, and expected then is {EXPECTED}"
        )
    parts = [f"{name} {_kind(value)}".strip() for name, value in content.items()]
    return (
        f"holds {_listed(parts)}; expected an array of tracks [tracks, frames, 2], vectors x1, y1, "
        "x2, y2 or track, frame, x, y, or the file of a known data set"
    )


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more if names else "nothing"


def _kind(value: object) -> str:
    shape = getattr(value, "shape", None)
    if shape is None:
        return f"({type(value).__name__})"
    return f"[{', '.join(map(str, shape))}]"
