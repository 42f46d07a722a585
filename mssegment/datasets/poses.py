"""Files of poses and other measurements on a manifold: TUM, KITTI, tables, NumPy, JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np

from mssegment.datasets.containers import InputFile
from mssegment.datasets.numpy_files import load_numpy
from mssegment.datasets.tables import Table, read_table
from mssegment.errors import DataError
from mssegment.records import Floats

MAX_NORM_ERROR = 0.05
"""The norm of a quaternion may be this far from 1: numbers with two decimals are nearer."""
_TUM = ("tx", "ty", "tz", "qx", "qy", "qz", "qw")
_SYNONYMS = {
    "tx": ("tx", "x", "px", "pos_x", "position_x", "p_x"),
    "ty": ("ty", "y", "py", "pos_y", "position_y", "p_y"),
    "tz": ("tz", "z", "pz", "pos_z", "position_z", "p_z"),
    "qx": ("qx", "q_x", "quat_x", "orientation_x", "rot_x"),
    "qy": ("qy", "q_y", "quat_y", "orientation_y", "rot_y"),
    "qz": ("qz", "q_z", "quat_z", "orientation_z", "rot_z"),
    "qw": ("qw", "q_w", "quat_w", "orientation_w", "rot_w"),
}
_WEIGHTS = ("weight", "weights", "w")


class Measurements:
    """Measurements as arrays.

    Attributes
    ----------
    points
        Arrays [n, ...], not yet checked to be points.
    weights
        Their weights [n], None where the file has none.
    assumed
        What the file does not say, in words.
    """

    def __init__(self, points: Floats, weights: Floats | None = None, assumed: str = "") -> None:
        self.points, self.weights, self.assumed = points, weights, assumed


def read_measurements(content: bytes, name: str, shape: tuple[int, ...] | None) -> Measurements:
    """Read measurements.

    Parameters
    ----------
    content
        A NumPy file; JSON, a list of measurements or an object with one; or a table: rows of TUM
        (time, position, quaternion with w last), of KITTI (3 x 4 matrices), or of all entries of a
        point. A column ``weight`` holds weights.
    name
        The name of the file, for errors.
    shape
        The shape of a point; None where the rows say it.

    Returns
    -------
    Measurements

    Raises
    ------
    DataError
        For a damaged file, or columns that are no point of that shape.
    """
    if content[:6] == b"\x93NUMPY" or content[:2] == b"PK":
        arrays = load_numpy(InputFile(name, content))
        found = [array for array in arrays.values() if np.ndim(array) >= 2]
        if not found:
            raise DataError(f"{name}: no array with two axes or more; expected measurements in it")
        return Measurements(_shaped(_numbers(found[0], name), name, shape))
    if content.lstrip()[:1] in (b"[", b"{"):
        return Measurements(_shaped(_from_json(content, name), name, shape))
    return _from_table(read_table(content, name), name, shape)


def _numbers(values: object, name: str) -> Floats:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise DataError(
            f"{name}: the measurements are no numbers, or not all of one shape"
        ) from None
    if not array.ndim or not array.size:
        raise DataError(f"{name}: no measurements; expected one in each line")
    finite = np.isfinite(array).reshape(len(array), -1).all(axis=1)
    if not finite.all():
        raise DataError(f"{name}: measurement {int(np.argmin(finite))} is not finite")
    return array


def _from_json(content: bytes, name: str) -> Floats:
    try:
        values = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise DataError(f"{name}: damaged JSON ({error})") from None
    if isinstance(values, dict):
        lists = [value for value in values.values() if isinstance(value, list)]
        if len(lists) != 1:
            raise DataError(
                f"{name}: an object with {len(lists)} lists; expected a list of measurements, or "
                "an object with one such list"
            )
        values = lists[0]
    return _numbers(values, name)


def _shaped(array: Floats, name: str, shape: tuple[int, ...] | None) -> Floats:
    """Arrays [n, ...] as points of this shape: 3 x 4 matrices get their last row."""
    if array.ndim < 2:
        raise DataError(f"{name}: found an array of shape {array.shape}; expected [n, ...]")
    if shape is None or array.shape[1:] == shape:
        return array
    numbers = int(np.prod(array.shape[1:]))
    if numbers == int(np.prod(shape)):
        return array.reshape(len(array), *shape)
    if len(shape) == 2 and shape[0] == shape[1] and numbers == shape[0] * (shape[0] - 1):
        whole = np.tile(np.eye(shape[0]), (len(array), 1, 1))
        whole[:, :-1] = array.reshape(len(array), shape[0] - 1, shape[0])
        return whole
    if array.ndim == 2:
        columns = [array[:, i] for i in range(array.shape[1])]
        return _from_columns(columns, name, shape).points
    raise DataError(
        f"{name}: measurements of shape {array.shape[1:]}; expected {shape} for this manifold"
    )


def _from_table(table: Table, name: str, shape: tuple[int, ...] | None) -> Measurements:
    names = list(table)
    weights = None
    if table.has_header:
        for column in names:
            if column in _WEIGHTS:
                weights = table.numbers(column)
                names = [other for other in names if other != column]
                break
        named = _by_name(names)
        if named and shape in ((4, 4), (3, 3)):
            wanted = _TUM if shape == (4, 4) else _TUM[3:]
            columns = [table.numbers(named[key]) for key in wanted]
            return Measurements(_from_columns(columns, name, shape).points, weights)
    columns = [table.numbers(column) for column in names]
    found = _from_columns(columns, name, shape)
    return Measurements(found.points, weights, found.assumed)


def _by_name(names: Sequence[str]) -> dict[str, str]:
    """The columns of a quaternion, and of a position; empty where one is missing."""
    found = {
        key: column for key, synonyms in _SYNONYMS.items() for column in names if column in synonyms
    }
    return found if all(key in found for key in _TUM[3:]) else {}


def _from_columns(
    columns: Sequence[Floats], name: str, shape: tuple[int, ...] | None
) -> Measurements:
    """Points from unnamed columns; their number says what they are."""
    rows = _numbers(np.stack(columns, axis=1), name)
    count = rows.shape[1]
    if shape is None or (len(shape) == 1 and count == shape[0]):
        return Measurements(rows)
    if shape == (4, 4) and count in (7, 8):
        pose = rows[:, count - 7 :]
        points = np.tile(np.eye(4), (len(rows), 1, 1))
        points[:, :3, :3] = _rotations(pose[:, 3:], name)
        points[:, :3, 3] = pose[:, :3]
        return Measurements(points, None, "columns read as tx ty tz qx qy qz qw (TUM)")
    if shape == (3, 3) and count == 4:
        return Measurements(_rotations(rows, name), None, "columns read as qx qy qz qw")
    if shape == (3, 3) and count == 3:
        return Measurements(_plane(rows), None, "columns read as x y angle, in radians")
    sizes = {int(np.prod(shape))}
    if len(shape) == 2 and shape[0] == shape[1]:
        sizes.add(shape[0] * (shape[0] - 1))
    if count not in sizes:
        expected = " or ".join(map(str, sorted(sizes)))
        more = ", or 7 or 8 as in TUM files" if shape == (4, 4) else ""
        raise DataError(
            f"{name}: {count} columns; expected {expected} for points of this manifold{more}"
        )
    return Measurements(_shaped(rows, name, shape))


def _rotations(q: Floats, name: str) -> Floats:
    """Rotation matrices of quaternions (x, y, z, w) [n, 4]."""
    norms = np.linalg.norm(q, axis=1)
    wrong = np.abs(norms - 1.0) > MAX_NORM_ERROR
    if wrong.any():
        i = int(np.argmax(wrong))
        raise DataError(
            f"{name}: measurement {i}: a quaternion of norm {norms[i]:.3g}; expected norm 1, in "
            "the order qx qy qz qw"
        )
    x, y, z, w = (q / norms[:, None]).T
    entries = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(entries), 2, 0)


def _plane(rows: Floats) -> Floats:
    """Rigid motions of the plane from (x, y, angle) [n, 3]."""
    points = np.tile(np.eye(3), (len(rows), 1, 1))
    cosine, sine = np.cos(rows[:, 2]), np.sin(rows[:, 2])
    points[:, 0, 0], points[:, 1, 1] = cosine, cosine
    points[:, 1, 0], points[:, 0, 1] = sine, -sine
    points[:, :2, 2] = rows[:, :2]
    return points
