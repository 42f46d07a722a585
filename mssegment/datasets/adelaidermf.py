"""AdelaideRMF (Wong, Chin, Yu and Suter, ICCV 2011): image pairs with labelled SIFT matches."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

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
from mssegment.datasets.matlab import load_matlab, numbers
from mssegment.errors import DataError
from mssegment.records import Frame, Tracks

_PLANES = frozenset(
    {
        "barrsmith",
        "bonhall",
        "bonython",
        "elderhalla",
        "elderhallb",
        "hartley",
        "johnsona",
        "johnsonb",
        "ladysymon",
        "library",
        "napiera",
        "napierb",
        "neem",
        "nese",
        "oldclassicswing",
        "physics",
        "sene",
        "unihouse",
        "unionhouse",
    }
)


def group_of(name: str) -> str:
    """``plane`` for the homography pairs listed in the data set's readme, otherwise ``motion``."""
    return "plane" if name.lower() in _PLANES else "motion"


def recognises(variables: Variables) -> bool:
    """Whether the variables of a Matlab file are those of an AdelaideRMF pair."""
    return {"data", "label"} <= set(variables)


def read(path: Path) -> ImportedTracks:
    """Read ``<pair>.mat``: the matches (x1 y1 1 x2 y2 1, in pixels), labels and both pictures.

    Raises DataError if a variable is missing or has invalid values.
    """
    variables = load_matlab(path)
    matches = numbers(variables, "data", path, (6, None))
    if not np.isfinite(matches).all():
        raise DataError(f"{path}: variable 'data' holds NaN or infinity; expected finite pixels")
    if (matches[[2, 5]] == 0).any():
        raise DataError(
            f"{path}: variable 'data' has points at infinity (third coordinate 0); expected pixels"
        )
    first, second = matches[:2] / matches[2], matches[3:5] / matches[5]
    points = np.stack([first.T, second.T], axis=1)
    check_points(points, str(path))
    labels = check_labels(variables["label"], len(points), f"{path}: variable 'label'")
    pictures = tuple(_picture(variables, name, path) for name in ("img1", "img2"))
    frames = frames_of_file(path, range(2), 1, 1)
    sized = tuple(
        Frame(frame.path, picture.shape[1], picture.shape[0], frame.sha256, frame.index)
        for frame, picture in zip(frames, pictures, strict=True)
    )
    return ImportedTracks(
        path.stem,
        Tracks(points, labels=labels),
        sized,
        group=group_of(path.stem),
        pictures=pictures,
    )


def _picture(variables: Variables, name: str, path: Path) -> npt.NDArray[np.uint8]:
    if name not in variables:
        raise DataError(f"{path}: no variable '{name}'; expected the two images img1 and img2")
    picture = np.asarray(variables[name])
    if picture.dtype != np.uint8 or picture.ndim not in (2, 3) or not picture.size:
        raise DataError(
            f"{path}: variable '{name}' is {picture.dtype} {picture.shape}; expected an 8-bit image"
        )
    if picture.ndim == 2:
        picture = np.repeat(picture[:, :, None], 3, axis=2)
    return np.ascontiguousarray(picture[:, :, :3])


BENCHMARK = Benchmark(
    {"background.remove": False},
    {
        "motion": {"segment.granularity": "object", "hypothesize.model": "auto"},
        "plane": {
            "segment.granularity": "surface",
            "hypothesize.model": "homography",
        },
    },
    (
        Published(
            "Progressive-X (count unknown, 19 pairs)",
            "motion",
            "10.9",
            "Barath, Matas: Progressive-X. ICCV 2019",
        ),
        Published(
            "Progressive-X (count unknown, 17 pairs)",
            "plane",
            "6.4",
            "Barath, Matas: Progressive-X. ICCV 2019",
        ),
    ),
)

ADELAIDERMF = DataSet(
    "adelaidermf", "AdelaideRMF", ".mat", recognises, read, pattern="**/*.mat", benchmark=BENCHMARK
)
