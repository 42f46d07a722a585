"""Hopkins155 (Tron and Vidal, CVPR 2007): 155 sequences, tracks with true labels, no outliers."""

from __future__ import annotations

import re

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
from mssegment.datasets.matlab import numbers, scalar
from mssegment.errors import DataError
from mssegment.records import Integers, Tracks

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
    if {"y", "s", "width", "height"} <= set(variables):
        return True
    y = variables.get("y")
    return isinstance(y, np.ndarray) and y.ndim == 3 and len(y) == 3


def read(file: InputFile) -> ImportedTracks:
    """Read ``<sequence>_truth.mat``.

    The tracks are the pixels ``y``. ``K`` is not used: it is not a calibration but only maps pixels
    to [-1, 1]. A point whose homogeneous coordinate is 0 is not visible in that frame. Labels and
    the size of the images may be missing. Raises DataError if a variable has invalid values.
    """
    variables, name = file.variables, file.name
    homogeneous = numbers(variables, "y", name, (3, None, None))
    seen = np.isfinite(homogeneous).all(axis=0) & (homogeneous[2] != 0)
    if np.isinf(homogeneous).any():
        raise DataError(f"{name}: variable 'y' holds infinity; expected pixels")
    pixels = np.full((*homogeneous.shape[1:], 2), np.nan)
    pixels[seen] = (homogeneous[:2, seen] / homogeneous[2, seen]).T
    check_points(pixels, name)
    labels, notes = _labels(variables, len(pixels), name)
    sequence = file.path.stem.removesuffix("_truth")
    size = size_that_holds(pixels)
    if {"width", "height"} <= set(variables):
        size = scalar(variables, "width", name), scalar(variables, "height", name)
    motions = 0 if labels is None else len(np.unique(labels[labels > 0]))
    return ImportedTracks(
        sequence,
        Tracks(pixels, labels=labels),
        frames_inside(name, file.content, range(pixels.shape[1]), *size),
        group=group_of(sequence, motions),
        notes=notes,
    )


def _labels(variables: Variables, count: int, name: str) -> tuple[Integers | None, tuple[str, ...]]:
    if "s" not in variables:
        return None, ()
    labels = check_labels(
        numbers(variables, "s", name, (None, None)), count, f"{name}: variable 's'"
    )
    if count and labels.min() == 0:
        # this data set has no outliers
        return labels + 1, ("the labels s begin at 0: they are read as the motions 1, 2, ...",)
    return labels, ()


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
    ("matlab",),
    recognises,
    read,
    pattern="**/*_truth.mat",
    benchmark=BENCHMARK,
)
