"""AdelaideRMF (Wong, Chin, Yu and Suter, ICCV 2011): image pairs with labelled SIFT matches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

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
from mssegment.datasets.matlab import numbers
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


def read(file: InputFile) -> ImportedTracks:
    """Read ``<pair>.mat``: the matches (x1 y1 1 x2 y2 1, in pixels), labels and both pictures.

    The pictures may be missing.

    Raises DataError if a variable is missing or has invalid values.
    """
    variables, path = file.variables, file.name
    matches = numbers(variables, "data", path, (6, None))
    if not np.isfinite(matches).all():
        raise DataError(f"{path}: variable 'data' holds NaN or infinity; expected finite pixels")
    if (matches[[2, 5]] == 0).any():
        raise DataError(
            f"{path}: variable 'data' has points at infinity (third coordinate 0); expected pixels"
        )
    first, second = matches[:2] / matches[2], matches[3:5] / matches[5]
    points = np.stack([first.T, second.T], axis=1)
    check_points(points, path)
    labels = check_labels(variables["label"], len(points), f"{path}: variable 'label'")
    names = [name for name in ("img1", "img2") if name in variables]
    pictures = tuple(_picture(variables, name, path) for name in names) if len(names) == 2 else ()
    sizes = [p.shape[1::-1] for p in pictures] or [size_that_holds(points)] * 2
    frames = frames_inside(path, file.content, range(2), 1, 1)
    sized = tuple(
        Frame(frame.path, size[0], size[1], frame.sha256, frame.index)
        for frame, size in zip(frames, sizes, strict=True)
    )
    stem = file.path.stem
    return ImportedTracks(
        stem, Tracks(points, labels=labels), sized, group=group_of(stem), pictures=pictures
    )


def _picture(variables: Variables, name: str, path: str) -> npt.NDArray[np.uint8]:
    picture = np.asarray(variables[name])
    is_picture = picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] in (1, 3, 4))
    if picture.dtype != np.uint8 or not is_picture or not picture.size:
        raise DataError(
            f"{path}: variable '{name}' is {picture.dtype} {picture.shape}; expected an 8-bit "
            "image, [height, width] or [height, width, 3]"
        )
    if picture.ndim == 2 or picture.shape[2] == 1:
        picture = np.repeat(picture.reshape(*picture.shape[:2], 1), 3, axis=2)
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
    "adelaidermf",
    "AdelaideRMF",
    ("matlab",),
    recognises,
    read,
    pattern="**/*.mat",
    benchmark=BENCHMARK,
)
