"""What the matchers of two views share: corners placed on the levels of a pyramid."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import UsageError
from mssegment.imaging.pictures import Grey
from mssegment.imaging.pyramid import FACTOR, Level, build_pyramid
from mssegment.records import Corners, Floats, Record

Singles = npt.NDArray[np.float32]
Indices = npt.NDArray[np.intp]


class View(Record, frozen=True):
    """One picture's pyramid and its corners: positions in the picture, level of each."""

    pyramid: list[Level]
    points: Floats
    levels: Indices

    @property
    def scales(self) -> Floats:
        """Pixels of the picture per pixel of each corner's level."""
        return np.array([level.scale for level in self.pyramid])[self.levels]

    @property
    def ratios(self) -> Floats:
        """The same exactly, (x, y), [n, 2]."""
        return np.array([level.ratio for level in self.pyramid])[self.levels]

    def take(self, rows: Indices) -> View:
        """The same picture with some of the corners, which may come more than once."""
        return View(self.pyramid, self.points[rows], self.levels[rows])


def two_views(
    method: str, pictures: Sequence[Grey], corners: Sequence[Corners]
) -> tuple[View, View]:
    """Both pictures with their corners; ``UsageError`` where there are not two."""
    if len(pictures) != 2 or len(corners) != 2:
        raise UsageError(
            f"match method {method!r} takes two pictures, found {len(pictures)}; use flow"
        )
    first, second = (view_of(p, c) for p, c in zip(pictures, corners, strict=True))
    return first, second


def view_of(picture: Grey, corners: Corners) -> View:
    """A pyramid high enough for the corners' scales, and these ordered by level."""
    levels = np.rint(np.log(corners.scales) / np.log(FACTOR)).astype(np.intp)
    levels = np.maximum(levels, 0)
    pyramid = build_pyramid(picture, int(levels.max(initial=0)) + 1)
    levels = np.minimum(levels, len(pyramid) - 1)
    order = np.argsort(levels, kind="stable")
    return View(pyramid, corners.points[order], levels[order])


def runs(levels: Indices, most: int = 16384) -> Iterator[tuple[slice, int]]:
    """Slices of equal level, at most so many rows each, and the level."""
    ends = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
    for begin, end in pairwise(ends):
        for start in range(begin, end, most):
            yield slice(start, min(start + most, end)), int(levels[begin])


def grid(side: int, step: float) -> Singles:
    """Offsets (x, y) [side^2, 2] of a square grid around 0, in pixels."""
    line = (np.arange(side) - (side - 1) / 2) * step
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2).astype(np.float32)


def seen(pyramid: list[Level], levels: Indices, maps: Floats, offsets: Singles) -> Singles:
    """Bilinear samples [n, K] under windows, each on its level; rows of a level come together.

    ``maps`` [n, 2, 3] take offsets (u, v, 1) of a window to positions on its level. Outside a
    picture its border is repeated.
    """
    place = np.column_stack([offsets, np.ones_like(offsets[:, 0])]).T
    single = maps.astype(np.float32)
    x, y = single[:, 0] @ place, single[:, 1] @ place
    samples = np.empty(x.shape, np.float32)
    for rows, level in runs(levels):
        samples[rows] = cv2.remap(
            pyramid[level].grey, x[rows], y[rows], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    return samples
