"""KT3DMoSeg (Xu, Cheong and Li, CVPR 2018): clips of KITTI with incomplete tracks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mssegment.datasets.base import (
    Benchmark,
    DataSet,
    ImportedTracks,
    Published,
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
    """Whether the variables of a Matlab file are those of a KT3DMoSeg clip."""
    return set(_FIELDS) <= set(_fields(variables))


def read(path: Path) -> ImportedTracks:
    """Read ``<clip>_Tracks.mat``: the sparse tracks, which are the labelled ones.

    Pixel centres are at whole numbers from 0: the coordinates of this data set range from -0.5 to
    width - 0.5. A track that is visible in no frame gets the label IGNORED. Raises DataError if a
    field is missing or has invalid values.
    """
    variables = _fields(load_matlab(path))
    if not set(_FIELDS) <= set(variables):
        raise DataError(f"{path}: expected a struct 'Data' with the fields {', '.join(_FIELDS)}")
    homogeneous = numbers(variables, "ySparse", path, (3, None, None))
    visible = numbers(variables, "visibleSparse", path, homogeneous.shape[1:]) != 0
    if not np.isfinite(homogeneous[:, visible]).all():
        raise DataError(
            f"{path}: field 'ySparse' holds NaN or infinity where 'visibleSparse' is not 0; "
            "expected pixels"
        )
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
    """The fields of the struct ``Data``; empty if the file has no such struct."""
    struct = variables.get("Data")
    if not isinstance(struct, np.ndarray) or struct.dtype.names is None or struct.size != 1:
        return {}
    record = struct.ravel()[0]
    return {name: record[name] for name in struct.dtype.names}


BENCHMARK = Benchmark(
    {"hypothesize.model": "factorization", "background.remove": False},
    {},
    (
        Published(
            "multi-view spectral clustering (count given, 22 clips)",
            "all",
            "about 8",
            "Xu, Cheong, Li: Motion segmentation by exploiting complementary geometric "
            "models. CVPR 2018",
        ),
    ),
)

KT3DMOSEG = DataSet(
    "kt3dmoseg",
    "KT3DMoSeg",
    ".mat",
    recognises,
    read,
    pattern="**/*_Tracks.mat",
    benchmark=BENCHMARK,
)
