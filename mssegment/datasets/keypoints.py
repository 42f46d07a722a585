"""Keypoints and matches of two images, as LightGlue, SuperGlue and LoFTR users save them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    check_points,
    frames_inside,
    size_that_holds,
)
from mssegment.datasets.containers import InputFile, Variables
from mssegment.errors import DataError
from mssegment.records import Floats, Integers, Tracks

_PAIRS = (
    ("keypoints0", "keypoints1"),
    ("kpts0", "kpts1"),
    ("mkpts0", "mkpts1"),
    ("mkpts0_f", "mkpts1_f"),
    ("points0", "points1"),
    ("kp0", "kp1"),
    ("p0", "p1"),
    ("keypoints1", "keypoints2"),
    ("pts1", "pts2"),
)
_GENERAL = (
    ("kptsA", "kptsB"),
    ("src", "dst"),
    ("source", "target"),
    ("x1", "x2"),
    ("p1", "p2"),
    ("X", "Y"),
)
_ENDINGS = (("0", "1"), ("1", "2"), ("A", "B"), ("a", "b"), ("_l", "_r"), ("_left", "_right"))
_MATCHES = ("matches", "matches0", "matches01")


def recognises(content: Variables) -> bool:
    """Whether there are keypoints of two images."""
    return _names(content) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the matched keypoints.

    ``matches`` are pairs of indices [M, 2], or for each keypoint of the first image the index of
    its partner, -1 for none. Without matches the keypoints of both images belong together row by
    row. Raises DataError if they do not fit.
    """
    names = _names(file.variables)
    assert names is not None
    first, second = (_places(file.variables[name], f"{file.name}: '{name}'") for name in names)
    chosen = next((name for name in _MATCHES if name in file.variables), None)
    if chosen is None:
        if len(first) != len(second):
            raise DataError(
                f"{file.name}: {len(first)} and {len(second)} keypoints without matches; expected "
                "an array 'matches' [M, 2] or 'matches0' [N]"
            )
        pairs = np.repeat(np.arange(len(first))[:, None], 2, axis=1)
    else:
        pairs = pairs_of(
            file.variables[chosen], len(first), len(second), f"{file.name}: '{chosen}'"
        )
    points = np.stack([first[pairs[:, 0]], second[pairs[:, 1]]], axis=1)
    return matched(points, pairs, file)


def matched(points: Floats, pairs: Integers, file: InputFile, note: str = "") -> ImportedTracks:
    """Tracks of two views from matched keypoints; the index in the first image identifies each."""
    if np.isinf(points).any():
        raise DataError(f"{file.name}: a keypoint is at infinity; expected pixels")
    points = np.where(np.isnan(points).any(axis=-1, keepdims=True), np.nan, points)
    check_points(points, file.name)
    return ImportedTracks(
        file.path.stem,
        Tracks(points),
        frames_inside(file.name, file.content, range(2), *size_that_holds(points)),
        ids=tuple(map(str, pairs[:, 0].tolist())),
        notes=(note,) if note else (),
    )


def pairs_of(matches: Any, first: int, second: int, where: str) -> Integers:
    """Matches as pairs of indices [M, 2]; raises DataError if they do not fit the keypoints."""
    try:
        values = np.squeeze(np.asarray(matches))
    except ValueError:  # rows of several lengths
        raise DataError(f"{where}: expected indices of keypoints") from None
    if values.dtype.kind not in "iuf" or (values.size and not (values == np.round(values)).all()):
        raise DataError(f"{where}: expected indices of keypoints")
    if values.size and np.abs(values).max() >= 2**31:
        raise DataError(f"{where}: holds {np.abs(values).max()}; expected indices of keypoints")
    values = values.astype(np.int64)
    if values.ndim == 2 and 2 in values.shape:
        pairs = values if values.shape[1] == 2 else values.T
    elif values.shape == (first,):
        kept = np.flatnonzero(values >= 0)
        pairs = np.stack([kept, values[kept]], axis=1)
    else:
        raise DataError(
            f"{where}: shape {values.shape} for {first} keypoints; expected [M, 2] or [{first}]"
        )
    limits = np.array([first, second])
    if len(pairs) and ((pairs < 0) | (pairs >= limits)).any():
        raise DataError(f"{where}: an index beyond the {first} and {second} keypoints")
    return pairs


def _names(content: Variables) -> tuple[str, str] | None:
    """The names of the arrays of both images: known ones, or ones that differ in their ending."""
    ends = [(a, b) for a, b in _ENDINGS if any(name.endswith(a) for name in content)]
    similar = [
        (name, name[: len(name) - len(a)] + b)
        for name in content
        for a, b in ends
        if name.endswith(a)
    ]
    names = set(content)
    known = next((pair for pair in _PAIRS if set(pair) <= names), None)
    if known is not None:
        return known
    pairs = [pair for pair in (*_GENERAL, *similar) if set(pair) <= names]
    return next((pair for pair in pairs if all(_are_places(content[name]) for name in pair)), None)


def _are_places(array: Any) -> bool:
    """Whether an array can only be positions: of two coordinates, or homogeneous ones.

    Names such as ``image0`` and ``image1`` say nothing of what is in the arrays.
    """
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    if values.ndim == 3 and 1 in values.shape[:2]:
        values = np.squeeze(values, axis=values.shape.index(1))
    if values.ndim != 2:
        return False
    rows = values.T if len(values) in (2, 3) and values.shape[1] > 3 else values
    return rows.shape[1] == 2 or (rows.shape[1] == 3 and bool((rows[:, 2] == 1).all()))


def _places(array: Any, where: str) -> Floats:
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{where}: expected numbers") from None
    if values.ndim == 3 and 1 in values.shape[:2]:
        values = np.squeeze(values, axis=values.shape.index(1))
    if values.ndim == 2 and len(values) in (2, 3) and values.shape[1] > 3:
        values = values.T
    if values.ndim != 2 or values.shape[1] < 2 or not np.isfinite(values[:, :2]).all():
        raise DataError(f"{where}: shape {values.shape}; expected finite positions [N, 2]")
    return values[:, :2]


KEYPOINTS = DataSet(
    "keypoints",
    "keypoints and matches of two images (LightGlue, SuperGlue, LoFTR)",
    ("numpy", "hdf5", "matlab", "json", "yaml", "xml"),
    recognises,
    read,
)
