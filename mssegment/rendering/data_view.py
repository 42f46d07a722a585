"""A view of data that is no picture: a scatter plot with axes, of which pictures can be drawn.

Points of the plane are drawn as they are, points of space from above at an angle, others along
their two principal directions. The axes are the "photograph", the points are its pixels; everything
that is drawn of tracks in pictures can be drawn of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import cv2
import numpy as np

from mssegment.records import Floats, Frame, Integers, Record, Tracks, replace
from mssegment.rendering import style
from mssegment.rendering.report import Picture, PictureOf

WIDTH, HEIGHT, MARGIN = 1200, 900, 90
"""Of the view and its border, pixels."""
AZIMUTH, ELEVATION = np.deg2rad(-60.0), np.deg2rad(28.0)
"""Where points of space are seen from: from the right in front, and above."""
TAIL, SLACK = 0.01, 0.25
"""The view holds what lies between these quantiles, widened by this share; a few points that lie
far away would make the others too small to see."""
TICK = 0.1
"""Where an axis has its numbers, as shares of its length from both ends."""
MAX_ASPECT = 4.0
"""Axes of the plane have the same scale, unless the one is this many times as long."""


class DataView(Record, frozen=True):
    """How data [P, F, d] are drawn.

    Attributes
    ----------
    low, high : ndarray [d']
        The box that is drawn, in the coordinates of the axes.
    axes : ndarray [d, d']
        The axes: those of the data, or two principal directions.
    names : tuple of str
        Their names.
    flat : ndarray [d', 2]
        Pixels per unit of each axis, right and down.
    origin : ndarray [2]
        Where the middle of the box is drawn.
    """

    low: Floats
    high: Floats
    axes: Floats
    names: tuple[str, ...]
    flat: Floats
    origin: Floats

    @classmethod
    def of(cls, points: Floats, inliers: Floats) -> DataView:
        """The view of data [P, F, d]; principal directions are those of ``inliers`` [n, d]."""
        d = points.shape[2]
        axes, names = np.eye(d), ("x", "y", "z")[:d]
        if d == 1:
            axes, names = np.array([[1.0, 0.0]]), ("x", "")
        elif d > 3:
            used = inliers if len(inliers) > d else points.reshape(-1, d)
            used = used[np.isfinite(used).all(axis=1)]
            _, _, rows = np.linalg.svd(used - used.mean(axis=0), full_matrices=False)
            axes = rows[:2].T
            names = ("1st principal direction", "2nd principal direction")
        placed = points @ axes
        low, high = _box(placed.reshape(-1, placed.shape[2]))
        unit = _directions(high - low)
        corners = (np.array(list(product(*zip(low, high, strict=True)))) - (low + high) / 2) @ unit
        room = np.array([WIDTH, HEIGHT]) - 2 * MARGIN
        zoom = float((room / np.maximum(np.ptp(corners, axis=0), 1e-300)).min())
        middle = (corners.max(axis=0) + corners.min(axis=0)) / 2 * zoom
        return cls(low, high, axes, names, unit * zoom, np.array([WIDTH, HEIGHT]) / 2 - middle)

    def place(self, points: Floats) -> Floats:
        """Positions [..., 2] of points [..., d] in pixels; NaN outside of the box."""
        along = points @ self.axes
        placed = self._pixels(along)
        inside = np.asarray(((along >= self.low) & (along <= self.high)).all(axis=-1))
        return np.where(inside[..., None], placed, np.nan)

    def _pixels(self, along: Floats) -> Floats:
        return np.asarray((along - (self.low + self.high) / 2) @ self.flat + self.origin)

    def picture(self) -> Picture:
        """The axes on white: the edges of the box, and the ends of each axis with numbers."""
        canvas = np.full((HEIGHT, WIDTH, 3), 255, dtype=np.uint8)
        corners = list(product((0, 1), repeat=len(self.low)))
        ends = {c: self._pixels(np.where(np.array(c) == 1, self.high, self.low)) for c in corners}
        for one, other in product(corners, corners):
            if one < other and sum(a != b for a, b in zip(one, other, strict=True)) == 1:
                _line(canvas, ends[one], ends[other])
        for axis, name in enumerate(self.names):
            if name:
                self._label_axis(canvas, axis, name)
        return canvas

    def _label_axis(self, canvas: Picture, axis: int, name: str) -> None:
        """The name of an axis in the middle of one of its edges, and its ends beside it."""
        edge = _outer_edge(len(self.low), axis)
        places = []
        for share in (TICK, 0.5, 1.0 - TICK):
            along = np.where(edge == 1, self.high, self.low).astype(np.float64)
            along[axis] = self.low[axis] + share * (self.high[axis] - self.low[axis])
            places.append(self._pixels(along))
        outward = places[1] - np.array([WIDTH, HEIGHT]) / 2
        outward = 30.0 * outward / max(float(np.linalg.norm(outward)), 1.0)
        low, high = self.low[axis], self.high[axis]
        ends = [low + share * (high - low) for share in (TICK, 1.0 - TICK)]
        texts = (f"{ends[0]:.3g}", name, f"{ends[1]:.3g}")
        for place, text in zip(places, texts, strict=True):
            _text(canvas, place + outward, text)


def data_display(
    points: Floats, tracks: Tracks, frames: Sequence[Frame], labels: Integers
) -> tuple[tuple[Frame, ...], Tracks, PictureOf]:
    """Frames, tracks in pixels and pictures that show data [P, F, d]."""
    first = points[:, 0]
    view = DataView.of(points, first[(labels > 0) & np.isfinite(first).all(axis=1)])
    canvas = view.picture()
    shown = tuple(replace(frame, width=WIDTH, height=HEIGHT) for frame in frames)
    return shown, replace(tracks, points=view.place(points)), lambda index: canvas


def _box(placed: Floats) -> tuple[Floats, Floats]:
    """The lowest and highest coordinates that are shown."""
    placed = placed[np.isfinite(placed).all(axis=1)]
    if not len(placed):
        return np.zeros(placed.shape[1]), np.ones(placed.shape[1])
    low, high = np.quantile(placed, [TAIL, 1 - TAIL], axis=0)
    slack = SLACK * (high - low)
    low, high = (
        np.maximum(placed.min(axis=0), low - slack),
        np.minimum(placed.max(axis=0), high + slack),
    )
    same = high <= low
    half = np.where(same, np.maximum(1e-6 * np.abs(low), 1e-12), 0.0)
    return low - half, high + half


def _directions(extent: Floats) -> Floats:
    """Right and down of each axis [d', 2], for a box of this extent."""
    if len(extent) == 2:
        unit = np.array([[1.0, 0.0], [0.0, -1.0]])
        if extent.max() > MAX_ASPECT * extent.min():
            unit *= np.array([[4.0 / extent[0]], [3.0 / extent[1]]])
        return unit
    turn, tilt = np.cos(AZIMUTH), np.sin(AZIMUTH)
    right = np.array([-tilt, turn, 0.0])
    depth = np.array([turn, tilt, 0.0])
    down = np.sin(ELEVATION) * depth - np.cos(ELEVATION) * np.array([0.0, 0.0, 1.0])
    return np.stack([right, down], axis=1)


def _outer_edge(count: int, axis: int) -> Floats:
    """Which end of the other axes the labelled edge of an axis is at."""
    if count == 2:
        return np.zeros(2)
    return np.asarray([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]][axis])


def _line(canvas: Picture, one: Floats, other: Floats) -> None:
    start, end = (tuple(round(float(v)) for v in place) for place in (one, other))
    cv2.line(canvas, start, end, (205, 205, 205), 1, cv2.LINE_AA)


def _text(canvas: Picture, place: Floats, text: str) -> None:
    """Text with its middle at a place, moved inside the canvas."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.6, 1)
    x = int(np.clip(place[0] - width / 2, 4, WIDTH - width - 4))
    y = int(np.clip(place[1] + height / 2, height + 4, HEIGHT - 6))
    cv2.putText(
        canvas, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.6, style.MUTED[::-1], 1, cv2.LINE_AA
    )
