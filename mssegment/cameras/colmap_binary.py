"""COLMAP's ``cameras.bin``."""

from __future__ import annotations

import struct

from mssegment.cameras.base import CameraFile, CameraFormat
from mssegment.cameras.colmap import camera_of_model
from mssegment.errors import ConfigurationError
from mssegment.records import Camera

_MODELS = (
    *(("SIMPLE_PINHOLE", 3), ("PINHOLE", 4), ("SIMPLE_RADIAL", 4), ("RADIAL", 5)),
    *(("OPENCV", 8), ("OPENCV_FISHEYE", 8), ("FULL_OPENCV", 12), ("FOV", 5)),
    *(("SIMPLE_RADIAL_FISHEYE", 4), ("RADIAL_FISHEYE", 5), ("THIN_PRISM_FISHEYE", 12)),
)
"""The models by their number, and how many parameters each has."""
_HEAD = struct.Struct("<iiQQ")


def read(file: CameraFile) -> dict[str, Camera]:
    """The cameras by their identifier.

    Raises ConfigurationError for a damaged file, or a camera model that is not known.
    """
    if not file.name.lower().endswith(".bin"):
        return {}
    found = {}
    place = 8
    try:
        (count,) = struct.unpack_from("<Q", file.content)
        for _ in range(count):
            number, model, width, height = _HEAD.unpack_from(file.content, place)
            if not 0 <= model < len(_MODELS):
                break
            name, length = _MODELS[model]
            values = struct.unpack_from(f"<{length}d", file.content, place + _HEAD.size)
            place += _HEAD.size + 8 * length
            where = f"{file.name}: camera {number}"
            found[str(number)] = camera_of_model(where, name, (width, height), list(values))
    except struct.error:
        count = -1
    if not found or len(found) != count:
        raise ConfigurationError(
            f"{file.name}: a damaged file, or none of COLMAP's cameras; expected cameras.bin"
        )
    return found


COLMAP_BINARY = CameraFormat("colmap_binary", "COLMAP cameras.bin", read)
