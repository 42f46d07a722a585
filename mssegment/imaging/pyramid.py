"""Image pyramid: each level is smaller than the one before by a factor of sqrt(2)."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np

from mssegment.imaging.pictures import GreyPicture
from mssegment.records import Floats, Record

FACTOR = 2**0.5
STRIP_PIXELS = 1 << 22
"""Pixels of a picture that are worked on at a time."""
MIN_LEVEL_SIDE = 16
"""Pixels; levels stop before a side falls below this."""


class Level(Record, frozen=True):
    """One level of a pyramid.

    Parameters
    ----------
    grey : float32 array [height, width]
        The smaller picture.
    scale : float
        Nominal size of its pixels in pixels of the original, a power of sqrt(2).
    ratio : float array [2]
        Exact size (x, y) of its pixels; it differs a little because sizes are whole numbers.
    """

    grey: GreyPicture
    scale: float
    ratio: Floats

    def to_picture(self, points: Floats) -> Floats:
        """Positions [..., 2] on this level as positions in the original.

        In both, the centre of the first pixel is at (0, 0).
        """
        return np.asarray((points + 0.5) * self.ratio - 0.5)

    def from_picture(self, points: Floats) -> Floats:
        """Positions [..., 2] in the original as positions on this level."""
        return np.asarray((points + 0.5) / self.ratio - 0.5)


def strips(
    shape: tuple[int, ...], margin: int, pixels: int | None = None
) -> Iterator[tuple[slice, slice, slice]]:
    """Rows of a large picture at a time, so that what is computed from them needs little memory.

    Yields the rows of each strip; the rows around it, with a margin that a filter needs; and where
    the strip lies among these. A picture of up to ``pixels``, by
    default ``STRIP_PIXELS``, is one strip.
    """
    pixels = pixels or STRIP_PIXELS
    height, width = shape
    rows = height if height * width <= pixels else max(1, pixels // width)
    for start in range(0, height, rows):
        stop = min(start + rows, height)
        low, high = max(start - margin, 0), min(stop + margin, height)
        yield slice(start, stop), slice(low, high), slice(start - low, stop - low)


def size_unit(grey: GreyPicture) -> float:
    """Size of a picture relative to 640 x 480, as a factor of its sides; at least 1.

    Distances between neighbouring matches grow with the picture; the size of a window does not.
    """
    return max(1.0, math.sqrt(grey.shape[0] * grey.shape[1] / (640 * 480)))


def build_pyramid(grey: GreyPicture, levels: int) -> list[Level]:
    """The picture [height, width] and ``levels`` - 1 smaller ones, finest first.

    Fewer levels where the next one would have a side of less than 16 pixels.
    """
    height, width = grey.shape
    original = np.ascontiguousarray(grey, np.float32)
    pyramid = [Level(original, 1.0, np.ones(2))]
    for number in range(1, levels):
        scale = FACTOR**number
        size = (round(width / scale), round(height / scale))
        if min(size) < MIN_LEVEL_SIDE:
            break
        # each level comes from the one before; sigma 0.7 keeps aliasing below one percent
        smooth = cv2.GaussianBlur(pyramid[-1].grey, (5, 5), 0.7)
        smaller = cv2.resize(smooth, size, interpolation=cv2.INTER_LINEAR)
        ratio = np.array([width / size[0], height / size[1]])
        pyramid.append(Level(np.asarray(smaller), scale, ratio))
    return pyramid
