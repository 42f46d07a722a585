"""Camera files of calibration programs: one module per format, named in ``registry.py``."""

from __future__ import annotations

import os

from mssegment.cameras.base import CameraFile, CameraFormat
from mssegment.cameras.checks import fitted, notes_on_tracks
from mssegment.errors import ConfigurationError
from mssegment.inputs.files import read_file
from mssegment.records import Camera
from mssegment.registry import CAMERAS

__all__ = ["CAMERAS", "CameraFormat", "fitted", "notes_on_tracks", "read_camera"]


def read_camera(path: str) -> Camera:
    """Read a camera file.

    Parameters
    ----------
    path : str
        The file, or ``FILE#NAME`` for one of several cameras in it. The content determines the
        format.

    Returns
    -------
    Camera

    Raises
    ------
    ConfigurationError
        If the file cannot be read, has no camera, or has several and none is chosen.
    """
    file, name = _opened(path)
    for form in CAMERAS.values():
        try:
            found: dict[str, Camera] = form.read(file)
        except KeyError as error:
            raise ConfigurationError(
                f"{file.name}: a damaged camera file (no {error.args[0]} in it); write it again"
            ) from None
        except (ValueError, TypeError, OverflowError, AttributeError, IndexError) as error:
            raise ConfigurationError(
                f"{file.name}: a damaged camera file ({error}); write it again"
            ) from None
        if found:
            return _chosen(found, file, name)
    raise ConfigurationError(f"{file.name}: {_looks_like(file)}")


def _opened(path: str) -> tuple[CameraFile, str]:
    name, member = path, ""
    if "#" in path and not os.path.exists(path):
        name, _, member = path.rpartition("#")
    content = read_file(
        name,
        error=ConfigurationError,
        expected="a camera file",
        missing="no such camera file; check the name, or give four numbers fx,fy,cx,cy",
    )
    return CameraFile(name, content), member


def _chosen(found: dict[str, Camera], file: CameraFile, name: str) -> Camera:
    if name:
        if name not in found:
            raise ConfigurationError(
                f"{file.name}: no camera '{name}'; found {', '.join(filter(None, found)) or 'one'}"
            )
        return found[name]
    if len(found) > 1:
        names = [name for name in found if name]
        raise ConfigurationError(
            f"{file.name}: holds {len(found)} cameras ({', '.join(names)}); choose one: "
            f"'{file.name}#{names[0]}'"
        )
    return next(iter(found.values()))


def _looks_like(file: CameraFile) -> str:
    if not file.content.strip():
        return "empty; expected a camera (fx, fy, cx, cy)"
    keys = [str(key) for key in file.tree]
    shown = f"the keys {', '.join(keys[:8])}" if keys else "no keys"
    return (
        f"no camera in this file, found {shown}; expected fx, fy, cx, cy, or a file of OpenCV, "
        "ROS, Kalibr, EuRoC, ORB-SLAM, Basalt, COLMAP, openMVG, Meshroom, Metashape, KITTI, "
        "Open3D or RealSense, or a 3x3 matrix"
    )
