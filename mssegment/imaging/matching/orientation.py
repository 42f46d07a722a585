"""The dominant directions of the gradient around corners."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.imaging.matching.views import Indices, Singles, View, runs
from mssegment.imaging.pyramid import Level
from mssegment.records import Floats

RADIUS = 8
BINS = 36
PEAK = 0.8
BLOCK = 128
"""Corners at a time, so that what is looked at stays in the cache."""


def dominant(view: View) -> tuple[Indices, Floats]:
    """For each direction found the corner's index, and the angle in radians.

    A histogram of 36 bins of the gradients within 8 pixels of the corner's level, weighted by
    magnitude and distance; every peak of at least 0.8 of the greatest is a direction of its own.
    """
    histogram = np.zeros((len(view.levels), BINS), np.float32)
    for rows, number in runs(view.levels):
        histogram[rows] = _histograms(view.pyramid[number], view.points[rows])
    return _peaks(histogram)


def _histograms(level: Level, points: Floats) -> Singles:
    """Histograms [n, 36] of the gradients around points of the picture on a level."""
    gx = cv2.Scharr(level.grey, cv2.CV_32F, 1, 0)
    gy = cv2.Scharr(level.grey, cv2.CV_32F, 0, 1)
    # cv2.phase and cv2.magnitude, and in OpenCV 4.8 the magnitude of cartToPolar too, differ in the
    # last bits from run to run: they depend on where an array lies in memory
    _, angle = cv2.cartToPolar(gx, gy)
    magnitude = np.sqrt(gx * gx + gy * gy)
    turns = np.asarray(angle) * np.float32(BINS / (2 * np.pi))
    bins = np.minimum(turns.astype(np.uint8), BINS - 1)
    pad = RADIUS + 1
    size, bin_of = (
        cv2.copyMakeBorder(picture, pad, pad, pad, pad, cv2.BORDER_CONSTANT).ravel()
        for picture in (magnitude, bins)
    )
    dx, dy = _disc()
    weights = np.exp(-2.0 * (dx * dx + dy * dy) / RADIUS**2).astype(np.float32)
    width = level.grey.shape[1] + 2 * pad
    centres = np.rint(level.from_picture(points)).astype(np.intp) + pad
    first, around = centres[:, 1] * width + centres[:, 0], dy * width + dx
    counts = np.empty((len(points), BINS), np.float32)
    for start in range(0, len(points), BLOCK):
        where = first[start : start + BLOCK, None] + around
        slots = bin_of.take(where) + (np.arange(len(where)) * BINS)[:, None]
        values = size.take(where) * weights
        found = np.bincount(slots.ravel(), values.ravel(), minlength=len(where) * BINS)
        counts[start : start + BLOCK] = found.reshape(-1, BINS)
    return counts


def _disc() -> tuple[Indices, Indices]:
    """The pixels of a disc: offsets x, y [K]."""
    line = np.arange(-RADIUS, RADIUS + 1)
    dx, dy = (d.ravel() for d in np.meshgrid(line, line))
    chosen = dx * dx + dy * dy <= RADIUS * RADIUS
    return dx[chosen], dy[chosen]


def _peaks(histogram: Singles) -> tuple[Indices, Floats]:
    """Peaks of smoothed circular histograms, placed by a parabola."""
    kernel = np.array([1, 4, 6, 4, 1], np.float32) / 16
    smooth = sum(
        (np.roll(histogram, shift, axis=1) * weight)
        for shift, weight in zip(range(-2, 3), kernel, strict=True)
    )
    before, after = np.roll(smooth, 1, axis=1), np.roll(smooth, -1, axis=1)
    greatest = smooth.max(axis=1, keepdims=True)
    peak = (smooth >= before) & (smooth > after) & (smooth >= PEAK * greatest)
    corner, at = np.nonzero(peak)
    left, middle, right = before[peak], smooth[peak], after[peak]
    shift = 0.5 * (left - right) / np.minimum(left - 2 * middle + right, -1e-12)
    return corner, ((at + 0.5 + shift) * (2 * np.pi / BINS)).astype(np.float64)
