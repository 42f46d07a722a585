"""Readers of the data sets and file formats that other people use; one file each, one registry."""

from __future__ import annotations

from pathlib import Path

from mssegment.datasets.adelaidermf import ADELAIDERMF
from mssegment.datasets.base import DataSet, ImportedTracks, Variables
from mssegment.datasets.csv_tracks import CSV_TRACKS, read_content, read_table
from mssegment.datasets.hopkins155 import HOPKINS155
from mssegment.datasets.kt3dmoseg import KT3DMOSEG
from mssegment.datasets.labels import (
    labels_from_masks,
    labels_from_points,
    read_located_labels,
)
from mssegment.datasets.matlab import load_matlab
from mssegment.errors import DataError

DATASETS: dict[str, DataSet] = {
    entry.name: entry for entry in (HOPKINS155, ADELAIDERMF, KT3DMOSEG, CSV_TRACKS)
}
"""Every format that ``read`` knows, by name; a new one is a file with a DataSet and a line here."""

__all__ = [
    "DATASETS",
    "DataSet",
    "ImportedTracks",
    "labels_from_masks",
    "labels_from_points",
    "read",
    "read_content",
    "read_located_labels",
    "recognise",
]


def recognise(path: Path | str) -> DataSet:
    """The format of a file, by its content; DataError where it is none that is known."""
    path = Path(path)
    if path.is_dir():
        raise DataError(f"{path}: this is a folder, a file of tracks was expected")
    if not path.exists():
        raise DataError(f"{path}: no such file; check the name")
    content: Variables
    if path.suffix.lower() == ".mat":
        content, suffix = load_matlab(path), ".mat"
    else:
        content, suffix = read_table(path), ".csv"
    for entry in DATASETS.values():
        if entry.suffix == suffix and entry.recognises(content):
            return entry
    known = ", ".join(entry.title for entry in DATASETS.values() if entry.suffix == suffix)
    raise DataError(f"{path}: holds {', '.join(content)}; expected {known}")


def read(path: Path | str, dataset: str | None = None) -> ImportedTracks:
    """Read a file of any known format (``dataset``: a name in DATASETS, else by its content)."""
    path = Path(path)
    if dataset is None:
        return recognise(path).read(path)
    if dataset not in DATASETS:
        raise DataError(f"unknown data set '{dataset}'; expected one of {', '.join(DATASETS)}")
    return DATASETS[dataset].read(path)
