"""Matches of image pairs in HDF5: indices in one file, the keypoints in another beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.hdf5 import load_hdf5
from mssegment.datasets.image_pairs import chosen_pair
from mssegment.datasets.keypoints import matched, pairs_of
from mssegment.errors import DataError
from mssegment.inputs.files import read_file
from mssegment.records import Floats

_MATCHED = ("keypoints0", "keypoints1")
"""Positions that dense matchers (LoFTR in hloc) keep beside each other."""


def recognises(content: Variables) -> bool:
    """Whether the groups of a HDF5 file hold matches of pairs of images, or only keypoints."""
    return next(_pairs(content), None) is not None or _has_keypoints(content)


def read(file: InputFile) -> ImportedTracks:
    """Read the matches of one pair of images, ``FILE#FIRST,SECOND`` where there are several.

    The keypoints are looked for in the same file, and in the other HDF5 files of its folder. They
    count pixel centres from 0, as here (hloc adds the 0.5 only when it writes for COLMAP).

    Raises DataError if the pair must be chosen, or there are no keypoints, or no matches.
    """
    pairs = {(a, b): found for a, b, found in _pairs(file.variables)}
    if not pairs:
        raise DataError(
            f"{file.name}: keypoints without matches; give the file with the matches, and leave "
            "this one beside it"
        )
    (first, second), found, is_reversed = chosen_pair(pairs, file)
    if isinstance(found, tuple):
        places = [np.asarray(own, dtype=np.float64)[:, :2] for own in found]
        indices = np.repeat(np.arange(len(places[0]))[:, None], 2, axis=1)
        if len(places[0]) != len(places[1]):
            raise DataError(f"{file.name}: {first} and {second} have not as many keypoints")
    else:
        places = _keypoints((first, second), file)
        indices = pairs_of(found, len(places[0]), len(places[1]), f"{file.name}: matches0")
    points = np.stack([places[0][indices[:, 0]], places[1][indices[:, 1]]], axis=1)
    if is_reversed:
        points, indices, (first, second) = points[:, ::-1], indices[:, ::-1], (second, first)
    return matched(points, indices, file, f"matches of {first} and {second}")


def _pairs(content: Variables) -> Iterator[tuple[str, str, Any]]:
    """The images of each pair with its matches, or with the positions in both images.

    hloc nests the second image in the first; before 2021 it joined both names by ``_``. Kornia's
    users keep the indices [M, 2] under the second image.
    """
    for first, others in content.items():
        if not isinstance(others, Mapping):
            continue
        if "matches0" in others and (names := _split(first)):
            yield *names, others["matches0"]
        for second, own in others.items():
            if isinstance(own, Mapping):
                if "matches0" in own:
                    yield first, second, own["matches0"]
                elif all(np.ndim(own.get(name, 0)) == 2 for name in _MATCHED):
                    yield first, second, tuple(own[name] for name in _MATCHED)
            elif _are_indices(own) and all(map(_are_indices, others.values())):
                yield first, second, own


def _are_indices(value: Any) -> bool:
    is_whole = isinstance(value, np.ndarray) and value.dtype.kind in "iu"
    return is_whole and value.ndim == 2 and value.shape[1] == 2


def _split(joined: str) -> tuple[str, str] | None:
    """Two names of files that ``_`` joins: where a suffix ends, or in the middle."""
    parts = joined.split("_")
    places = [i for i in range(1, len(parts)) if "." in parts[i - 1]]
    if not places and len(parts) % 2 == 0:
        places = [len(parts) // 2]
    if not places:
        return None
    return "_".join(parts[: places[0]]), "_".join(parts[places[0] :])


def _has_keypoints(content: Variables) -> bool:
    """Whether groups hold ``keypoints`` of single images, as hloc's file of features."""
    return any(
        isinstance(own, Mapping) and ("keypoints" in own or _has_keypoints(own))
        for own in content.values()
    )


def _keypoints(images: Sequence[str], file: InputFile) -> list[Floats]:
    """The keypoints of images, from this file, or else from those beside it.

    Raises DataError if some are in none of them.
    """
    beside = sorted(
        path
        for pattern in ("*.h5", "*.hdf5")
        for path in file.path.resolve().parent.glob(pattern)
        if path != file.path.resolve()
    )
    found: dict[str, Any] = {}
    for path in (None, *beside):  # files beside it only as far as they are needed
        content = file.variables if path is None else load_hdf5(read_file(str(path)), str(path))
        for image in set(images) - set(found):
            if (own := _find(content, image)) is not None:
                found[image] = own
        if len(found) == len(set(images)):
            return [np.asarray(found[image], dtype=np.float64)[:, :2] for image in images]
    missing = next(image for image in images if image not in found)
    raise DataError(
        f"{file.name}: matches without keypoints; put the file with the keypoints of {missing} "
        "(hloc's features) beside it"
    )


def _find(content: Variables, image: str) -> Any:
    """The keypoints of an image; hloc writes ``-`` for ``/`` in the names of matches."""
    for name, own in content.items():
        is_it = name in (image, image.replace("-", "/"))
        if isinstance(own, Mapping):
            if is_it and "keypoints" in own:
                return own["keypoints"]
            inner = _find({f"{name}-{key}": value for key, value in own.items()}, image)
            if inner is not None:
                return inner
        elif is_it and isinstance(own, np.ndarray) and own.dtype.kind == "f" and own.ndim == 2:
            return own
    return None


HLOC = DataSet("hloc", "hloc matches with the keypoints beside them", ("hdf5",), recognises, read)
