"""KT3DMoSeg (Xu, Cheong and Li, CVPR 2018): clips of KITTI with incomplete tracks."""

from __future__ import annotations

import numpy as np

from mssegment.datasets.base import (
    Benchmark,
    DataSet,
    ImportedTracks,
    Published,
    check_labels,
    check_points,
    frames_inside,
    size_that_holds,
)
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.matlab import fields_of, numbers
from mssegment.errors import DataError
from mssegment.records import IGNORED, Tracks

_FIELDS = ("ySparse", "visibleSparse", "GtLabel")


def recognises(variables: Variables) -> bool:
    """Whether the variables of a Matlab file are those of a KT3DMoSeg clip."""
    return set(_FIELDS) <= set(fields_of(variables.get("Data")))


def read(file: InputFile) -> ImportedTracks:
    """Read ``<clip>_Tracks.mat``: the sparse tracks, which are the labelled ones.

    Pixel centres are at whole numbers from 0: the coordinates of this data set range from -0.5 to
    width - 0.5. A track that is visible in no frame gets the label IGNORED. Raises DataError if a
    field is missing or has invalid values.
    """
    variables, path = fields_of(file.variables.get("Data")), file.name
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
    check_points(points, path)
    labels = check_labels(variables["GtLabel"], len(points), f"{path}: field 'GtLabel'")
    labels[~visible.any(axis=1)] = IGNORED
    return ImportedTracks(
        file.path.stem.removesuffix("_Tracks"),
        Tracks(points, labels=labels),
        frames_inside(path, file.content, range(points.shape[1]), *size_that_holds(points)),
        group="kt3dmoseg",
    )


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
    ("matlab",),
    recognises,
    read,
    pattern="**/*_Tracks.mat",
    benchmark=BENCHMARK,
)
