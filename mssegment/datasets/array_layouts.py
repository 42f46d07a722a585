"""Which axes of an array of tracks are tracks, frames and coordinates."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats

_FLAG = 3
"""Length of an axis of coordinates with a visibility as the third."""


def fits(array: npt.NDArray[Any]) -> bool:
    """Whether an array of numbers has the shape of tracks.

    These are [P, F, 2] or [F, P, 2], the same with the axis of coordinates first or second, with a
    visibility as third coordinate, with a batch of one, with several points for each of several
    objects, and rows of two or three positions.
    """
    if array.dtype.kind not in "fiu" or 0 in array.shape:
        return False
    if array.ndim == 2:
        return array.shape[1] in (4, 5, 6)
    return 3 <= array.ndim <= 5 and _coordinates(_without_batch(array)) is not None


def as_positions(array: npt.NDArray[Any]) -> tuple[Floats, npt.NDArray[np.bool_] | None, bool]:
    """An array that ``fits`` as positions.

    Returns
    -------
    points : ndarray [A, B, 2] of float64
        One of the first two axes is time.
    visible : ndarray [A, B] of bool, or None
        From a third coordinate.
    is_known : bool
        Whether the shape tells that the second axis is time.
    """
    values = _without_batch(array)
    axis = _coordinates(values)
    assert axis is not None
    points = np.moveaxis(np.array(values, dtype=np.float64), axis, -1)
    is_known = points.ndim == 4
    if is_known:
        # several points for each object: time first where the coordinates are last, otherwise last
        time = 0 if axis == 3 else 2
        points = np.moveaxis(points, time, 2)
        points = points.reshape(-1, *points.shape[2:])
    if points.shape[-1] == _FLAG:
        return points[..., :2].copy(), points[..., 2] >= 0.5, is_known
    return points, None, is_known


def _without_batch(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    while array.ndim > 3 and 1 in array.shape[:-1]:
        array = np.squeeze(array, axis=array.shape.index(1))
    return array


def _coordinates(array: npt.NDArray[Any]) -> int | None:
    """The axis of coordinates: the last, or else the first or the second; None without one."""
    if array.ndim not in (3, 4):
        return None
    if array.shape[-1] == 2 or (array.ndim == 3 and _has_flags(array)):
        return array.ndim - 1
    if array.ndim == 4:
        return 1 if array.shape[1] == 2 else None
    if array.dtype.kind != "f":
        return None
    return next((axis for axis in (0, 1) if array.shape[axis] == 2), None)


def _has_flags(array: npt.NDArray[Any]) -> bool:
    """Whether the last axis is x, y and a visibility, or the 1 of homogeneous coordinates."""
    if array.shape[-1] != _FLAG:
        return False
    third = array[..., 2]
    return bool(((third >= 0) & (third <= 1)).all() and np.nanmax(array[..., :2]) > 1)
