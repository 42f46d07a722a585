"""Matches of hloc: indices in one HDF5 file, the keypoints in another beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.hdf5 import load_hdf5
from mssegment.datasets.keypoints import matched, pairs_of
from mssegment.errors import DataError
from mssegment.inputs.files import read_file
from mssegment.records import Floats


def recognises(content: Variables) -> bool:
    """Whether the groups of a HDF5 file hold ``matches0`` for pairs of images."""
    return next(_pairs(content), None) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the matches of one pair of images, ``FILE#FIRST/SECOND`` where there are several.

    The keypoints are looked for in the same file, and in the other HDF5 files of its folder. They
    count pixel centres from 0, as here (hloc adds the 0.5 only when it writes for COLMAP).

    Raises DataError if the pair must be chosen, or there are no keypoints.
    """
    pairs = {f"{a}/{b}": (a, b, matches) for a, b, matches in _pairs(file.variables)}
    chosen = file.member or next(iter(pairs))
    if chosen not in pairs or (not file.member and len(pairs) > 1):
        shown = ", ".join(list(pairs)[:4]) + (", ..." if len(pairs) > 4 else "")
        raise DataError(
            f"{file.name}: matches of {len(pairs)} pairs of images ({shown}); choose one: "
            f"'{file.name}#{next(iter(pairs))}'"
        )
    first, second, matches = pairs[chosen]
    places = [_keypoints(name, file) for name in (first, second)]
    found = pairs_of(matches, len(places[0]), len(places[1]), f"{file.name}: matches0")
    points = np.stack([places[0][found[:, 0]], places[1][found[:, 1]]], axis=1)
    return matched(points, found, file, f"hloc: {first} and {second}")


def _pairs(content: Variables) -> Iterator[tuple[str, str, Any]]:
    for first, others in content.items():
        if not isinstance(others, Mapping):
            continue
        for second, arrays in others.items():
            if isinstance(arrays, Mapping) and "matches0" in arrays:
                yield first, second, arrays["matches0"]


def _keypoints(image: str, file: InputFile) -> Floats:
    others = sorted(
        path
        for pattern in ("*.h5", "*.hdf5")
        for path in file.path.resolve().parent.glob(pattern)
        if path != file.path.resolve()
    )
    for content in (file.variables, *(load_hdf5(read_file(str(p)), str(p)) for p in others)):
        found = _find(content, image)
        if found is not None:
            return np.asarray(found, dtype=np.float64)[:, :2]
    raise DataError(
        f"{file.name}: matches without keypoints; put the file with the keypoints of {image} "
        "(hloc's features) beside it"
    )


def _find(content: Variables, image: str) -> Any:
    """The keypoints of an image; hloc writes ``-`` for ``/`` in the names of matches."""
    for name, arrays in content.items():
        if isinstance(arrays, Mapping):
            if name in (image, image.replace("-", "/")) and "keypoints" in arrays:
                return arrays["keypoints"]
            inner = _find({f"{name}-{key}": value for key, value in arrays.items()}, image)
            if inner is not None:
                return inner
    return None


HLOC = DataSet("hloc", "hloc matches with the keypoints beside them", ("hdf5",), recognises, read)
