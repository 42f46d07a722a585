"""tracks.csv: one line for each track in each frame that shows it."""

from __future__ import annotations

import numpy as np

from mssegment.export import Export
from mssegment.records import Floats
from mssegment.rendering.csv_text import csv_bytes
from mssegment.rendering.report import Report

HEADER = ("id", "frame", "x", "y", "motion", "residual_px", "inlier")


def track_ids(report: Report) -> tuple[str, ...]:
    """The ids of the tracks in the file that they come from, otherwise 1, 2, ..."""
    return report.tracks.ids or tuple(str(i + 1) for i in range(len(report.labels)))


def frame_numbers(report: Report) -> list[int]:
    """The numbers of the frames from 0: those inside a video, otherwise their positions."""
    indices = [frame.index for frame in report.frames]
    of_one_file = len({frame.path for frame in report.frames}) == 1
    if of_one_file and None not in indices and len(set(indices)) == len(indices):
        return [int(index or 0) for index in indices]
    return list(range(len(indices)))


def own_residuals(report: Report) -> Floats:
    """The residual of each track from its own motion, in pixels [P]; NaN where there is none."""
    found = np.full(len(report.labels), np.nan)
    residuals = report.segmentation.residuals
    for row, motion in enumerate(report.segmentation.motions):
        if residuals.ndim == 2 and row < len(residuals):
            own = report.members(motion.label)
            found[own] = residuals[row, own]
    return found


def _content(report: Report) -> bytes:
    ids, numbers = track_ids(report), frame_numbers(report)
    residuals = own_residuals(report)
    visible = report.tracks.visible
    rows = []
    for track, frame in np.argwhere(visible):
        x, y = report.tracks.points[track, frame]
        label, residual = int(report.labels[track]), residuals[track]
        rows.append(
            (
                ids[track],
                numbers[frame],
                round(float(x), 3),
                round(float(y), 3),
                label,
                "" if not np.isfinite(residual) else round(float(residual), 4),
                int(label > 0),
            )
        )
    return csv_bytes(HEADER, rows)


TRACKS = Export("tracks.csv", "every position of every track", _content)
