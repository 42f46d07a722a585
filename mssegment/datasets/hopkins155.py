"""Hopkins155 (Tron and Vidal, CVPR 2007): 155 sequences, tracks with true labels, no outliers."""

from __future__ import annotations

import re
from pathlib import Path

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
)
from mssegment.datasets.matlab import load_matlab, numbers, scalar
from mssegment.errors import DataError
from mssegment.records import Tracks

_CHECKERBOARD = re.compile(r"\d(RT|R|T)\d(RT|R|T)C|three-cars")
_ARTICULATED = ("arm", "articulated", "head", "kanatani3", "people", "two_cranes")


def group_of(name: str, motions: int) -> str:
    """The group of a sequence in the published tables, for example ``checkerboard-2``.

    Parameters
    ----------
    name : str
        The name of the sequence.
    motions : int
        The true number of motions.

    Returns
    -------
    str
        ``checkerboard``, ``traffic`` or ``articulated``, and the number of motions.

    Notes
    -----
    The names follow the readme of the data set. Names that list the motions of two objects and the
    camera, and ``three-cars``, are checkerboard sequences; arms, heads and people are articulated;
    all other names (cars, trucks, kanatani1 and kanatani2) are traffic.
    """
    if _CHECKERBOARD.match(name):
        scene = "checkerboard"
    elif name.startswith(_ARTICULATED):
        scene = "articulated"
    else:
        scene = "traffic"
    return f"{scene}-{motions}"


def recognises(variables: Variables) -> bool:
    """Whether the variables of a Matlab file are those of a Hopkins155 sequence."""
    return {"y", "s", "width", "height"} <= set(variables)


def read(path: Path) -> ImportedTracks:
    """Read ``<sequence>_truth.mat``.

    The tracks are the pixels ``y``. ``K`` is not used: it is not a calibration but only maps pixels
    to [-1, 1]. A point whose homogeneous coordinate is 0 is not visible in that frame. Raises
    DataError if a variable is missing or has invalid values.
    """
    variables = load_matlab(path)
    homogeneous = numbers(variables, "y", path, (3, None, None))
    seen = np.isfinite(homogeneous).all(axis=0) & (homogeneous[2] != 0)
    if np.isinf(homogeneous).any():
        raise DataError(f"{path}: variable 'y' holds infinity; expected pixels")
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


BENCHMARK = Benchmark(
    # in this data set the background is one of the motions
    {"hypothesize.model": "factorization", "background.remove": False},
    {},
    (
        Published(
            "RSIM (count given, 155 sequences)",
            "all",
            "0.79-0.89",
            "Ji, Salzmann, Li: Shape interaction matrix revisited and robustified. ICCV 2015",
        ),
        Published(
            "SSC (count given, 155 sequences)",
            "all",
            "about 2",
            "Elhamifar, Vidal: Sparse subspace clustering. PAMI 2013",
        ),
    ),
)

HOPKINS155 = DataSet(
    "hopkins155",
    "Hopkins155",
    ".mat",
    recognises,
    read,
    pattern="**/*_truth.mat",
    benchmark=BENCHMARK,
)
