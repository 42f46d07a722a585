"""objects.csv: where each motion is in each frame, and how far it moved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mssegment.export import Export
from mssegment.export.tracks import frame_numbers
from mssegment.records import Floats, Integers, Record
from mssegment.rendering.csv_text import csv_bytes
from mssegment.rendering.regions import not_isolated
from mssegment.rendering.report import Report

HEADER = (
    "frame",
    "motion",
    "camera",
    "x_min",
    "y_min",
    "x_max",
    "y_max",
    "centroid_x",
    "centroid_y",
    "tracks",
    "dx",
    "dy",
    "displacement_px",
)


class Sighting(Record, frozen=True):
    """A motion in one frame.

    Attributes
    ----------
    frame : int
        The position of the frame.
    label : int
        The motion.
    points : ndarray [n, 2]
        The positions of its tracks, in pixels, without those far from all others.
    shift : ndarray [2]
        The median displacement since the previous frame, in pixels; NaN where no track shows it.
    """

    frame: int
    label: int
    points: Floats
    shift: Floats

    @property
    def box(self) -> tuple[float, float, float, float]:
        """The least and the greatest x and y: left, top, right, bottom."""
        (left, top), (right, bottom) = self.points.min(axis=0), self.points.max(axis=0)
        return float(left), float(top), float(right), float(bottom)


def sightings(report: Report, labels: Integers) -> Iterator[Sighting]:
    """The motions in each frame, frame by frame; only those with tracks among others."""
    points = report.tracks.points
    for frame in range(points.shape[1]):
        for label in labels:
            own = points[report.members(int(label))]
            here = own[np.isfinite(own[:, frame]).all(axis=1), frame]
            here = here[not_isolated(here)]
            if not len(here):
                continue
            steps = own[:, frame] - own[:, frame - 1] if frame else np.zeros((0, 2))
            steps = steps[np.isfinite(steps).all(axis=1)]
            shift = np.median(steps, axis=0) if len(steps) else np.full(2, np.nan)
            yield Sighting(frame, int(label), here, shift)


def _content(report: Report) -> bytes:
    numbers = frame_numbers(report)
    labels = np.array([motion.label for motion in report.motions], dtype=np.int64)
    rows = []
    for seen in sightings(report, labels):
        shift = [*seen.shift, np.hypot(*seen.shift)]
        rows.append(
            [
                numbers[seen.frame],
                seen.label,
                int(seen.label == report.camera_motion),
                *(round(value, 3) for value in seen.box),
                *(round(float(value), 3) for value in seen.points.mean(axis=0)),
                len(seen.points),
                *("" if np.isnan(value) else round(float(value), 3) for value in shift),
            ]
        )
    return csv_bytes(HEADER, rows)


OBJECTS = Export("objects.csv", "box, centroid and displacement of every motion", _content)
