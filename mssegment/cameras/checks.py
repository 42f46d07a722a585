"""Whether a camera can be the one of the pictures."""

from __future__ import annotations

import math

from mssegment.errors import ConfigurationError
from mssegment.records import Camera, replace

WIDEST = 150.0
"""Degrees of view that no lens without fisheye distortion has; the widest ones sold have 130."""


def fitted(camera: Camera, width: int, height: int) -> tuple[Camera, tuple[str, ...]]:
    """The camera for pictures of this size, and notes on values that are unlikely.

    Parameters
    ----------
    camera : Camera
        The calibration.
    width, height : int
        The size of the pictures in pixels.

    Returns
    -------
    camera : Camera
        Scaled, if it was calibrated for pictures of another size but of the same shape.
    notes : tuple of str

    Raises
    ------
    ConfigurationError
        If the camera is of pictures of another shape, or the focal length cannot be in pixels.
    """
    camera, notes = _scaled(camera, width, height)
    _check_view(camera, width, height)
    if not (-0.5 <= camera.cx <= width - 0.5 and -0.5 <= camera.cy <= height - 0.5):
        notes += (
            f"the principal point ({camera.cx:g}, {camera.cy:g}) lies outside the pictures "
            f"({width}x{height} pixels): is it the camera of other pictures?",
        )
    return camera, notes


def notes_on_tracks(camera: Camera, width: int, height: int) -> tuple[str, ...]:
    """Notes on a camera for tracks whose pictures are not known, only what they cover in pixels.

    Raises ConfigurationError if the focal length cannot be in pixels.
    """
    _check_view(camera, width, height)
    if camera.width is None or camera.height is None:
        return ()
    # a tracker may follow a point a little beyond the border
    if width <= 1.1 * camera.width and height <= 1.1 * camera.height:
        return ()
    return (
        f"the tracks reach over {width}x{height} pixels, but the camera is calibrated for "
        f"{camera.width}x{camera.height}: is it the camera of these pictures, at their size?",
    )


def _check_view(camera: Camera, width: int, height: int) -> None:
    """Raises ConfigurationError for a focal length that no lens has, such as one in millimetres."""
    if camera.distortion_model != "brown":
        return
    for name, focal, side, word in (
        ("fx", camera.fx, width, "wide"),
        ("fy", camera.fy, height, "high"),
    ):
        view = math.degrees(2 * math.atan(side / (2 * focal)))
        if view > WIDEST:
            raise ConfigurationError(
                f"camera: {name} is {focal:g}, which cannot be pixels for pictures {side} {word} "
                f"(a view of {view:.0f} degrees); from millimetres: fx = f * {width} / (width of "
                "the sensor)"
            )


def _scaled(camera: Camera, width: int, height: int) -> tuple[Camera, tuple[str, ...]]:
    if camera.width is None or camera.height is None:
        return camera, ()
    if (camera.width, camera.height) == (width, height):
        return camera, ()
    sx, sy = width / camera.width, height / camera.height
    # a scaled size is rounded to whole pixels
    if abs(camera.width * sy - width) > 1 and abs(camera.height * sx - height) > 1:
        raise ConfigurationError(
            f"camera: it is calibrated for {camera.width}x{camera.height} pixels, but the pictures "
            f"have {width}x{height}, another shape; give the camera of these pictures"
        )
    scaled = replace(
        camera,
        fx=camera.fx * sx,
        fy=camera.fy * sy,
        cx=(camera.cx + 0.5) * sx - 0.5,
        cy=(camera.cy + 0.5) * sy - 0.5,
        width=width,
        height=height,
    )
    return scaled, (
        f"the camera is calibrated for {camera.width}x{camera.height} pixels: scaled to "
        f"{width}x{height}",
    )
