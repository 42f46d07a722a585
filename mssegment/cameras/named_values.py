"""Cameras whose values have names of their own: fx, fy, cx, cy and relatives."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from mssegment.cameras.base import (
    CameraFile,
    CameraFormat,
    Tree,
    camera,
    distortion_of,
    is_distortion,
    model_of,
    numbers_of,
    plain_keys,
    size_of,
)
from mssegment.cameras.nested import mappings_of
from mssegment.errors import ConfigurationError
from mssegment.records import Camera

_NAMES = (
    ("fx", "fy", "cx", "cy"),
    ("fx", "fy", "ppx", "ppy"),  # RealSense
    ("flx", "fly", "cx", "cy"),  # nerfstudio
    ("focalx", "focaly", "centerx", "centery"),
    ("focallengthx", "focallengthy", "principalpointx", "principalpointy"),
    ("f", "f", "cx", "cy"),
    ("focal", "focal", "cx", "cy"),
    ("focallength", "focallength", "cx", "cy"),
)
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FISHEYE = ("k1", "k2", "k3", "k4")
_FOCALS = ("fc", "focallength", "focallengths", "focal", "f", "foc")
_CENTRES = ("cc", "principalpoint", "opticalcenter", "center", "centre", "pp", "c")
_ORB_SLAM = re.compile(r"(camera\d*)\.(\w+)", re.IGNORECASE)


def read(file: CameraFile) -> dict[str, Camera]:
    """One camera, or one for each group of names: ORB-SLAM's ``Camera1.fx``, nested mappings.

    Raises ConfigurationError if only some of the values are there, or one is not valid.
    """
    groups: dict[str, dict[str, Any]] = {}
    for key, value in file.tree.items():
        if match := _ORB_SLAM.fullmatch(str(key)):
            groups.setdefault(match[1], {})[match[2]] = value
    # ORB-SLAM3 writes type and size once, and the values as Camera1, Camera2
    both = next((own for name, own in groups.items() if name.lower() == "camera"), {})
    found = {
        name: camera_of_tree({**both, **own}, f"{file.name}: {name}")
        for name, own in groups.items()
        if own is not both or len(groups) == 1
    }
    for name, own in mappings_of(file.tree):
        found[name] = camera_of_tree(own, f"{file.name}: {name}" if name else file.name)
    cameras = {name: camera for name, camera in found.items() if camera is not None}
    if len(set(cameras.values())) == 1 and all(name.startswith("frames.") for name in cameras):
        return {"": next(iter(cameras.values()))}  # the same for every picture
    return cameras


def camera_of_tree(tree: Tree, where: str) -> Camera | None:
    """The camera that a mapping describes; None if it has none of the names.

    Raises ConfigurationError if only some of the values are there, or one is not valid.
    """
    own = plain_keys(tree)
    if _first(own.get("xi")) or _first(own.get("alpha")):
        raise ConfigurationError(
            f"{where}: a double sphere or unified model (xi, alpha); expected Brown's model, or "
            "the fisheye one (Kannala-Brandt)"
        )
    own = _with_vectors(own)
    if "cameraanglex" in own and "flx" not in own:
        return _of_angle(own, where)
    names = max(_NAMES, key=lambda names: sum(name in own for name in names))
    present = [name for name in names if name in own]
    if not {names[0], names[1]} & set(present):
        return None
    missing = [name for name in names if name not in own]
    if missing:
        raise ConfigurationError(
            f"{where}: camera.{_NAMES[0][names.index(missing[0])]} is missing; a camera needs fx, "
            "fy, cx, cy"
        )
    values = []
    for name in names:
        value = numbers_of(own[name])
        if value is None or value.size != 1:
            raise ConfigurationError(f"{where}: {name} is {own[name]!r}; expected a number")
        values.append(float(value.ravel()[0]))
    model = model_of(own)
    fx, fy, cx, cy = values
    _check_misspelt(own, where)
    return camera(where, fx, fy, cx, cy, _distortion(own, where, model), model, size_of(own))


def _first(value: Any) -> float:
    """A number, 0 for anything else."""
    found = None if value is None else numbers_of(value)
    return float(found.ravel()[0]) if found is not None and found.size == 1 else 0.0


def _with_vectors(own: dict[str, Any]) -> dict[str, Any]:
    """The values with fx, fy and cx, cy from vectors of two: ``fc`` and ``cc``, and relatives."""
    found = dict(own)
    for names, axes in ((_FOCALS, ("fx", "fy")), (_CENTRES, ("cx", "cy"))):
        for name in names:
            values = numbers_of(own[name]) if name in own else None
            if values is not None and values.size == 2 and not set(axes) & set(own):
                del found[name]
                found |= dict(zip(axes, values.ravel().tolist(), strict=True))
                break
    return found


def _of_angle(own: Mapping[str, Any], where: str) -> Camera:
    """The camera of NeRF's ``camera_angle_x``, the horizontal field of view in radians."""
    angle, size = numbers_of(own["cameraanglex"]), size_of(own)
    if angle is None or angle.size != 1 or not 0 < float(angle) < math.pi:
        raise ConfigurationError(
            f"{where}: camera_angle_x is {own['cameraanglex']!r}; expected radians, between 0 and "
            "3.14"
        )
    if size is None:
        raise ConfigurationError(
            f"{where}: camera_angle_x without w and h: add the size of the pictures in pixels"
        )
    focal = 0.5 * size[0] / math.tan(0.5 * float(angle))
    return camera(where, focal, focal, 0.5 * (size[0] - 1), 0.5 * (size[1] - 1), size=size)


def _check_misspelt(own: Mapping[str, Any], where: str) -> None:
    """Raises ConfigurationError for a key that is nearly ``distortion``, which would be missed."""
    import difflib

    for key in own:
        near = difflib.get_close_matches(key, ["distortion"], cutoff=0.8)
        known = key in ("distortionmodel", "distortiontype") or is_distortion(key)
        if near and not known:
            raise ConfigurationError(f"{where}: unknown key {key}; did you mean distortion?")


def _distortion(own: Mapping[str, Any], where: str, model: str | None) -> list[float]:
    listed = distortion_of(own, where)
    if listed is not None:
        return listed
    is_fisheye = "p1" not in own and model is not None
    order = _FISHEYE if is_fisheye and "k3" in own else _COEFFICIENTS
    values = []
    for name in order:
        found = numbers_of(own.get(name, 0.0))
        if found is None or found.size != 1:
            raise ConfigurationError(f"{where}: {name} is {own[name]!r}; expected a number")
        values.append(float(found))
    while values and not values[-1]:
        values.pop()
    return values


NAMED_VALUES = CameraFormat(
    "named_values",
    "fx, fy, cx, cy in YAML or JSON (own format, RealSense, ORB-SLAM, nerfstudio)",
    read,
)
