"""A picture to be drawn, as a list of shapes: what ``raster`` and ``svg`` both paint.

All coordinates are pixels of the finished picture, x to the right and y down, the centre of the
top left pixel at (0, 0). Items are painted in order.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Record, State
from mssegment.rendering.report import Picture
from mssegment.rendering.style import Colour

TEXT_WIDTH = 0.56
"""Mean width of a character over the height of the text, for layout."""


class Markers(Record, frozen=True):
    """The same shape at ``points`` [n, 2]; ``halo`` is the width of a light rim around each."""

    points: Floats
    shape: str
    radius: float
    colour: Colour
    halo: float = 0.0


class Lines(Record, frozen=True):
    """Polylines [n, 2] of one colour and width; ``heads`` are the triangles at their ends."""

    paths: tuple[Floats, ...]
    colour: Colour
    width: float
    heads: tuple[Floats, ...] = ()
    opacity: float = 1.0


class Areas(Record, frozen=True):
    """Closed contours [n, 2], filled with ``opacity`` and outlined with ``width``."""

    contours: tuple[Floats, ...]
    colour: Colour
    opacity: float
    width: float


class Badge(Record, frozen=True):
    """A disc with a number on it."""

    x: float
    y: float
    radius: float
    colour: Colour
    text: str


class Label(Record, frozen=True):
    """A line of text whose left end is at x, its baseline at y; ``size`` is the height."""

    x: float
    y: float
    size: float
    text: str
    colour: Colour
    bold: bool = False


Item = Markers | Lines | Areas | Badge | Label


class Scene(State):
    """A canvas of ``width`` x ``height`` pixels: photographs at places, then items over them."""

    width: int
    height: int
    photographs: list[tuple[int, int, Picture]] = msgspec.field(default_factory=list)
    items: list[Item] = msgspec.field(default_factory=list)

    def add(self, items: Sequence[Item]) -> None:
        """Paints these over what is there."""
        self.items.extend(items)


def _regular(corners: int, start: float, radii: Sequence[float]) -> Floats:
    angles = np.deg2rad(start) + 2 * np.pi * np.arange(corners) / corners
    radius = np.resize(radii, corners)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)


def _plus(arm: float, half: float) -> Floats:
    quarter = np.array([[half, -arm], [half, -half], [arm, -half]])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return np.concatenate([quarter @ np.linalg.matrix_power(turn, k) for k in range(4)])


def _rotated(points: Floats, degrees: float) -> Floats:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


# areas are about the same, so that no motion looks louder than another
OUTLINES: dict[str, npt.NDArray[np.float64]] = {
    "circle": _regular(24, 0, [1.0]),
    "dot": _regular(12, 0, [0.7]),
    "ring": _regular(16, 0, [1.0]),
    "square": _regular(4, 45, [1.27]),
    "triangle": _regular(3, -90, [1.42]) + np.array([0.0, 0.2]),
    "diamond": _regular(4, 0, [1.32]),
    "wedge": _regular(3, 90, [1.42]) - np.array([0.0, 0.2]),
    "star": _regular(10, -90, [1.6, 0.7]),
    "hexagon": _regular(6, 0, [1.14]),
    "plus": _plus(1.25, 0.45),
    "cross": _rotated(_plus(1.25, 0.32), 45),
}
"""Shape -> outline around (0, 0) of a marker of radius 1."""
