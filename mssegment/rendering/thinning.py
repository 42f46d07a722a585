"""Which displacements are drawn: all where there is space, else an evenly spread share.

Every track keeps its marker. Hundreds of long displacements of one object would cover its
surroundings and hide the directions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Frame, Integers
from mssegment.rendering.report import Report

MAX_COVERAGE = 0.3
"""Share of the area of a group of tracks that its displacements may cover."""
MIN_DISPLACEMENTS = 12
"""Displacements of a label that are drawn in any case."""
GRID_CELLS = 6
"""Cells per side of the grid on which displacements are thinned without regard to labels."""
RELATIVE_WIDTH = 1 / 400
"""Approximate width of a drawn displacement, relative to the diagonal of the frame."""


def shown_displacements(
    report: Report, index: int, *, ignore_labels: bool = False
) -> npt.NDArray[np.bool_]:
    """Select the tracks whose displacement is drawn in a frame.

    Parameters
    ----------
    report : Report
        The segmentation.
    index : int
        Number of the frame.
    ignore_labels : bool
        For pictures that do not show labels: thin every cell of a grid by itself, not every label.

    Returns
    -------
    bool array [P]
    """
    frame = report.frames[index]
    width = RELATIVE_WIDTH * float(np.hypot(frame.width, frame.height))
    positions = report.tracks.points[:, index]
    visible = np.asarray(np.isfinite(positions).all(axis=1))
    groups = _grid_cells(positions, frame) if ignore_labels else report.labels
    least = MIN_DISPLACEMENTS // 4 if ignore_labels else MIN_DISPLACEMENTS
    shown = np.zeros(len(groups), dtype=bool)
    for group in np.unique(groups):
        members = np.flatnonzero(visible & (groups == group))
        area = _occupied_area(positions[members])
        covered = float((width * _lengths(report.tracks.points[members])).sum())
        count = len(members)
        if covered > MAX_COVERAGE * area:
            count = max(least, int(count * MAX_COVERAGE * area / covered))
        shown[members[farthest_points(positions[members], count)]] = True
    return shown


def _grid_cells(points: Floats, frame: Frame) -> Integers:
    """The cell of a regular grid over the frame in which each point [P, 2] lies."""
    size = np.array([max(1, frame.width), max(1, frame.height)])
    cells = np.clip(np.nan_to_num(points) / size * GRID_CELLS, 0, GRID_CELLS - 1).astype(np.int64)
    return np.asarray(cells[:, 0] + GRID_CELLS * cells[:, 1])


def farthest_points(points: Floats, count: int) -> Integers:
    """Select points by farthest point sampling, starting next to the median.

    ``points`` is [n, 2]; returns ``count`` ascending indices, all where there are fewer points.
    """
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


def _occupied_area(points: Floats) -> float:
    """Area in square pixels of the box between the 5 % and 95 % quantiles of points [n, 2]."""
    if len(points) < 2:
        return np.inf
    low, high = np.quantile(points, [0.05, 0.95], axis=0)
    return float(np.prod(np.maximum(high - low, 1.0)))


def _lengths(tracks: Floats) -> Floats:
    """Length in pixels of each track [n, F, 2], over consecutive frames in which it is visible."""
    steps = np.diff(tracks, axis=1)
    return np.asarray(np.nansum(np.hypot(steps[..., 0], steps[..., 1]), axis=1))
