"""A pyramid of pictures, each smaller than the one before by a factor sqrt(2)."""

from __future__ import annotations

import math

import cv2
import numpy as np

from mssegment.imaging.pictures import Grey
from mssegment.records import Floats, Record

FACTOR = 2**0.5
SMALLEST = 16
"""Levels stop before a side falls below this many pixels."""


class Level(Record, frozen=True):
    """One level: its picture, and how many pixels of the original one of its pixels spans.

    ``scale`` is nominal (a power of sqrt 2); ``ratio`` (x, y) is the exact one, which differs a
    little because sizes are whole numbers.
    """

    grey: Grey
    scale: float
    ratio: Floats

    def to_picture(self, points: Floats) -> Floats:
        """Positions [..., 2] on this level as positions in the original; pixel centres whole."""
        return np.asarray((points + 0.5) * self.ratio - 0.5)

    def from_picture(self, points: Floats) -> Floats:
        """Positions [..., 2] in the original as positions on this level."""
        return np.asarray((points + 0.5) / self.ratio - 0.5)


def size_unit(grey: Grey) -> float:
    """How much larger than 640x480 a picture is, as a factor of its sides; 1 for smaller ones.

    Distances between neighbouring matches grow with the picture; the size of a window does not.
    """
    return max(1.0, math.sqrt(grey.shape[0] * grey.shape[1] / (640 * 480)))


def build_pyramid(grey: Grey, levels: int) -> list[Level]:
    """The picture and ``levels`` - 1 smaller ones, fewer where it would become too small."""
    height, width = grey.shape
    original = np.ascontiguousarray(grey, np.float32)
    pyramid = [Level(original, 1.0, np.ones(2))]
    for number in range(1, levels):
        scale = FACTOR**number
        size = (round(width / scale), round(height / scale))
        if min(size) < SMALLEST:
            break
        # Each level comes from the one before; sigma 0.7 keeps what would alias below one percent.
        smooth = cv2.GaussianBlur(pyramid[-1].grey, (5, 5), 0.7)
        smaller = cv2.resize(smooth, size, interpolation=cv2.INTER_LINEAR)
        ratio = np.array([width / size[0], height / size[1]])
        pyramid.append(Level(np.asarray(smaller), scale, ratio))
    return pyramid
