"""Rigs and reconstructions whose cameras stand in lists: Basalt, OKVIS, SVO, openMVG, OpenSfM."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mssegment.cameras.base import (
    CameraFile,
    CameraFormat,
    Tree,
    camera,
    numbers_of,
    plain,
    plain_keys,
    size_of,
)
from mssegment.cameras.named_values import camera_of_tree
from mssegment.errors import ConfigurationError
from mssegment.records import Camera

_OPENMVG = {
    "pinhole": ("", "brown"),
    "pinhole_radial_k1": ("disto_k1", "brown"),
    "pinhole_radial_k3": ("disto_k3", "brown"),
    "pinhole_brown_t2": ("disto_t2", "brown"),
    "fisheye": ("fisheye", "fisheye"),
}
"""The list of coefficients of each model of openMVG, and our name of the model."""


def read(file: CameraFile) -> dict[str, Camera]:
    """The cameras by their place in the file, or by the name that it gives them.

    Raises ConfigurationError for a camera model that is not known, or a value that is missing.
    """
    tree = file.tree
    inner = tree.get("value0")
    own: Tree = inner if isinstance(inner, Mapping) else tree
    if "sfm_data_version" in tree:
        return _of_openmvg(tree, file.name)
    if any(_is_opensfm(value) for value in tree.values()):
        return {str(k): _of_opensfm(v, f"{file.name}: {k}") for k, v in tree.items()}
    cameras = own.get("cameras")
    if isinstance(own.get("intrinsics"), list | Mapping):
        return _of_basalt(own, file.name)
    if isinstance(cameras, list):
        return _of_rig(cameras, file.name)
    return {}


def _of_basalt(tree: Tree, where: str) -> dict[str, Camera]:
    """Basalt: ``intrinsics`` a list of types with values, ``resolution`` a list beside it."""
    entries = tree["intrinsics"] if isinstance(tree["intrinsics"], list) else [tree["intrinsics"]]
    if not all(isinstance(e, Mapping) and {"camera_type", "intrinsics"} <= set(e) for e in entries):
        return {}
    sizes = tree.get("resolution")
    sizes = sizes if isinstance(sizes, list) and len(sizes) == len(entries) else [sizes]
    found = {}
    for i, entry in enumerate(entries):
        name, kind = f"cam{i}", str(entry["camera_type"])
        values = {**entry["intrinsics"], "resolution": sizes[i % len(sizes)]}
        model = {"kb4": "kb4", "pinhole": "pinhole", "pinhole-radtan8": "rational"}.get(kind)
        is_pinhole = kind in ("ds", "eucm", "ucm") and not values.get("alpha")
        if model is None and not (is_pinhole and not values.get("xi")):
            raise ConfigurationError(
                f"{where}: {name}: camera_type {kind}; expected pinhole, pinhole-radtan8 or kb4 "
                "(calibrate again with --cam-types kb4)"
            )
        values = {k: v for k, v in values.items() if k not in ("xi", "alpha", "beta")}
        own = camera_of_tree({**values, "distortion_model": model}, f"{where}: {name}")
        if own is not None:
            found[name] = own
    return found


def _of_rig(cameras: list[Any], where: str) -> dict[str, Camera]:
    """The cameras of OKVIS (vectors ``focal_length``, ``principal_point``) and SVO (matrices)."""
    found = {}
    for i, entry in enumerate(cameras):
        own = entry.get("camera", entry) if isinstance(entry, Mapping) else None
        if not isinstance(own, Mapping):
            continue
        name = str(own.get("label", f"cam{i}"))
        lens = own.get("distortion")
        if isinstance(lens, Mapping) and "parameters" in lens:
            values = numbers_of(own.get("intrinsics"))
            bent = numbers_of(lens["parameters"])
            if values is None or values.size != 4 or bent is None:
                raise ConfigurationError(
                    f"{where}: {name}: expected pinhole with four intrinsics, and a list of "
                    "distortion parameters"
                )
            kind = str(lens.get("type", "radial-tangential"))
            fx, fy, cx, cy = map(float, values.ravel())
            listed, size = bent.ravel().tolist(), size_of(plain_keys(own))
            found[name] = camera(f"{where}: {name}", fx, fy, cx, cy, listed, kind, size)
        elif (given := camera_of_tree(own, f"{where}: {name}")) is not None:
            found[name] = given
    return found


def _of_openmvg(tree: Tree, where: str) -> dict[str, Camera]:
    """openMVG's ``sfm_data.json``: the name of a model is written where it is first used."""
    titles: dict[int, str] = {}
    found = {}
    entries = tree.get("intrinsics")
    for entry in entries if isinstance(entries, list) else []:
        key, value = str(entry["key"]), entry["value"]
        number = int(value.get("polymorphic_id", 0)) & 0x7FFFFFFF
        titles.setdefault(number, str(value.get("polymorphic_name", "")))
        name, data = titles[number], value["ptr_wrapper"]["data"]
        if name not in _OPENMVG:
            raise ConfigurationError(
                f"{where}: camera {key}: model {name}; expected one of {', '.join(_OPENMVG)}"
            )
        listed, model = _OPENMVG[name]
        data = {**data.get("value0", {}), **data}
        bent = _openmvg_distortion(data.get(listed) if listed else [], model)
        focal, centre = float(data["focal_length"]), data["principal_point"]
        size = int(data["width"]), int(data["height"])
        place = f"{where}: camera {key}"
        found[key] = camera(place, focal, focal, centre[0], centre[1], bent, model, size)
    if not found:
        raise ConfigurationError(f"{where}: no intrinsics in this file of openMVG; calibrate first")
    return found


def _openmvg_distortion(values: Any, model: str) -> list[float]:
    """Radial terms first, then tangential ones, in OpenCV's order."""
    listed = [float(value) for value in values or []]
    if model == "fisheye" or not listed:
        return listed
    k1, k2, k3, p1, p2 = [*listed, 0.0, 0.0, 0.0, 0.0][:5]
    return [k1, k2, p1, p2, k3]


def _is_opensfm(value: Any) -> bool:
    return isinstance(value, Mapping) and {"projection_type", "width", "height"} <= set(value)


def _of_opensfm(values: Any, where: str) -> Camera:
    """OpenSfM: lengths in units of the longer side, from the centre of the picture."""
    if not _is_opensfm(values):
        raise ConfigurationError(f"{where}: not a camera of OpenSfM; expected projection_type")
    kind = plain(str(values["projection_type"]))
    model = {"perspective": "brown", "brown": "brown", "fisheye": "fisheye"}.get(kind)
    if model is None:
        raise ConfigurationError(
            f"{where}: projection_type {values['projection_type']}; expected perspective, brown or "
            "fisheye"
        )
    width, height = int(values["width"]), int(values["height"])
    side = max(width, height)
    fx = values.get("focal_x", values.get("focal"))
    fy = values.get("focal_y", fx)
    if fx is None:
        raise ConfigurationError(f"{where}: focal is missing; expected the file of OpenSfM")
    order = ("k1", "k2", "k3", "k4") if model == "fisheye" else ("k1", "k2", "p1", "p2", "k3")
    bent = [float(values.get(name, 0.0)) for name in order]
    cx = float(values.get("c_x", 0.0)) * side + 0.5 * (width - 1)
    cy = float(values.get("c_y", 0.0)) * side + 0.5 * (height - 1)
    return camera(where, float(fx) * side, float(fy) * side, cx, cy, bent, model, (width, height))


LISTS = CameraFormat(
    "lists", "Basalt's calibration.json, OKVIS, SVO, openMVG's sfm_data.json, OpenSfM", read
)
