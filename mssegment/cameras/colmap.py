"""COLMAP's cameras: ``cameras.txt``, hloc's lists of pictures, pycolmap's dictionaries."""

from __future__ import annotations

import re

from mssegment.cameras.base import (
    CameraFile,
    CameraFormat,
    camera,
    numbers_of,
    plain_keys,
    size_of,
)
from mssegment.errors import ConfigurationError
from mssegment.records import Camera

_CENTRE = 0.5
"""COLMAP's centre of the first pixel."""
_LINE = re.compile(r"(?:(\S+)\s+)?([A-Z][A-Z_]+)\s+(\d+)\s+(\d+)((?:\s+[-+.\deE]+)+)")
_FOCALS = {
    "SIMPLE_PINHOLE": 1,
    "PINHOLE": 2,
    "SIMPLE_RADIAL": 1,
    "RADIAL": 1,
    "OPENCV": 2,
    "FULL_OPENCV": 2,
    "OPENCV_FISHEYE": 2,
    "SIMPLE_RADIAL_FISHEYE": 1,
    "RADIAL_FISHEYE": 1,
}
"""The models that can be read, and how many focal lengths each has."""


def read(file: CameraFile) -> dict[str, Camera]:
    """The cameras by their identifier, or by the picture that they belong to.

    Pixel centres, which COLMAP counts from 0.5, are moved to whole numbers. Raises
    ConfigurationError for a camera model that is not known.
    """
    lines = [line.strip() for line in file.text.splitlines() if not line.lstrip().startswith("#")]
    matches = [_LINE.fullmatch(line) for line in lines if line]
    if not matches or not all(matches):
        return _of_dictionary(file)
    found = [match for match in matches if match]
    # a single camera needs no name
    names = [match[1] or (str(i) if found[1:] else "") for i, match in enumerate(found, start=1)]
    return {
        name: camera_of_model(
            f"{file.name}: camera {name}" if name else file.name,
            match[2],
            (int(match[3]), int(match[4])),
            [float(word) for word in match[5].split()],
        )
        for name, match in zip(names, found, strict=True)
    }


def _of_dictionary(file: CameraFile) -> dict[str, Camera]:
    """The camera that pycolmap writes as ``{model, width, height, params}``."""
    tree = file.tree
    model, size = tree.get("model"), size_of(plain_keys(tree))
    values = numbers_of(tree.get("params")) if "params" in tree else None
    if not isinstance(model, str) or values is None or size is None:
        return {}
    return {"": camera_of_model(file.name, model, size, values.ravel().tolist())}


def camera_of_model(where: str, model: str, size: tuple[int, int], values: list[float]) -> Camera:
    """The camera of a model of COLMAP; raises ConfigurationError for one that is not known."""
    if model not in _FOCALS:
        raise ConfigurationError(
            f"{where}: camera model {model}; expected one of {', '.join(_FOCALS)}"
        )
    focals = _FOCALS[model]
    if len(values) < focals + 2:
        raise ConfigurationError(f"{where}: {len(values)} parameters of {model}; expected more")
    fx, fy = values[0], values[focals - 1]
    cx, cy = (value - _CENTRE for value in values[focals : focals + 2])
    return camera(where, fx, fy, cx, cy, values[focals + 2 :], model, size)


COLMAP = CameraFormat("colmap", "COLMAP cameras.txt, hloc's list of pictures, pycolmap", read)
