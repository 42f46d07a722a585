"""A picture to be drawn, as a list of shapes that ``raster`` and ``svg`` draw.

Coordinates are pixels of the finished picture, x to the right and y down, the centre of the top
left pixel at (0, 0). Items are drawn in order.
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
"""Mean width of a character relative to the height of the text."""


class Markers(Record, frozen=True):
    """Markers of one shape at ``points`` [n, 2]; ``halo`` is the width of a light rim."""

    points: Floats
    shape: str
    radius: float
    colour: Colour
    halo: float = 0.0


class Lines(Record, frozen=True):
    """Polylines [n, 2] of one colour and width; ``heads`` are the arrowheads [3, 2]."""

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
    """A line of text with its left end at x and its baseline at y; ``size`` is its height."""

    x: float
    y: float
    size: float
    text: str
    colour: Colour
    bold: bool = False


Item = Markers | Lines | Areas | Badge | Label


class Scene(State):
    """A canvas in pixels: photographs (left, top, picture) and the items drawn over them."""

    width: int
    height: int
    photographs: list[tuple[int, int, Picture]] = msgspec.field(default_factory=list)
    items: list[Item] = msgspec.field(default_factory=list)

    def add(self, items: Sequence[Item]) -> None:
        """Append items, which are drawn over the present ones."""
        self.items.extend(items)


def _polygon(corners: int, start: float, radii: Sequence[float]) -> Floats:
    """A polygon or star: corners at equal angles from ``start`` degrees, ``radii`` in turn."""
    angles = np.deg2rad(start) + 2 * np.pi * np.arange(corners) / corners
    radius = np.resize(radii, corners)
    return np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)


def _plus(arm: float, half: float) -> Floats:
    """A plus sign with arms of length ``arm`` and half width ``half``."""
    quarter = np.array([[half, -arm], [half, -half], [arm, -half]])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    return np.concatenate([quarter @ np.linalg.matrix_power(turn, k) for k in range(4)])


def _rotated(points: Floats, degrees: float) -> Floats:
    """Points [n, 2] rotated around the origin."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.asarray(points @ np.array([[c, s], [-s, c]]))


# similar areas, so that no motion stands out
OUTLINES: dict[str, npt.NDArray[np.float64]] = {
    "circle": _polygon(24, 0, [1.0]),
    "dot": _polygon(12, 0, [0.7]),
    "ring": _polygon(16, 0, [1.0]),
    "square": _polygon(4, 45, [1.27]),
    "triangle": _polygon(3, -90, [1.42]) + np.array([0.0, 0.2]),
    "diamond": _polygon(4, 0, [1.32]),
    "wedge": _polygon(3, 90, [1.42]) - np.array([0.0, 0.2]),
    "star": _polygon(10, -90, [1.6, 0.7]),
    "hexagon": _polygon(6, 0, [1.14]),
    "plus": _plus(1.25, 0.45),
    "cross": _rotated(_plus(1.25, 0.32), 45),
}
"""Shape -> outline [n, 2] around (0, 0) of a marker of radius 1."""
