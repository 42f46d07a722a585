"""points.csv: one line for each point of data that is no picture, with its structure."""

from __future__ import annotations

import numpy as np

from mssegment.export import Export
from mssegment.export.tracks import own_residuals, track_ids
from mssegment.rendering.csv_text import csv_bytes
from mssegment.rendering.report import Report

AXES = ("x", "y", "z")


def column_names(views: int, dimension: int) -> list[str]:
    """x, y, z, or x1, x2, ... in more dimensions; with the number of the view where it has two.

    Examples
    --------
    >>> column_names(2, 2), column_names(1, 5)
    (['x1', 'y1', 'x2', 'y2'], ['c1', 'c2', 'c3', 'c4', 'c5'])
    """
    names = AXES[:dimension] if dimension <= 3 else [f"c{i + 1}" for i in range(dimension)]
    if views == 1:
        return list(names)
    return [f"{name}{view + 1}" for view in range(views) for name in names]


def _content(report: Report) -> bytes:
    data = report.tracks.points if report.data is None else report.data
    ids, residuals = track_ids(report), own_residuals(report)
    rows = [
        (
            ids[i],
            *(float(value) if np.isfinite(value) else "" for value in data[i].ravel()),
            int(report.labels[i]),
            float(residuals[i]) if np.isfinite(residuals[i]) else "",
        )
        for i in range(len(data))
    ]
    return csv_bytes(("id", *column_names(*data.shape[1:]), "structure", "residual"), rows)


POINTS = Export("points.csv", "every point with its structure", _content, of_pictures=False)
