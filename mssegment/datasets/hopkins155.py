"""Hopkins155 (Tron and Vidal, CVPR 2007): 155 sequences, tracks with true labels, no outliers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from mssegment.datasets.base import (
    DataSet,
    ImportedTracks,
    Variables,
    check_labels,
    check_points,
    frames_of_file,
)
from mssegment.datasets.matlab import load_matlab, numbers, scalar
from mssegment.errors import DataError
from mssegment.records import Tracks

_CHECKERBOARD = re.compile(r"\d(RT|R|T)\d(RT|R|T)C|three-cars")
_ARTICULATED = ("arm", "articulated", "head", "kanatani3", "people", "two_cranes")


def group_of(name: str, motions: int) -> str:
    """The group of the published tables: checkerboard, traffic or articulated, 2 or 3 motions.

    The data set's own naming decides (its readme): names that spell the motions of two objects and
    the camera, and ``three-cars``, are checkerboard; arms, heads and people are articulated; the
    other names (cars, trucks, kanatani1 and 2) are traffic.
    """
    if _CHECKERBOARD.match(name):
        scene = "checkerboard"
    elif name.startswith(_ARTICULATED):
        scene = "articulated"
    else:
        scene = "traffic"
    return f"{scene}-{motions}"


def recognises(variables: Variables) -> bool:
    """Whether a Matlab file is a sequence of Hopkins155."""
    return {"y", "s", "width", "height"} <= set(variables)


def read(path: Path) -> ImportedTracks:
    """Read ``<sequence>_truth.mat``.

    The pixels ``y`` are taken as they are. ``K`` is no camera: it only maps pixels to [-1, 1].
    A point whose homogeneous coordinate is 0 is not seen.
    """
    variables = load_matlab(path)
    homogeneous = numbers(variables, "y", path, (3, None, None))
    seen = np.isfinite(homogeneous).all(axis=0) & (homogeneous[2] != 0)
    if np.isinf(homogeneous).any():
        raise DataError(f"{path}: variable 'y' holds infinities; expected pixels")
    pixels = np.full((*homogeneous.shape[1:], 2), np.nan)
    pixels[seen] = (homogeneous[:2, seen] / homogeneous[2, seen]).T
    check_points(pixels, str(path))
    labels = check_labels(
        numbers(variables, "s", path, (None, None)), len(pixels), f"{path}: variable 's'"
    )
    name = path.stem.removesuffix("_truth")
    size = scalar(variables, "width", path), scalar(variables, "height", path)
    return ImportedTracks(
        name,
        Tracks(pixels, labels=labels),
        frames_of_file(path, range(pixels.shape[1]), *size),
        group=group_of(name, len(np.unique(labels[labels > 0]))),
    )


HOPKINS155 = DataSet("hopkins155", "Hopkins155", ".mat", recognises, read, pattern="**/*_truth.mat")
