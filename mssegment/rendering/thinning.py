"""Which displacements are drawn: all, where there is room; else an even spread of them.

Every track keeps its marker. Without this, hundreds of long displacements of one object would
paint its surroundings in one colour, and nobody would see a direction any more.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Frame, Integers
from mssegment.rendering.report import Report

MOST_INK = 0.3
"""The share of the room of one label that its displacements may cover."""
LEAST = 12
"""So many displacements of a label are always drawn."""
PARTS = 6
WIDTH = 1 / 400
"""The width of a displacement over the diagonal of the frame, as it is drawn about everywhere."""


def carriers(report: Report, index: int, *, together: bool = False) -> npt.NDArray[np.bool_]:
    """Which tracks [P] show their displacement in frame ``index``; the same share of each label.

    ``together`` is for pictures that do not tell the labels apart: there every part of the frame
    is thinned for itself.
    """
    frame = report.frames[index]
    width = WIDTH * float(np.hypot(frame.width, frame.height))
    here = report.tracks.points[:, index]
    seen = np.asarray(np.isfinite(here).all(axis=1))
    groups = _parts(here, frame) if together else report.labels
    least = LEAST // 4 if together else LEAST
    shown = np.zeros(len(groups), dtype=bool)
    for group in np.unique(groups):
        members = np.flatnonzero(seen & (groups == group))
        room = _room(here[members])
        ink = width * _lengths(report.tracks.points[members])
        total = float(ink.sum())
        count = len(members)
        if total > MOST_INK * room:
            count = max(least, int(count * MOST_INK * room / total))
        shown[members[spread(here[members], count)]] = True
    return shown


def _parts(points: Floats, frame: Frame) -> Integers:
    """Which of ``PARTS`` x ``PARTS`` parts of the frame each point [P, 2] lies in."""
    size = np.array([max(1, frame.width), max(1, frame.height)])
    cells = np.clip(np.nan_to_num(points) / size * PARTS, 0, PARTS - 1).astype(np.int64)
    return np.asarray(cells[:, 0] + PARTS * cells[:, 1])


def spread(points: Floats, count: int) -> Integers:
    """Indices of ``count`` of the points [n, 2], each the farthest from those before it."""
    if count >= len(points):
        return np.arange(len(points))
    chosen = [int(np.argmin(((points - np.median(points, axis=0)) ** 2).sum(axis=1)))]
    x, y = points.T.copy()
    far = np.full(len(points), np.inf)
    while len(chosen) < count:
        last = chosen[-1]
        np.minimum(far, (x - x[last]) ** 2 + (y - y[last]) ** 2, out=far)
        chosen.append(int(np.argmax(far)))
    return np.sort(np.array(chosen))


def _room(points: Floats) -> float:
    """The area of the box that holds nine tenths of the points each way, in square pixels."""
    if len(points) < 2:
        return np.inf
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    return float(np.prod(np.maximum(high - low, 1.0)))


def _lengths(ways: Floats) -> Floats:
    """How long each way [n, F, 2] is from one sighting to the next, in pixels."""
    steps = np.diff(ways, axis=1)
    return np.asarray(np.nansum(np.hypot(steps[..., 0], steps[..., 1]), axis=1))
