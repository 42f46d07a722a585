"""camodocal's YAML, as VINS-Mono and VINS-Fusion read it: values in two mappings."""

from __future__ import annotations

from collections.abc import Mapping

from mssegment.cameras.base import CameraFile, CameraFormat, camera, plain_keys, size_of
from mssegment.errors import ConfigurationError
from mssegment.records import Camera

_MODELS = {
    "PINHOLE": (("fx", "fy", "cx", "cy"), ("k1", "k2", "p1", "p2"), "brown"),
    "PINHOLE_FULL": (
        ("fx", "fy", "cx", "cy"),
        ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
        "brown",
    ),
    "KANNALA_BRANDT": (("mu", "mv", "u0", "v0"), ("k2", "k3", "k4", "k5"), "fisheye"),
}
"""For each model the names of fx, fy, cx, cy, those of the coefficients, and our name of it."""


def read(file: CameraFile) -> dict[str, Camera]:
    """The camera of the file.

    Raises ConfigurationError for another model, or a value that is missing.
    """
    own = plain_keys(file.tree)
    projection = own.get("projectionparameters")
    if not isinstance(projection, Mapping):
        return {}
    name = str(own.get("modeltype", "PINHOLE")).upper()
    if name not in _MODELS:
        raise ConfigurationError(
            f"{file.name}: model_type {name}; expected one of {', '.join(_MODELS)}"
        )
    intrinsics, coefficients, model = _MODELS[name]
    distortion = own.get("distortionparameters")
    lens = {**projection, **(distortion if isinstance(distortion, Mapping) else {})}
    values = [_number(projection, key, file.name) for key in intrinsics]
    bent = [_number(lens, key, file.name) if key in lens else 0.0 for key in coefficients]
    fx, fy, cx, cy = values
    return {"": camera(file.name, fx, fy, cx, cy, bent, model, size_of(own))}


def _number(values: Mapping[str, object], key: str, where: str) -> float:
    value = values.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigurationError(f"{where}: {key} is {value!r}; expected a number")
    return float(value)


CAMODOCAL = CameraFormat("camodocal", "camodocal, VINS-Mono (pinhole, Kannala-Brandt)", read)
