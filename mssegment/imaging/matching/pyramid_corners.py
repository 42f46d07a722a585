"""A picture's pyramid with the corners on its levels: the input of both matchers of two views."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.imaging.matching.resampling import Indices
from mssegment.imaging.pictures import GreyPicture
from mssegment.imaging.pyramid import FACTOR, Level, build_pyramid
from mssegment.records import Corners, Floats, Record


class PyramidCorners(Record, frozen=True):
    """The pyramid of one picture, with corners sorted by level.

    Parameters
    ----------
    pyramid : list of Level
        Finest level first.
    points : float array [n, 2]
        Corners in pixels of the picture.
    levels : int array [n]
        Level on which each corner was detected.
    """

    pyramid: list[Level]
    points: Floats
    levels: Indices

    @property
    def scales(self) -> Floats:
        """Nominal size of a pixel of each corner's level, in pixels of the picture, [n]."""
        return np.array([level.scale for level in self.pyramid])[self.levels]

    @property
    def ratios(self) -> Floats:
        """Exact size (x, y) of a pixel of each corner's level, in pixels of the picture, [n, 2]."""
        return np.array([level.ratio for level in self.pyramid])[self.levels]

    def take(self, rows: Indices) -> PyramidCorners:
        """The same picture with some of the corners; rows may repeat."""
        return PyramidCorners(self.pyramid, self.points[rows], self.levels[rows])


def two_views(
    pictures: Sequence[GreyPicture], corners: Sequence[Corners]
) -> tuple[PyramidCorners, PyramidCorners]:
    """Both pictures with their corners; raises ValueError for other than two pictures."""
    first, second = (with_pyramid(p, c) for p, c in zip(pictures, corners, strict=True))
    return first, second


def with_pyramid(picture: GreyPicture, corners: Corners) -> PyramidCorners:
    """Build the levels that the scales of the corners ask for, and sort the corners by level."""
    levels = np.rint(np.log(corners.scales) / np.log(FACTOR)).astype(np.intp)
    levels = np.maximum(levels, 0)
    pyramid = build_pyramid(picture, int(levels.max(initial=0)) + 1)
    levels = np.minimum(levels, len(pyramid) - 1)
    order = np.argsort(levels, kind="stable")
    return PyramidCorners(pyramid, corners.points[order], levels[order])
