"""Readers of data that is no picture: tables of numbers, point clouds, matched 3-D points."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mssegment.datasets.base import ImportedTracks, check_labels, frames_inside
from mssegment.datasets.containers import InputFile
from mssegment.datasets.numpy_files import load_numpy
from mssegment.datasets.tables import Table, read_table
from mssegment.errors import DataError, UsageError
from mssegment.records import Floats, Integers, Tracks, replace

LABELS = ("label", "labels", "class", "structure", "motion", "gt")
"""Columns and arrays that hold true labels."""
IDS = ("id", "index", "name")
"""Columns that hold names of the points."""
_MATCHED = re.compile(r"([a-z]+)_?([12])")
"""A column of matched points: x1, y1, z1, x2, y2, z2."""
_AXES = ("x", "y", "z")


def read_points(file: InputFile) -> ImportedTracks:
    """Read points [P, d], or two matched sets of points [P, 2, d].

    Parameters
    ----------
    file : InputFile
        A table with one point in each row: ``x,y,z``, or any columns of numbers; matched points
        have the columns ``x1,y1,z1,x2,y2,z2``. A column ``label`` holds true labels, ``id`` names.
        A NumPy file with an array [P, d] or [P, 2, d], and in a ``.npz`` also ``labels``. A point
        cloud: XYZ, and with ``mssegment[points]`` PLY and PCD.

    Returns
    -------
    ImportedTracks
        Its frames have no size.

    Raises
    ------
    DataError
        If the file is damaged, or holds no points.
    UsageError
        If a package is needed that is not installed.
    """
    if not file.content.strip():
        raise DataError(f"{file.name}: empty; expected points, one in each row")
    found = _reader(file)(file)
    points = found.points
    if points.shape[0] < 1 or points.shape[-1] < 1:
        raise DataError(f"{file.name}: no points; expected one in each row")
    visible = np.isfinite(points).all(axis=(1, 2))
    notes: tuple[str, ...] = ()
    if not visible.all():
        points = np.where(np.isfinite(points).all(axis=-1, keepdims=True), points, np.nan)
        notes = (f"{int((~visible).sum())} points lack a coordinate and belong to no structure",)
    frames = frames_inside(file.name, file.content, range(points.shape[1]), 0, 0)
    return ImportedTracks(
        file.path.stem, replace(found, points=points, ids=None), frames, ids=found.ids, notes=notes
    )


def _reader(file: InputFile) -> Callable[[InputFile], Tracks]:
    start = file.content[:11].lstrip()
    if start[:3] == b"ply" and start[3:4].isspace():
        return _from_ply
    if file.content.lstrip()[:1] == b"#" and b".PCD" in file.content[:40]:
        return _from_pcd
    if file.content[:11] == b"VERSION 0.7" or file.name.lower().endswith(".pcd"):
        return _from_pcd
    if file.container == "numpy":
        return _from_numpy
    if file.container in ("table", "json"):
        return _from_table if file.container == "table" else _from_json
    raise DataError(
        f"{file.name}: not a file of points; expected a table, .npy, .npz, JSON, PLY, PCD or XYZ"
    )


def _from_table(file: InputFile) -> Tracks:
    table = read_table(file.content, file.name)
    names = list(table)
    labels = ids = None
    if table.has_header:
        for name in [n for n in names if n in LABELS][:1]:
            labels = check_labels(table.numbers(name), table.rows, f"{file.name}: column '{name}'")
            names.remove(name)
        for name in [n for n in names if n in IDS][:1]:
            ids = tuple(table[name])
            names.remove(name)
    elif file.name.lower().endswith(".xyz"):
        names = names[:3]  # the others are colours, normals or intensities
    chosen = _coordinates(names)
    return Tracks(_columns(table, chosen), labels=labels, ids=ids)


def _coordinates(names: Sequence[str]) -> list[list[str]]:
    """The columns of the coordinates in each view: matched ones, x, y and z, or all."""
    views: dict[str, list[str]] = {"1": [], "2": []}
    for name in names:
        match = _MATCHED.fullmatch(name)
        if match and match[1] in _AXES:
            views[match[2]].append(name)
    axes = [[name[0] for name in view] for view in views.values()]
    if axes[0] and axes[0] == axes[1]:
        return list(views.values())
    spatial = [axis for axis in _AXES if axis in names]
    return [spatial if len(spatial) >= 2 else list(names)]


def _columns(table: Table, views: Sequence[Sequence[str]]) -> Floats:
    if not views[0]:
        raise DataError(f"{table.name}: no column of coordinates; expected x,y,z or other numbers")
    return np.stack(
        [np.stack([table.numbers(name) for name in view], axis=1) for view in views], axis=1
    )


def _from_json(file: InputFile) -> Tracks:
    values = file.variables
    if set(values) == {""}:
        return Tracks(_shaped(values[""], file.name))
    return _from_arrays(values, file)


def _from_numpy(file: InputFile) -> Tracks:
    return _from_arrays(load_numpy(file), file)


def _from_arrays(arrays: object, file: InputFile) -> Tracks:
    named = dict(arrays) if isinstance(arrays, dict) else {}
    labels: Integers | None = None
    for name in [n for n in named if n.lower() in LABELS][:1]:
        labels = named.pop(name)
    found = {name: value for name, value in named.items() if np.ndim(value) in (2, 3)}
    if len(found) != 1:
        listed = ", ".join(found) or "none"
        raise DataError(
            f"{file.name}: arrays of points [P, d] or [P, 2, d]: {listed}; expected one, and "
            "optionally `labels`"
        )
    points = _shaped(next(iter(found.values())), file.name)
    if labels is not None:
        labels = check_labels(labels, len(points), f"{file.name}: labels")
    return Tracks(points, labels=labels)


def _shaped(values: object, name: str) -> Floats:
    """Points [P, d] or [P, F, d] as [P, F, d]."""
    try:
        points = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise DataError(f"{name}: not an array of numbers; expected points [P, d]") from None
    if points.ndim == 2:
        return points[:, None]
    if points.ndim != 3 or points.shape[1] > 2:
        shape = list(points.shape)
        raise DataError(f"{name}: an array of shape {shape}; expected [P, d] or [P, 2, d]")
    return points


def _from_ply(file: InputFile) -> Tracks:
    try:
        from plyfile import PlyData, PlyParseError
    except ImportError:
        raise _missing(file, "PLY") from None
    try:
        vertices = PlyData.read(io.BytesIO(file.content))["vertex"].data
        return _from_fields({name: vertices[name] for name in vertices.dtype.names}, file)
    except (PlyParseError, KeyError, ValueError, EOFError) as error:
        raise DataError(f"{file.name}: a damaged PLY file ({error})") from None


def _from_pcd(file: InputFile) -> Tracks:
    try:
        from pypcd4.pypcd4 import PointCloud
    except ImportError:
        raise _missing(file, "PCD") from None
    try:
        cloud = PointCloud.from_fileobj(io.BufferedReader(io.BytesIO(file.content)))
        fields = {name: cloud.numpy((name,))[:, 0] for name in cloud.fields}
    except (ValueError, KeyError, IndexError, RuntimeError, TypeError, AssertionError) as error:
        raise DataError(f"{file.name}: a damaged PCD file ({error})") from None
    return _from_fields(fields, file)


def _from_fields(fields: Mapping[str, Any], file: InputFile) -> Tracks:
    """Points from the fields x, y and z of a point cloud, and true labels from ``label``."""
    columns = {name.lower(): values for name, values in fields.items()}
    if not all(axis in columns for axis in _AXES):
        listed = ", ".join(columns)
        raise DataError(f"{file.name}: the points have the fields {listed}; expected x, y and z")
    points = np.stack([np.asarray(columns[axis], dtype=np.float64) for axis in _AXES], axis=1)
    labels = None
    for name in [n for n in columns if n in LABELS][:1]:
        labels = check_labels(columns[name], len(points), f"{file.name}: field '{name}'")
    return Tracks(points[:, None], labels=labels)


def _missing(file: InputFile, kind: str) -> UsageError:
    return UsageError(
        f"{file.name}: a {kind} file, which needs a package that is not installed: "
        "pip install 'mssegment[points]'"
    )
