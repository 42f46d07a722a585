"""The dominant directions of the gradient around corners."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.imaging.matching.views import Indices, Singles, View
from mssegment.records import Floats

RADIUS = 8
BINS = 36
PEAK = 0.8


def dominant(view: View) -> tuple[Indices, Floats]:
    """For each direction found the corner's index, and the angle in radians.

    A histogram of 36 bins of the gradients within 8 pixels of the corner's level, weighted by
    magnitude and distance; every peak of at least 0.8 of the greatest is a direction of its own.
    """
    histogram = np.concatenate([_histograms(view, number) for number in range(len(view.pyramid))])
    order = np.argsort(view.levels, kind="stable")
    back = np.empty_like(histogram)
    back[order] = histogram
    return _peaks(back)


def _histograms(view: View, number: int) -> Singles:
    """Histograms [n, 36] of the corners on one level, in their order."""
    level = view.pyramid[number]
    gx = cv2.Scharr(level.grey, cv2.CV_32F, 1, 0)
    gy = cv2.Scharr(level.grey, cv2.CV_32F, 0, 1)
    magnitude, angle = cv2.cartToPolar(gx, gy)
    bins = (np.asarray(angle) * np.float32(BINS / (2 * np.pi))).astype(np.int32) % BINS
    pad = RADIUS + 1
    frame = (pad, pad, pad, pad)
    size = cv2.copyMakeBorder(np.asarray(magnitude), *frame, cv2.BORDER_CONSTANT).ravel()
    bin_of = cv2.copyMakeBorder(bins, *frame, cv2.BORDER_CONSTANT).ravel()
    line = np.arange(-RADIUS, RADIUS + 1)
    dx, dy = (d.ravel() for d in np.meshgrid(line, line))
    disc = dx * dx + dy * dy <= RADIUS * RADIUS
    dx, dy = dx[disc], dy[disc]
    weights = np.exp(-2.0 * (dx * dx + dy * dy) / RADIUS**2).astype(np.float32)
    width = level.grey.shape[1] + 2 * pad
    rows = np.flatnonzero(view.levels == number)
    centres = np.rint((view.points[rows] + 0.5) / level.ratio - 0.5).astype(np.int64) + pad
    where = (centres[:, 1] * width + centres[:, 0])[:, None] + (dy * width + dx)
    values = size[where] * weights
    slots = bin_of[where] + (np.arange(len(rows)) * BINS)[:, None]
    counts = np.bincount(slots.ravel(), values.ravel(), minlength=len(rows) * BINS)
    return counts.reshape(-1, BINS).astype(np.float32)


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
