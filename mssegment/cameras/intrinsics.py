"""Kalibr's camchain and EuRoC's sensor.yaml: ``intrinsics: [fu, fv, pu, pv]``."""

from __future__ import annotations

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
from mssegment.records import Camera


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
    kind = str(own.get("cameramodel", "pinhole"))
    if plain(kind) not in ("pinhole", "perspective") or len(values) != 4:
        raise ConfigurationError(
            f"{where}: camera model {kind} with {len(values)} intrinsics; expected pinhole with "
            "fu, fv, pu, pv (calibrate again with pinhole-radtan or pinhole-equi)"
        )
    coefficients = distortion_of(own, where) or []
    fu, fv, pu, pv = values.tolist()
    return camera(where, fu, fv, pu, pv, coefficients, model_of(own), size_of(own))


INTRINSICS = CameraFormat("intrinsics", "Kalibr camchain, EuRoC sensor.yaml", read)
