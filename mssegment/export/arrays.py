"""tracks.npz: everything as arrays, for ``numpy.load``."""

from __future__ import annotations

import io

import numpy as np

from mssegment.export import Export
from mssegment.export.tracks import frame_numbers, own_residuals, track_ids
from mssegment.rendering.report import Report


def _content(report: Report) -> bytes:
    """Arrays by name.

    ``points`` [P, F, 2], ``visibility`` [P, F], ``labels`` [P], ``ids`` [P], ``residuals`` [P],
    ``frames`` [F], ``motions`` [m], ``matrices`` [m, 3, 3] or [m, F, 3, 3] (NaN without one) and
    ``camera_motion`` (0 if there is none).
    """
    motions, frames = report.motions, len(report.frames)
    shape = (3, 3) if frames == 2 else (frames, 3, 3)
    matrices = np.full((len(motions), *shape), np.nan)
    for row, motion in enumerate(motions):
        if motion.matrix is not None and motion.matrix.shape == shape:
            matrices[row] = motion.matrix
    out = io.BytesIO()
    np.savez_compressed(
        out,
        points=report.tracks.points,
        visibility=report.tracks.visible,
        labels=report.labels,
        ids=np.array(track_ids(report), dtype=str),
        residuals=own_residuals(report),
        frames=np.array(frame_numbers(report), dtype=np.int64),
        motions=np.array([motion.label for motion in motions], dtype=np.int64),
        matrices=matrices,
        camera_motion=np.int64(report.camera_motion or 0),
    )
    return out.getvalue()


ARRAYS = Export("tracks.npz", "points, labels, ids and matrices as arrays", _content)
