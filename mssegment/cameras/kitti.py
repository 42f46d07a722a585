"""KITTI's ``calib.txt`` (P0 ... P3) and ``calib_cam_to_cam.txt`` (P_rect_00, K_00, D_00)."""

from __future__ import annotations

import re

import numpy as np

from mssegment.cameras.base import CameraFile, CameraFormat, camera_of_matrix
from mssegment.records import Camera, Floats

_ENTRY = re.compile(r"^(P\w*|K_\w*|D_\w*|S_\w*):((?: +[-+]?[\d.]+(?:[eE][-+]?\d+)?)+) *$", re.M)
_CAMERA = re.compile(r"P\d|P_rect_\d\d|K_\d\d|P_rect_cam\d")


def read(file: CameraFile) -> dict[str, Camera]:
    """The rectified cameras (P...) and the raw ones (K...), by the names of the file.

    Raises ConfigurationError for a matrix that is none of a camera.
    """
    values = {
        match[1]: np.array([float(word) for word in match[2].split()])
        for match in _ENTRY.finditer(file.text)
    }
    return {
        name: camera_of_matrix(
            own.reshape(3, -1),
            f"{file.name}: {name}",
            values.get(name.replace("K_", "D_"), np.empty(0)).tolist() if name[0] == "K" else (),
            None,
            _size(values, name),
        )
        for name, own in values.items()
        if _CAMERA.fullmatch(name) and own.size in (9, 12)
    }


def _size(values: dict[str, Floats], name: str) -> tuple[int, int] | None:
    key = name.replace("P_rect_", "S_rect_").replace("K_", "S_")
    if key == name or key not in values or values[key].size != 2:
        return None
    return int(values[key][0]), int(values[key][1])


KITTI = CameraFormat("kitti", "KITTI calib.txt (P0 ... P3), calib_cam_to_cam.txt", read)
