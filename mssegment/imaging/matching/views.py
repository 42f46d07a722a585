"""What the matchers of two views share: corners placed on the levels of a pyramid."""

from __future__ import annotations

from collections.abc import Sequence

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
    """A pyramid high enough for the corners' scales."""
    levels = np.rint(np.log(corners.scales) / np.log(FACTOR)).astype(np.intp)
    levels = np.maximum(levels, 0)
    pyramid = build_pyramid(picture, int(levels.max(initial=0)) + 1)
    return View(pyramid, corners.points, np.minimum(levels, len(pyramid) - 1))


def sample(pyramid: list[Level], levels: Indices, x: Singles, y: Singles) -> Singles:
    """Bilinear samples at positions ``x``, ``y`` [n, K] on the level that each row names.

    Outside a picture its border is repeated.
    """
    samples = np.empty(x.shape, np.float32)
    for number, level in enumerate(pyramid):
        rows = np.flatnonzero(levels == number)
        for part in np.array_split(rows, -(-len(rows) // 16384)) if len(rows) else ():
            samples[part] = cv2.remap(
                level.grey, x[part], y[part], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
    return samples
