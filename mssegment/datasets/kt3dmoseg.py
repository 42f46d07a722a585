"""KT3DMoSeg (Xu, Cheong and Li, CVPR 2018): clips of KITTI, tracks that begin and end anywhere."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    Variables,
    check_labels,
    check_points,
    frames_of_file,
    size_that_holds,
)
from mssegment.datasets.matlab import load_matlab, numbers
from mssegment.errors import DataError
from mssegment.records import IGNORED, Tracks

_FIELDS = ("ySparse", "visibleSparse", "GtLabel")


def recognises(variables: Variables) -> bool:
    """Whether a Matlab file is a clip of KT3DMoSeg."""
    return set(_FIELDS) <= set(_fields(variables))


def read(path: Path) -> ImportedTracks:
    """Read ``<clip>_Tracks.mat``: the sparse tracks, which are the labelled ones.

    Pixels count from 0, as everywhere here: the tracks of this set reach from -0.5 to width - 0.5.
    A track that is nowhere seen cannot be judged, its label becomes IGNORED.
    """
    variables = _fields(load_matlab(path))
    if not set(_FIELDS) <= set(variables):
        raise DataError(f"{path}: no struct 'Data' with the fields {', '.join(_FIELDS)}")
    homogeneous = numbers(variables, "ySparse", path, (3, None, None))
    visible = numbers(variables, "visibleSparse", path, homogeneous.shape[1:]) != 0
    if not np.isfinite(homogeneous[:, visible]).all():
        raise DataError(f"{path}: field 'ySparse' holds values that are not finite where seen")
    points = np.where(visible[..., None], np.moveaxis(homogeneous[:2], 0, -1), np.nan)
    check_points(points, str(path))
    labels = check_labels(variables["GtLabel"], len(points), f"{path}: field 'GtLabel'")
    labels[~visible.any(axis=1)] = IGNORED
    return ImportedTracks(
        path.stem.removesuffix("_Tracks"),
        Tracks(points, labels=labels),
        frames_of_file(path, range(points.shape[1]), *size_that_holds(points)),
        group="kt3dmoseg",
    )


def _fields(variables: Variables) -> dict[str, Any]:
    """The fields of the struct ``Data``, empty where the file has no such struct."""
    struct = variables.get("Data")
    if not isinstance(struct, np.ndarray) or struct.dtype.names is None or struct.size != 1:
        return {}
    record = struct.ravel()[0]
    return {name: record[name] for name in struct.dtype.names}


KT3DMOSEG = DataSet("kt3dmoseg", "KT3DMoSeg", ".mat", recognises, read, pattern="**/*_Tracks.mat")
