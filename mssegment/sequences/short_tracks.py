"""Labels of tracks that are too short to be segmented: those of the tracks around them.

A track of four frames says little about a motion, but the motions of its time are known from longer
tracks. It takes the label of the neighbour that moves most like it.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import BACKGROUND, NOT_JUDGED, Floats, Integers

NEIGHBOURS = 8
"""Labelled tracks around a short one that are compared with it."""
LEAST_FRAMES = 2
"""Frames of a track that can be compared."""
DEVIATIONS = 3.0
"""Largest difference of the displacements, in standard deviations of those of neighbours with one
label."""
SAMPLE = 40
"""Tracks from which the noise is estimated, at least."""
NORMAL_MAD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation."""


def label_short_tracks(points: Floats, labels: Integers) -> Integers:
    """Label the tracks that are not judged like their neighbours.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m, ``OUTLIER``, ``BACKGROUND``, or ``NOT_JUDGED`` for the tracks to label.

    Returns
    -------
    ndarray [P] of int64
        The labels; ``NOT_JUDGED`` stays where no neighbour moves like the track, within the noise
        that is measured between neighbours of one label.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    known = np.flatnonzero((labels > 0) | (labels == BACKGROUND))
    short = np.flatnonzero((labels == NOT_JUDGED) & (visible.sum(axis=1) >= LEAST_FRAMES))
    found = labels.copy()
    if not len(known) or not len(short):
        return found
    noise = _noise(points, visible, known[labels[known] > 0], labels)
    for track in short:
        near, difference = _neighbours(points, visible, int(track), known)
        if len(near) and difference.min() <= DEVIATIONS * noise:
            found[track] = labels[near[difference.argmin()]]
    return found


def _neighbours(
    points: Floats, visible: Flags, track: int, others: Integers
) -> tuple[Integers, Floats]:
    """The ``others`` near a track, and how much their displacement differs, in pixels.

    Positions and displacements are those between its first and its last frame.
    """
    frames = np.flatnonzero(visible[track])[[0, -1]]
    others = others[visible[others, frames[0]] & visible[others, frames[1]] & (others != track)]
    own, theirs = points[track, frames], points[others[:, None], frames]
    order = np.argsort(np.linalg.norm(theirs - own, axis=2).sum(axis=1), kind="stable")[:NEIGHBOURS]
    moved = np.diff(theirs[order], axis=1)[:, 0] - (own[1] - own[0])
    return others[order], np.asarray(np.linalg.norm(moved, axis=1))


def _noise(points: Floats, visible: Flags, known: Integers, labels: Integers) -> float:
    """Standard deviation of the difference of displacements of neighbours with one label."""
    sample = known[:: max(1, len(known) // SAMPLE)]
    differences = []
    for track in sample:
        alike = known[labels[known] == labels[track]]
        _, difference = _neighbours(points, visible, int(track), alike)
        if len(difference):
            differences.append(float(difference.min()))
    return NORMAL_MAD * float(np.median(differences)) if differences else 0.0
