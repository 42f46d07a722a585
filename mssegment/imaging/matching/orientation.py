"""Dominant gradient directions around corners, as in SIFT (Lowe, IJCV 2004, section 5)."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.imaging.matching.pyramid_corners import PyramidCorners
from mssegment.imaging.matching.resampling import Floats32, Indices, runs_of_level
from mssegment.imaging.pictures import GreyPicture
from mssegment.imaging.pyramid import Level, strips
from mssegment.records import Floats

DISC_RADIUS = 8
"""Pixels of the corner's level within which gradients count."""
DIRECTION_BINS = 36
PEAK_SHARE = 0.8
"""Share of the highest peak that makes another peak a direction of its own."""
CORNERS_PER_BLOCK = 128
"""Corners at a time, whose gradients then stay in the cache."""


def dominant_directions(corners: PyramidCorners) -> tuple[Indices, Floats]:
    """Find the dominant gradient directions of every corner.

    Peaks of a histogram of 36 directions of the gradients within 8 pixels of the corner's level,
    weighted by magnitude and distance. Every peak of at least 0.8 of the highest counts.

    Returns
    -------
    index : int array [k]
        Index of the corner, ascending; one with several directions comes several times.
    angle : float array [k]
        Direction in radians.
    """
    histogram = np.zeros((len(corners.levels), DIRECTION_BINS), np.float32)
    for rows, number in runs_of_level(corners.levels):
        histogram[rows] = _histograms(corners.pyramid[number], corners.points[rows])
    return _peaks(histogram)


def _histograms(level: Level, points: Floats) -> Floats32:
    """Histograms [n, 36] of the gradients on a level, around points in pixels of the picture."""
    centres = np.rint(level.from_picture(points)).astype(np.intp)
    counts = np.empty((len(points), DIRECTION_BINS), np.float32)
    for rows, around, inside in strips(level.grey.shape, DISC_RADIUS + 1):
        chosen = np.flatnonzero((centres[:, 1] >= rows.start) & (centres[:, 1] < rows.stop))
        if len(chosen):
            moved = centres[chosen] - [0, rows.start - inside.start]
            counts[chosen] = _histograms_of(level.grey[around], moved)
    return counts


def _histograms_of(grey: GreyPicture, centres: Indices) -> Floats32:
    """Histograms [n, 36] of the gradients around pixels [n, 2] of a picture or a strip of one."""
    gx = cv2.Scharr(grey, cv2.CV_32F, 1, 0)
    gy = cv2.Scharr(grey, cv2.CV_32F, 0, 1)
    # cv2.phase and cv2.magnitude, and in OpenCV 4.8 the magnitude of cartToPolar too, differ in the
    # last bits from run to run: they depend on where an array lies in memory
    _, angle = cv2.cartToPolar(gx, gy)
    magnitude = np.sqrt(gx * gx + gy * gy)
    turns = np.asarray(angle) * np.float32(DIRECTION_BINS / (2 * np.pi))
    bins = np.minimum(turns.astype(np.uint8), DIRECTION_BINS - 1)
    pad = DISC_RADIUS + 1
    size, bin_of = (
        cv2.copyMakeBorder(picture, pad, pad, pad, pad, cv2.BORDER_CONSTANT).ravel()
        for picture in (magnitude, bins)
    )
    dx, dy = _disc()
    weights = np.exp(-2.0 * (dx * dx + dy * dy) / DISC_RADIUS**2).astype(np.float32)
    width = grey.shape[1] + 2 * pad
    first, around = (centres[:, 1] + pad) * width + centres[:, 0] + pad, dy * width + dx
    counts = np.empty((len(centres), DIRECTION_BINS), np.float32)
    for start in range(0, len(centres), CORNERS_PER_BLOCK):
        where = first[start : start + CORNERS_PER_BLOCK, None] + around
        slots = bin_of.take(where) + (np.arange(len(where)) * DIRECTION_BINS)[:, None]
        values = size.take(where) * weights
        found = np.bincount(slots.ravel(), values.ravel(), minlength=len(where) * DIRECTION_BINS)
        counts[start : start + CORNERS_PER_BLOCK] = found.reshape(-1, DIRECTION_BINS)
    return counts


def _disc() -> tuple[Indices, Indices]:
    """Offsets x, y [K] of the pixels of a disc."""
    line = np.arange(-DISC_RADIUS, DISC_RADIUS + 1)
    dx, dy = (d.ravel() for d in np.meshgrid(line, line))
    chosen = dx * dx + dy * dy <= DISC_RADIUS * DISC_RADIUS
    return dx[chosen], dy[chosen]


def _peaks(histogram: Floats32) -> tuple[Indices, Floats]:
    """Row and angle of the peaks of smoothed circular histograms, placed by a parabola."""
    kernel = np.array([1, 4, 6, 4, 1], np.float32) / 16
    smooth = sum(
        (np.roll(histogram, shift, axis=1) * weight)
        for shift, weight in zip(range(-2, 3), kernel, strict=True)
    )
    before, after = np.roll(smooth, 1, axis=1), np.roll(smooth, -1, axis=1)
    greatest = smooth.max(axis=1, keepdims=True)
    peak = (smooth >= before) & (smooth > after) & (smooth >= PEAK_SHARE * greatest)
    corner, at = np.nonzero(peak)
    left, middle, right = before[peak], smooth[peak], after[peak]
    shift = 0.5 * (left - right) / np.minimum(left - 2 * middle + right, -1e-12)
    return corner, ((at + 0.5 + shift) * (2 * np.pi / DIRECTION_BINS)).astype(np.float64)
