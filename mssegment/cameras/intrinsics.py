"""Kalibr's camchain and EuRoC's sensor.yaml: ``intrinsics: [fu, fv, pu, pv]``."""

from __future__ import annotations

import re
from collections.abc import Mapping

from mssegment.cameras.base import (
    CameraFile,
    CameraFormat,
    Tree,
    camera,
    distortion_of,
    model_of,
    numbers_of,
    plain,
    plain_keys,
    size_of,
)
from mssegment.errors import ConfigurationError
from mssegment.records import Camera, Floats


def read(file: CameraFile) -> dict[str, Camera]:
    """The camera of the file, or one for each of cam0, cam1, ...

    Raises ConfigurationError for a camera model other than pinhole.
    """
    found = {"": _camera(file.tree, file.name)}
    for name, own in file.tree.items():
        if isinstance(own, Mapping):
            found[str(name)] = _camera(own, f"{file.name}: {name}")
    return {name: camera for name, camera in found.items() if camera is not None}


def _camera(tree: Tree, where: str) -> Camera | None:
    own = plain_keys(tree)
    values = numbers_of(own["intrinsics"]) if "intrinsics" in own else None
    if values is None or values.ndim != 1:
        return None
    if "lensmodel" in own:
        return _of_mrcal(str(own["lensmodel"]), values, where, size_of(own))
    kind = str(own.get("cameramodel", "pinhole"))
    if plain(kind) not in ("pinhole", "perspective") or len(values) != 4:
        raise ConfigurationError(
            f"{where}: camera model {kind} with {len(values)} intrinsics; expected pinhole with "
            "fu, fv, pu, pv (calibrate again with pinhole-radtan or pinhole-equi)"
        )
    coefficients = distortion_of(own, where) or []
    fu, fv, pu, pv = values.tolist()
    return camera(where, fu, fv, pu, pv, coefficients, model_of(own), size_of(own))


def _of_mrcal(model: str, values: Floats, where: str, size: tuple[int, int] | None) -> Camera:
    """mrcal: fx, fy, cx, cy and OpenCV's coefficients in one list."""
    match = re.fullmatch(r"LENSMODEL_(PINHOLE|OPENCV(4|5|8))", model)
    if match is None or len(values) != 4 + int(match[2] or 0):
        raise ConfigurationError(
            f"{where}: lensmodel {model} with {len(values)} intrinsics; expected LENSMODEL_PINHOLE "
            "or LENSMODEL_OPENCV4, 5 or 8"
        )
    fx, fy, cx, cy, *bent = values.tolist()
    return camera(where, fx, fy, cx, cy, bent, None, size)


INTRINSICS = CameraFormat("intrinsics", "Kalibr camchain, EuRoC sensor.yaml, mrcal", read)
