"""Readers of public data sets and other file formats: one module each, named in ``registry.py``."""

from __future__ import annotations

from pathlib import Path

from mssegment.datasets.base import DataSet, ImportedTracks, Variables
from mssegment.datasets.csv_tracks import read_content, read_table
from mssegment.datasets.labels import (
    labels_from_masks,
    labels_from_points,
    read_located_labels,
)
from mssegment.datasets.matlab import load_matlab
from mssegment.errors import DataError
from mssegment.registry import DATASETS

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
    """Determine the format of a file from its content.

    Parameters
    ----------
    path : Path or str
        A ``.mat`` file, or a table of comma-, semicolon- or tab-separated values.

    Returns
    -------
    DataSet
        The entry of ``DATASETS`` that can read the file.

    Raises
    ------
    DataError
        If the file cannot be read or has none of the known formats.
    """
    path = Path(path)
    if path.is_dir():
        raise DataError(f"{path}: this is a folder; expected a file of tracks")
    if not path.exists():
        raise DataError(f"{path}: no such file; check the name")
    content: Variables
    if path.suffix.lower() == ".mat":
        content, suffix = load_matlab(path), ".mat"
    else:
        content, suffix = read_table(path), ".csv"
    entry: DataSet
    for entry in DATASETS.values():
        if entry.suffix == suffix and entry.recognises(content):
            return entry
    known = ", ".join(entry.title for entry in DATASETS.values() if entry.suffix == suffix)
    raise DataError(f"{path}: holds {', '.join(content)}; expected {known}")


def read(path: Path | str, dataset: str | None = None) -> ImportedTracks:
    """Read a file of tracks.

    Parameters
    ----------
    path : Path or str
        The file.
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
    path = Path(path)
    if dataset is None:
        return recognise(path).read(path)
    if dataset not in DATASETS:
        raise DataError(f"unknown data set {dataset!r}; expected one of {', '.join(DATASETS)}")
    entry: DataSet = DATASETS[dataset]
    return entry.read(path)
