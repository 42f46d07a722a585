"""Undo a lens's distortion, before anything else looks at the points."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.records import Camera, Floats

POLISH_STEPS = 30


def undistort_points(points: Floats, camera: Camera) -> Floats:
    """Pixels [..., 2] as a camera without distortion and with the same K would see them.

    OpenCV's model (k1, k2, p1, p2, k3, ...); NaN stays NaN. Raises ``ConfigurationError`` for
    more than 14 coefficients.
    """
    if not any(camera.distortion):
        return points
    flat = points.reshape(-1, 2)
    seen = np.isfinite(flat).all(axis=1)
    result = np.full_like(flat, np.nan)
    if seen.any():
        lens = _lens(camera.distortion)
        result[seen] = _undistort(flat[seen], camera.matrix, lens)
    return result.reshape(points.shape)


def _lens(coefficients: tuple[float, ...]) -> Floats:
    """The coefficients, filled up with zeros to a number that OpenCV takes."""
    for length in (5, 8, 12, 14):
        if len(coefficients) <= length:
            return np.array(coefficients + (0.0,) * (length - len(coefficients)))
    raise ConfigurationError(
        f"camera.distortion: {len(coefficients)} coefficients, expected at most 14 "
        "(k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y)"
    )


def _undistort(pixels: Floats, matrix: Floats, lens: Floats) -> Floats:
    """OpenCV's few fixed-point steps, then more of them until the lens maps the points back."""
    rough = cv2.undistortPoints(pixels.reshape(-1, 1, 2), matrix, lens)
    rays = np.asarray(rough, np.float64).reshape(-1, 2)
    focal = np.array([matrix[0, 0], matrix[1, 1]])
    for _ in range(POLISH_STEPS):
        there = np.column_stack([rays, np.ones(len(rays))])
        again, _ = cv2.projectPoints(there, np.zeros(3), np.zeros(3), matrix, lens)
        miss = (np.asarray(again, np.float64).reshape(-1, 2) - pixels) / focal
        if np.abs(miss).max() < 1e-12:
            break
        rays = rays - miss
    return np.asarray(rays * focal + matrix[:2, 2])
