"""A camera file as a tree of named values, and how a camera is made from what a format finds."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.records import Camera, Floats, Record

Tree = Mapping[str, Any]
"""Named values of a file: numbers, text, lists, and mappings of the same kind."""

DistortionModel = Literal["brown", "fisheye"]
_BROWN = (
    *("brown", "browncorrady", "brownconrady", "plumbbob", "radtan", "radialtangential"),
    *("rationalpolynomial", "rational", "opencv", "fullopencv", "pinhole", "perspective"),
    *("simplepinhole", "simpleradial", "radial", "none", "null"),
)
_FISHEYE = (
    *("fisheye", "equidistant", "equi", "kannalabrandt", "kannalabrandt4", "kannalabrandt8"),
    *("kb4", "kb8", "opencvfisheye", "simpleradialfisheye", "radialfisheye"),
)
_DISTORTION = re.compile(
    r"(?:(?:camera|lens)?dist(?:ortion)?(?:coef(?:f|fs|s|ficients?)?|param(?:s|eters?)?|vector|array)?"
    r"|coeffs|kc|d)(?P<suffix>left|right|l|r|\d*)"
)
"""Plain keys of lists of distortion coefficients."""
_MODEL_KEYS = (
    *("distortionmodel", "distortiontype", "cameramodel", "cameratype", "lensmodel", "model"),
    "type",
)
"""Plain keys of the name of a distortion model."""
LARGEST_SKEW_SHIFT = 0.5
"""Skew that moves no point of the picture by more than this, in pixels, is left out."""


class CameraFile:
    """An opened camera file.

    Parameters
    ----------
    name : str
        Its path, for errors.
    content : bytes
        The whole file.
    """

    def __init__(self, name: str, content: bytes) -> None:
        self.name = name
        self.content = content

    @cached_property
    def text(self) -> str:
        """The file as text, with tabs as blanks; empty if it is binary."""
        for encoding in ("utf-8-sig", "utf-16"):
            try:
                text = self.content.decode(encoding)
            except UnicodeDecodeError:
                continue
            return "" if "\0" in text else text.replace("\t", " ")
        return ""

    @cached_property
    def tree(self) -> Tree:
        """The named values of JSON, YAML, INI, XML, a numpy archive or a Matlab file, or none.

        Raises ConfigurationError if a file that is meant as one of these is damaged.
        """
        from mssegment.cameras import trees
        from mssegment.inputs.opencv_storage import of_yaml

        if self.content[:6] == b"\x93NUMPY" or self.content[:2] == b"PK":
            return trees.of_numpy(self.content, self.name)
        if self.content[:6] == b"MATLAB":
            return trees.of_matlab(self.content, self.name)
        start = self.text.lstrip()
        if trees.is_ini(self.text):
            return trees.of_ini(self.text, self.name)
        if start.startswith("<"):
            return trees.of_xml(self.text, self.name)
        if start.startswith("{"):
            try:
                found = json.loads(self.text)
            except ValueError:
                return of_yaml(self.text, self.name, ConfigurationError)
            return found if isinstance(found, dict) else {}
        return of_yaml(self.text, self.name, ConfigurationError)


class CameraFormat(Record, frozen=True):
    """A format of camera files.

    Attributes
    ----------
    name : str
        The name in ``CAMERAS``.
    title : str
        What it is called in the documentation.
    read : callable
        The cameras in a file by name; empty if the file has another format. The name of an only
        camera may be empty.
    """

    name: str
    title: str
    read: Callable[[CameraFile], dict[str, Camera]]


def camera_of_matrix(
    matrix: Floats,
    where: str,
    distortion: Sequence[float] = (),
    model: str | None = None,
    size: tuple[int, int] | None = None,
) -> Camera:
    """The camera of a calibration matrix [3, 3] or a projection matrix [3, 4].

    Raises ConfigurationError for a matrix with skew or of another kind.
    """
    k = np.asarray(matrix, dtype=np.float64)[:, :3]
    if k[2, 2] not in (0.0, 1.0):
        k = k / k[2, 2]
    if k[2, 2] != 1 or k[1, 0] or k[2, 0] or k[2, 1]:
        raise ConfigurationError(
            f"{where}: not a calibration matrix; expected fx 0 cx / 0 fy cy / 0 0 1, not "
            f"{' / '.join(' '.join(f'{v:g}' for v in row) for row in k)}"
        )
    reach = size[1] / 2 if size else abs(k[1, 2])
    if k[1, 1] and abs(k[0, 1]) * reach / abs(k[1, 1]) > LARGEST_SKEW_SHIFT:
        raise ConfigurationError(f"{where}: skew {k[0, 1]:g}; expected 0 (cameras have none)")
    return camera(where, k[0, 0], k[1, 1], k[0, 2], k[1, 2], distortion, model, size)


def camera(
    where: str,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    distortion: Sequence[float] = (),
    model: str | None = None,
    size: tuple[int, int] | None = None,
) -> Camera:
    """The camera with these values.

    Parameters
    ----------
    where : str
        The file and the camera in it, for errors.
    fx, fy, cx, cy : float
        Pixels.
    distortion : sequence of float
        The coefficients of the model, in OpenCV's order.
    model : str, optional
        The name of the model, as any program calls it.
    size : (int, int), optional
        Width and height of the pictures that the camera was calibrated for.

    Returns
    -------
    Camera

    Raises
    ------
    ConfigurationError
        For a value that no camera has, or a distortion model that is not known.
    """
    values = {"fx": fx, "fy": fy, "cx": cx, "cy": cy}
    for name, value in values.items():
        if not np.isfinite(value) or (name in ("fx", "fy") and value <= 0):
            expected = "more than 0" if name in ("fx", "fy") else "a number"
            raise ConfigurationError(
                f"{where}: {name} is {value:g}; expected {expected}, in pixels"
            )
    coefficients = tuple(float(value) for value in distortion)
    kind = distortion_model(model, where) if any(coefficients) else "brown"
    if kind == "fisheye" and len(coefficients) > 4:
        raise ConfigurationError(
            f"{where}: {len(coefficients)} coefficients of a fisheye lens; expected k1, k2, k3, k4"
        )
    width, height = size or (None, None)
    return Camera(float(fx), float(fy), float(cx), float(cy), coefficients, kind, width, height)


def distortion_model(name: str | None, where: str) -> DistortionModel:
    """``brown`` or ``fisheye`` for the name of a distortion model in any program.

    Raises ConfigurationError for any other.
    """
    plain = re.sub(r"[^a-z0-9]", "", (name or "brown").lower())
    if plain in _BROWN:
        return "brown"
    if plain in _FISHEYE:
        return "fisheye"
    raise ConfigurationError(
        f"{where}: distortion model {name}; expected Brown's (k1, k2, p1, p2, k3: radtan, "
        "plumb_bob) or the fisheye one (k1 ... k4: equidistant, Kannala-Brandt)"
    )


def plain(name: str) -> str:
    """A key in lower case without what programs write differently: blanks, ``_``, ``-``, dots."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def plain_keys(tree: Tree) -> dict[str, Any]:
    """The values of a tree by their plain keys."""
    return {plain(str(key)): value for key, value in tree.items()}


