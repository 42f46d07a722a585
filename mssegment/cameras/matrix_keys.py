"""Cameras as a named matrix: OpenCV FileStorage, ROS camera_info, Open3D, ``numpy.savez``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from mssegment.cameras.base import (
    CameraFile,
    CameraFormat,
    Tree,
    camera_of_matrix,
    distortion_of,
    matrix_of,
    model_of,
    plain_keys,
    size_of,
)
from mssegment.records import Camera

_MATRIX = re.compile(
    r"(?:camera(?:intrinsics?)?matrix|intrinsics?matrix|intrinsics?|cameraintrinsics?|calibration"
    r"matrix|k|kk|kmat|kmatrix|mtx|m)(left|right|l|r|\d*)"
)


def read(file: CameraFile) -> dict[str, Camera]:
    """The cameras of a file: at its top, or one level below.

    Raises ConfigurationError for a matrix that is none of a camera.
    """
    found = cameras_of_tree(file.tree, file.name)
    if found:
        return found
    nested: dict[str, Camera] = {}
    for name, own in file.tree.items():
        if isinstance(own, Mapping):
            for suffix, camera in cameras_of_tree(own, f"{file.name}: {name}").items():
                nested[f"{name}.{suffix}" if suffix else str(name)] = camera
    return nested


def cameras_of_tree(tree: Tree, where: str) -> dict[str, Camera]:
    """The cameras by what follows the name of the matrix, as in M1 and M2.

    Raises ConfigurationError for a matrix that is none of a camera.
    """
    own = plain_keys(tree)
    matrices: dict[str, Any] = {}
    for key, value in own.items():
        match = _MATRIX.fullmatch(key)
        matrix = matrix_of(value) if match and "lensmodel" not in own else None
        if match and matrix is not None:
            matrices.setdefault(match[1], matrix)
    return {
        suffix: camera_of_matrix(
            matrix,
            f"{where}: {suffix}" if suffix else where,
            distortion_of(own, where, suffix) or (),
            model_of(own),
            size_of(own),
        )
        for suffix, matrix in matrices.items()
    }


MATRIX_KEYS = CameraFormat(
    "matrix_keys",
    "a named camera matrix (OpenCV FileStorage YAML/XML/JSON, ROS camera_info, Open3D, .npz, .mat)",
    read,
)
