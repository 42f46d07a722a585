"""Cameras whose principal point is counted from the centre: Meshroom and Metashape."""

from __future__ import annotations

from typing import Any

from mssegment.cameras.base import CameraFile, CameraFormat, Tree, camera
from mssegment.errors import ConfigurationError
from mssegment.records import Camera

_MESHROOM = {
    "pinhole": "",
    "radial1": "radial",
    "radial3": "radial",
    "radialk1": "radial",
    "radialk3": "radial",
    "brown": "brown",
    "fisheye4": "fisheye",
    "equidistant_pinhole": "",
}
"""How the coefficients of each model of Meshroom are ordered."""
LARGEST_SKEW = 1e-3
"""Metashape's b2, in pixels per unit of its normalised coordinates, that is left out."""


def read(file: CameraFile) -> dict[str, Camera]:
    """The cameras of ``cameras.sfm`` (Meshroom) by identifier, of Metashape's XML by label.

    Raises ConfigurationError for a camera model that is not known.
    """
    if file.text.lstrip().startswith("<"):
        return _of_metashape(file)
    entries = file.tree.get("intrinsics")
    if not isinstance(entries, list) or not all(
        isinstance(entry, dict) and "intrinsicId" in entry for entry in entries
    ):
        return {}
    if not entries:
        raise ConfigurationError(f"{file.name}: no intrinsics in this file of Meshroom")
    version = tuple(int(part) for part in file.tree.get("version", (1, 0, 0)))
    return {str(entry["intrinsicId"]): _of_meshroom(entry, version, file.name) for entry in entries}


def _of_meshroom(entry: Tree, version: tuple[int, ...], name: str) -> Camera:
    """One camera. What its lengths count has changed with the version of the file."""
    where = f"{name}: camera {entry['intrinsicId']}"
    width, height = int(entry["width"]), int(entry["height"])
    kind = str(entry.get("distortionType") or entry.get("type", "pinhole"))
    kind = str(entry.get("type", "pinhole")) if kind == "none" else kind
    if kind not in _MESHROOM:
        raise ConfigurationError(f"{where}: type {kind}; expected one of {', '.join(_MESHROOM)}")
    if version < (1, 2, 2):
        focal = entry["pxFocalLength"]
        fx, fy = map(float, focal if isinstance(focal, list) else (focal, focal))
    else:
        fx = float(entry["focalLength"]) / float(entry.get("sensorWidth", 36.0)) * width
        ratio = float(entry.get("pixelRatio", 1.0))
        fy = fx * ratio if version >= (1, 2, 5) else fx / ratio
    cx, cy = (float(value) for value in entry["principalPoint"])
    if version >= (1, 2, 1):
        cx, cy = cx + width / 2, cy + height / 2
    values = [float(value) for value in entry.get("distortionParams") or []]
    order = _MESHROOM[kind]
    if order == "radial":
        k1, k2, k3 = [*values, 0.0, 0.0, 0.0][:3]
        values = [k1, k2, 0.0, 0.0, k3]
    elif order == "brown":
        k1, k2, k3, p1, p2 = [*values, *[0.0] * 5][:5]
        values = [k1, k2, p1, p2, k3]
    model = "fisheye" if order == "fisheye" else "brown"
    return camera(where, fx, fy, cx, cy, values if order else (), model, (width, height))


def _of_metashape(file: CameraFile) -> dict[str, Camera]:
    from xml.etree import ElementTree

    if "<!DOCTYPE" in file.text or "<!ENTITY" in file.text:
        return {}
    try:
        root = ElementTree.fromstring(file.text.partition("?>")[2].strip() or file.text)
    except (ElementTree.ParseError, ValueError):
        return {}  # said by the other formats
    if root.tag == "calibration" and root.find("f") is not None:
        return {"": _sensor(root, file.name)}
    found: dict[str, Camera] = {}
    for sensor in root.iterfind("chunk/sensors/sensor"):
        adjusted = sensor.find("calibration")
        if adjusted is not None:
            name = sensor.get("label") or sensor.get("id") or str(len(found))
            name = f"{name} {sensor.get('id')}" if name in found else name
            found[name] = _sensor(adjusted, f"{file.name}: {name}")
    return found


def _sensor(element: Any, where: str) -> Camera:
    """The camera of a ``calibration``; Metashape swaps p1 and p2, and b1 is fx - fy."""

    def number(name: str, otherwise: float | None = None) -> float:
        text = element.findtext(name)
        try:
            return float(text)
        except (TypeError, ValueError):
            if text is None and otherwise is not None:
                return otherwise
            raise ConfigurationError(
                f"{where}: {name} is {'missing' if text is None else repr(text)}; expected a number"
            ) from None

    kind = (element.findtext("projection") or element.get("type") or "frame").lower()
    if kind not in ("frame", "fisheye"):
        raise ConfigurationError(f"{where}: projection {kind}; expected frame or fisheye")
    resolution = element.find("resolution")
    if resolution is not None:
        width, height = int(resolution.get("width", 0)), int(resolution.get("height", 0))
    else:
        width, height = int(number("width")), int(number("height"))
    if abs(number("b2", 0.0)) > LARGEST_SKEW * number("f"):
        raise ConfigurationError(
            f"{where}: skew b2 {number('b2'):g}; expected 0 (cameras have none)"
        )
    fy = number("f")
    # the centre of the first pixel is at 0.5
    cx = width / 2 + number("cx", 0.0) - 0.5
    cy = height / 2 + number("cy", 0.0) - 0.5
    k = [number(f"k{i}", 0.0) for i in range(1, 5)]
    if kind == "fisheye":
        bent = k
    elif k[3]:
        raise ConfigurationError(f"{where}: k4 is {k[3]:g}; expected a calibration without k4")
    else:
        bent = [k[0], k[1], number("p2", 0.0), number("p1", 0.0), k[2]]
    fx = fy + number("b1", 0.0)
    model = "fisheye" if kind == "fisheye" else "brown"
    return camera(where, fx, fy, cx, cy, bent, model, (width, height))


CENTRED = CameraFormat("centred", "Meshroom's cameras.sfm, Metashape's XML", read)
