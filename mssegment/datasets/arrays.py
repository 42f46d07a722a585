"""Arrays of tracks: [P, F, 2] or [T, N, 2], with visibility, as neural trackers write them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt

from mssegment.datasets.array_layouts import as_positions, fits
from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    ScatteredTracks,
    check_labels,
    check_points,
    frames_inside,
    size_that_holds,
)
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.matches import is_sighting_like
from mssegment.errors import DataError
from mssegment.records import Floats, Integers, Tracks

_TRACKS = (
    *("tracks", "pred_tracks", "points", "trajs", "trajectories", "trajs_2d", "tracks_2d"),
    *("trajs_e", "trajs_g", "pred_trajectories", "coords", "target_points", "matches"),
)
"""Names of the array of tracks, the most telling first."""
_MATRICES = (("x", "y"), ("X", "Y"), ("u", "v"), ("px", "py"), ("xs", "ys"), ("xpts", "ypts"))
"""Names of matrices [tracks, frames] or [frames, tracks] of one coordinate each."""
_VISIBLE = re.compile(r"(pred_)?(vis(ib\w*|ible\w*|_[eg])?|valids?|mask)")
_OCCLUDED = re.compile(r"(pred_)?occ(l\w*)?")
_IDS = ("ids", "track_ids", "id")
_LABELS = ("labels", "label", "true_labels", "gt_labels")
_OWN = {"points", "labels", "residuals", "matrices"}
"""The arrays in a ``tracks.npz`` of mssegment."""
_LIKELY = 0.5
"""A visibility given as a probability counts from here on."""


def recognises(content: Variables) -> bool:
    """Whether one of the arrays can be tracks."""
    return bool(_candidates(content))


def read(file: InputFile) -> ImportedTracks:
    """Read an array of tracks.

    A batch of length 1 is dropped. Which axis is time is found from the values: a
    track moves over less of the image than the tracks cover in one frame.

    Raises DataError if there is no such array, more than one, or one whose values are not valid.
    """
    name, array = _chosen(file)
    where = f"{file.name}: array '{name}'" if name else file.name
    if array.ndim == 2:
        return _from_rows(np.array(array, dtype=np.float64), file, where)
    points, flags, is_known = as_positions(array)
    notes: tuple[str, ...] = ()
    if is_known:
        notes = (f"array {list(array.shape)}: read as {points.shape[1]} frames of {len(points)}",)
    elif is_time_first(points):
        notes = (f"array {list(points.shape)}: read as {len(points)} frames of {points.shape[1]}",)
        points = np.swapaxes(points, 0, 1).copy()
        flags = None if flags is None else flags.T
    if notes:
        notes = (f"{notes[0]} tracks",)
    visible, used = _visibility(file.variables, name, points.shape[:2])
    if flags is not None:
        visible &= flags
    lost = ~np.isfinite(points).all(axis=-1)
    _check_finite(points, where)
    points[lost | ~visible] = np.nan
    hidden = int((~visible).sum())
    if hidden:
        why = ", ".join(used) or "third coordinate"
        notes += (f"{hidden} of {visible.size} positions are not visible ({why})",)
    check_points(points, where)
    labels, label_name = _labels(file, len(points))
    ids, id_name = _ids(file.variables, len(points))
    return ImportedTracks(
        file.path.stem,
        Tracks(points, labels=labels),
        frames_inside(file.name, file.content, range(points.shape[1]), *size_that_holds(points)),
        ids=ids,
        notes=(
            *notes,
            *_ignored(file.variables, {name, *name.split(", "), *used, label_name, id_name}),
        ),
    )


def _candidates(content: Variables) -> dict[str, npt.NDArray[Any]]:
    """The arrays that have the shape of tracks, by name."""
    if not isinstance(content, Mapping):
        return {}
    arrays = {n: _regular(a) if isinstance(a, list) else a for n, a in content.items()}
    for pair in _MATRICES:
        matrices = [own for name in pair if _is_matrix(own := arrays.get(name))]
        if len(matrices) == 2 and matrices[0].shape == matrices[1].shape:
            arrays[", ".join(pair)] = np.stack(matrices, axis=-1)
    return {n: a for n, a in arrays.items() if isinstance(a, np.ndarray) and fits(a)}


def _is_matrix(value: Any) -> TypeGuard[npt.NDArray[Any]]:
    is_array = isinstance(value, np.ndarray) and value.ndim == 2 and value.dtype.kind in "fiu"
    return bool(is_array and min(value.shape) > 1)


def _regular(nested: list[Any]) -> npt.NDArray[Any] | None:
    """Nested lists as an array, null as NaN; None if they are not regular numbers."""
    try:
        return np.array(_without_null(nested), dtype=np.float64)
    except (ValueError, TypeError, OverflowError, RecursionError):
        return None


def _without_null(nested: Any) -> Any:
    """Replace null by NaN; a point that is not seen may be null as a whole."""
    if not isinstance(nested, list):
        return float("nan") if nested is None else nested
    lengths = {len(part) for part in nested if isinstance(part, list)}
    if lengths:
        nested = [[None] * max(lengths) if part is None else part for part in nested]
    return [_without_null(part) for part in nested]


def _chosen(file: InputFile) -> tuple[str, npt.NDArray[Any]]:
    found = _candidates(file.variables)
    if file.member:
        if file.member not in found:
            raise DataError(
                f"{file.name}: no tracks called '{file.member}'; found {', '.join(found)}"
            )
        return file.member, found[file.member]
    for name in _TRACKS:
        if name in found:
            return name, found[name]
    three = {name: array for name, array in found.items() if array.ndim >= 3}
    best = three or found
    if len(best) > 1:
        raise DataError(
            f"{file.name}: several arrays may be tracks ({', '.join(best)}); choose one: "
            f"'{file.name}#{next(iter(best))}'"
        )
    return next(iter(best.items()))


def is_time_first(points: Floats) -> bool:
    """Whether an array [A, B, 2] of positions is [frames, tracks, 2].

    Along time one track covers less of the image than all tracks do in one frame. An axis of length
    2 beside a longer one is two frames.
    """
    first, second = points.shape[:2]
    if 2 in (first, second) and first != second:
        return bool(first == 2)
    return _spread(points, 0) < _spread(points, 1)


def _spread(points: Floats, axis: int) -> float:
    """Median over the other axis of the standard deviation of the positions along ``axis``."""
    seen = np.isfinite(points).all(axis=-1, keepdims=True)
    count = np.maximum(seen.sum(axis=axis, keepdims=True), 1)
    filled = np.where(seen, points, 0.0)
    mean = filled.sum(axis=axis, keepdims=True) / count
    variance = (np.where(seen, filled - mean, 0.0) ** 2).sum(axis=axis) / count.squeeze(axis)
    return float(np.median(np.sqrt(variance.sum(axis=-1))))


def _from_rows(values: Floats, file: InputFile, where: str) -> ImportedTracks:
    """Rows of an array: matches (x1, y1, x2, y2), or tracks of napari (id, t, y, x)."""
    notes: tuple[str, ...] = ()
    if values.shape[1] == 6 and (values[:, [2, 5]] == 1).all():
        values = values[:, [0, 1, 3, 4]]
    if values.shape[1] == 5 and is_sighting_like(values[:, [0, 1, 3, 4]]):
        values = values[:, [0, 1, 3, 4]]  # without z
    elif values.shape[1] == 5:
        values, notes = values[:, :4], ("fifth column ignored",)
    if values.shape[1] == 4 and is_sighting_like(values):
        return _of_napari(values, file, where)
    points = values.reshape(len(values), -1, 2)
    notes = (f"array [n, {values.shape[1]}]: read as x1, y1, x2, y2, ...", *notes)
    _check_finite(points, where)
    points[np.isnan(points).any(axis=-1)] = np.nan
    check_points(points, where)
    return ImportedTracks(
        file.path.stem,
        Tracks(points),
        frames_inside(file.name, file.content, range(points.shape[1]), *size_that_holds(points)),
        notes=notes,
    )


def _of_napari(values: Floats, file: InputFile, where: str) -> ImportedTracks:
    """Tracks from rows [n, 4] of a track, a time, y and x."""
    names, row = np.unique(values[:, 0].astype(np.int64), return_inverse=True)
    times, column = np.unique(values[:, 1], return_inverse=True)
    points = values[:, [3, 2]]
    _check_finite(points, where)
    visible = ~np.isnan(points).any(axis=1)
    tracks = ScatteredTracks(
        where, len(names), len(times), row[visible], column[visible], points[visible]
    )
    tracks.check()
    return ImportedTracks(
        file.path.stem,
        tracks,
        frames_inside(file.name, file.content, range(len(times)), *size_that_holds(points)),
        ids=tuple(map(str, names)),
        notes=("array [n, 4]: read as napari's tracks (id, t, y, x)",),
    )


def _check_finite(points: Floats, where: str) -> None:
    if np.isinf(points).any():
        raise DataError(f"{where} holds infinity; expected pixels, NaN where a point is not seen")


def _visibility(
    content: Variables, tracks: str, shape: tuple[int, ...]
) -> tuple[npt.NDArray[np.bool_], list[str]]:
    """Which positions are visible [P, F], and the names of the arrays that say so."""
    visible, used = np.ones(shape, dtype=bool), []
    for name, array in content.items():
        is_occluded = _OCCLUDED.fullmatch(name.lower()) is not None
        if name == tracks or not (is_occluded or _VISIBLE.fullmatch(name.lower())):
            continue
        flags = _like(array, shape)
        if flags is not None:
            visible &= flags < _LIKELY if is_occluded else flags >= _LIKELY
            used.append(name)
    return visible, used


def _like(array: Any, shape: tuple[int, ...]) -> Floats | None:
    """Numbers of the shape [P, F], given so or as [F, P], with or without axes of length 1."""
    try:
        values = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if values.size != shape[0] * shape[1]:
        return None
    kept = [n for n in values.shape if n != 1]
    if kept == [n for n in shape if n != 1]:
        return values.reshape(shape)
    if kept == [n for n in shape[::-1] if n != 1]:
        return values.reshape(shape[::-1]).T
    return None


def _labels(file: InputFile, count: int) -> tuple[Integers | None, str]:
    if set(file.variables) >= _OWN:
        return None, ""  # the labels of an earlier run, which are no truth
    for name in _LABELS:
        if name in file.variables and np.size(file.variables[name]) == count:
            values = file.variables[name]
            return check_labels(values, count, f"{file.name}: array '{name}'"), name
    return None, ""


def _ids(content: Variables, count: int) -> tuple[tuple[str, ...] | None, str]:
    for name in _IDS:
        if name in content and np.size(content[name]) == count:
            return tuple(map(str, np.ravel(content[name]).tolist())), name
    return None, ""


def _ignored(content: Variables, used: set[str]) -> tuple[str, ...]:
    rest = [name for name in content if name not in used]
    return (f"ignored: {', '.join(rest[:8])}",) if rest else ()


ARRAYS = DataSet(
    "arrays",
    "an array [tracks, frames, 2] or [frames, tracks, 2], with visibility (.npy, .npz, .mat, HDF5, "
    "JSON)",
    ("numpy", "matlab", "hdf5", "json", "yaml", "xml"),
    recognises,
    read,
)