def numbers_of(value: Any) -> Floats | None:
    """A list of numbers, or the matrix that OpenCV and ROS write with rows, cols and data."""
    if isinstance(value, Mapping):
        own = plain_keys(value)
        if "data" not in own:
            return None
        flat = numbers_of(own["data"])
        rows, columns = own.get("rows"), own.get("cols")
        if flat is None or rows is None or columns is None:
            return flat
        try:
            shape = int(rows), int(columns)
        except (TypeError, ValueError, OverflowError):
            return None
        return flat.reshape(shape) if flat.size == shape[0] * shape[1] else flat
    if isinstance(value, str):
        inner = re.sub(r"^\s*(np\.|numpy\.)?(array|matrix|Mat\w*)\s*\(", "", value)
        value = re.split(r"[\s,;\[\]()]+", inner.strip("[]() \n;,"))
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    return np.squeeze(found) if found.ndim > 2 else found


def matrix_of(value: Any) -> Floats | None:
    """A 3x3 or 3x4 matrix from nested or flat numbers, also by columns; None if it is none.

    Of a 4x4 matrix, whose last row is 0 0 0 1, the first three rows count.
    """
    found = numbers_of(value)
    if found is not None and found.size == 16 and (found.ravel()[12:] == [0, 0, 0, 1]).all():
        found = found.ravel()[:12]
    if found is None or found.size not in (9, 12) or not np.isfinite(found).all():
        return None
    matrix = found.reshape(3, -1)
    by_columns = not matrix[0, 2] and not matrix[1, 2] and (matrix[2, 0] or matrix[2, 1])
    return matrix.T if matrix.shape == (3, 3) and by_columns else matrix


def size_of(own: Mapping[str, Any]) -> tuple[int, int] | None:
    """Width and height among plain keys; None unless both are there."""
    names = (
        *(("width", "height"), ("imagewidth", "imageheight"), ("w", "h"), ("camerawidth",) * 2),
        ("nx", "ny"),  # the calibration toolbox of Matlab
    )
    for width, height in names:
        height = "cameraheight" if width == "camerawidth" else height
        if isinstance(own.get(width), int | float) and isinstance(own.get(height), int | float):
            return int(own[width]), int(own[height])
    for name in ("resolution", "imagesize", "imagedimension", "imagersize", "size"):
        found = numbers_of(own.get(name)) if name in own else None
        if found is not None and found.shape == (2,):
            return int(found[0]), int(found[1])
    return None


def distortion_of(own: Mapping[str, Any], where: str, suffix: str = "") -> list[float] | None:
    """The list of distortion coefficients among plain keys; None if there is none.

    ``suffix`` is what follows the name of the camera, as in D1. Raises ConfigurationError for
    a list that is not of numbers.
    """
    for name, value in own.items():
        match = _DISTORTION.fullmatch(name)
        if match is None or match["suffix"] != suffix or value is None:
            continue
        found = None if isinstance(value, str) and not value.strip() else numbers_of(value)
        if found is None:
            raise ConfigurationError(f"{where}: {name} is {value!r}; expected numbers")
        return [float(number) for number in found.ravel()]
    return None


def is_distortion(key: str) -> bool:
    """Whether a plain key is that of a list of distortion coefficients."""
    return _DISTORTION.fullmatch(key) is not None


def model_of(own: Mapping[str, Any]) -> str | None:
    """The name of the distortion model among plain keys."""
    for name in _MODEL_KEYS:
        value = own.get(name)
        if isinstance(value, str) and not (name == "cameramodel" and plain(value) == "pinhole"):
            return value
    if any(own.get(name) in (1, True, "1") for name in ("fisheyemodel", "fisheye", "isfisheye")):
        return "fisheye"
    return None


def name_of(path: str) -> str:
    """The name of a file without its folder, for errors."""
    return Path(path).name
