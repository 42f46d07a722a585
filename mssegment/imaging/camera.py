"""Undo a lens's distortion, before anything else looks at the points."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.records import Camera, Floats

POLISH_STEPS = 30


def undistort_points(points: Floats, camera: Camera) -> Floats:
    """Pixels [..., 2] as a camera without distortion and with the same K would see them.

    OpenCV's model (k1, k2, p1, p2, k3, ...); NaN stays NaN.
    """
    if not any(camera.distortion):
        return points
    flat = points.reshape(-1, 2)
    seen = np.isfinite(flat).all(axis=1)
    result = np.full_like(flat, np.nan)
    if seen.any():
        lens = np.asarray(camera.distortion, np.float64)
        result[seen] = _undistort(flat[seen], camera.matrix, lens)
    return result.reshape(points.shape)


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
