"""Removal of lens distortion, which comes before any geometry."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.records import Camera, Floats

MAX_UNDISTORT_STEPS = 30
MAX_FISHEYE_ERROR = 0.01
"""Pixels by which a point may miss its own pixel after the distortion is undone and done again."""


def undistort_points(points: Floats, camera: Camera) -> Floats:
    """Map distorted image points to the pinhole camera with the same calibration matrix.

    Parameters
    ----------
    points : float array [..., 2]
        Pixels; NaN stays NaN.
    camera : Camera
        Calibration with the coefficients of OpenCV's distortion model (k1, k2, p1, p2, k3, ...), or
        of its fisheye model (k1, k2, k3, k4).

    Returns
    -------
    float array [..., 2]
        Pixels without distortion; ``points`` itself where all coefficients are 0. NaN for what a
        fisheye lens sees at 90 degrees and more from its axis, where no pinhole camera sees.

    Raises
    ------
    ConfigurationError
        For more than 14 coefficients, or more than 4 of a fisheye lens.
    """
    if not any(camera.distortion):
        return points
    flat = points.reshape(-1, 2)
    visible = np.isfinite(flat).all(axis=1)
    result = np.full_like(flat, np.nan)
    if visible.any() and camera.distortion_model == "fisheye":
        result[visible] = _undistort_fisheye(flat[visible], camera)
    elif visible.any():
        coefficients = _padded(camera.distortion)
        result[visible] = _undistort(flat[visible], camera.matrix, coefficients)
    return result.reshape(points.shape)


def _padded(coefficients: tuple[float, ...]) -> Floats:
    """The coefficients with zeros appended up to a number that OpenCV accepts."""
    for length in (5, 8, 12, 14):
        if len(coefficients) <= length:
            return np.array(coefficients + (0.0,) * (length - len(coefficients)))
    raise ConfigurationError(
        f"camera.distortion: {len(coefficients)} coefficients, expected at most 14 "
        "(k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y)"
    )


def _undistort(pixels: Floats, matrix: Floats, coefficients: Floats) -> Floats:
    """OpenCV's few fixed-point steps, then more until distortion maps the points back."""
    rough = cv2.undistortPoints(pixels.reshape(-1, 1, 2), matrix, coefficients)
    rays = np.asarray(rough, np.float64).reshape(-1, 2)
    focal = np.array([matrix[0, 0], matrix[1, 1]])
    for _ in range(MAX_UNDISTORT_STEPS):
        homogeneous = np.column_stack([rays, np.ones(len(rays))])
        again, _ = cv2.projectPoints(homogeneous, np.zeros(3), np.zeros(3), matrix, coefficients)
        error = (np.asarray(again, np.float64).reshape(-1, 2) - pixels) / focal
        if np.abs(error).max() < 1e-12:
            break
        rays = rays - error
    return np.asarray(rays * focal + matrix[:2, 2])


def _undistort_fisheye(pixels: Floats, camera: Camera) -> Floats:
    """OpenCV's fisheye model: NaN where the ray does not meet the plane of a pinhole camera."""
    if len(camera.distortion) > 4:
        raise ConfigurationError(
            f"camera.distortion: {len(camera.distortion)} coefficients of a fisheye lens, expected "
            "k1, k2, k3, k4"
        )
    coefficients = np.zeros(4)
    coefficients[: len(camera.distortion)] = camera.distortion
    given = pixels.reshape(-1, 1, 2)
    rays = cv2.fisheye.undistortPoints(given, camera.matrix, coefficients)
    again = cv2.fisheye.distortPoints(rays, camera.matrix, coefficients)
    # what OpenCV cannot invert it marks by a huge number
    wrong = np.linalg.norm(again - given, axis=-1).ravel() > MAX_FISHEYE_ERROR
    found = np.asarray(rays, np.float64).reshape(-1, 2)
    found[wrong] = np.nan
    return np.asarray(found * [camera.fx, camera.fy] + [camera.cx, camera.cy])
