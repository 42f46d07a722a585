"""When a track moves with its object: tracks of the static world are taken along only for a while.

What passes covers the window of the picture by which a tracker follows a point of the static world,
and takes the track along. Until then it stood still, and it was no part of the object. In each
frame a track either stands still or moves as its group does, whichever predicts better how far it
moves around that frame.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import OUTLIER, Floats, Integers
from mssegment.sequences.body_frame import LEAST_TRACKS
from mssegment.sequences.parts import LEAST_FOR_AFFINE
from mssegment.special import median

HALF_STEP = 4
"""Frames before and after a frame over which displacements are measured: half of
``parts.LONGEST_STEP``."""
DEVIATIONS = 3.0
"""A group moves if it is expected to by more than so many times the error of the displacements."""
STRIDE = 2
"""Frames between those that are compared; the others are as the nearest of them."""
ROUNDS = 3
"""Rounds of reweighting of the affine map."""


def members(points: Floats, labels: Integers) -> Flags:
    """In which frames each track moves with its group, before a static camera.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups.

    Returns
    -------
    ndarray [P, F] of bool
        False where a track of a group stands still while the group moves, or is not visible; True
        where a track of no group is visible.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    found = visible.copy()
    for label in range(1, int(labels.max(initial=0)) + 1):
        rows = np.flatnonzero(labels == label)
        found[rows] = _members(points[rows], visible[rows])
    return found


def without_strangers(labels: Integers, visible: Flags, shown: Flags) -> Integers:
    """The labels, ``OUTLIER`` for tracks that move with their group in less than half their frames.

    Parameters
    ----------
    labels : ndarray [P] of int64
        1..m for groups.
    visible, shown : ndarray [P, F] of bool
        The frames in which each track is visible, and in which it moves with its group.
    """
    strange = (labels > 0) & (2 * shown.sum(axis=1) < visible.sum(axis=1))
    return np.where(strange, OUTLIER, labels)


def _members(points: Floats, visible: Flags) -> Flags:
    """The same for the tracks of one group [n, F, 2]."""
    frames = points.shape[1]
    first = visible.argmax(axis=1)
    last = frames - 1 - visible[:, ::-1].argmax(axis=1)
    strange = np.zeros_like(visible)
    for frame in range(0, frames + STRIDE // 2, STRIDE):
        low, high = max(0, frame - HALF_STEP), min(frames - 1, frame + HALF_STEP)
        known = visible[:, low] & visible[:, high]
        if known.sum() < LEAST_TRACKS:
            continue
        start, end = np.maximum(first, low), np.minimum(last, high)
        here = np.flatnonzero(start < end)
        start, end = start[here], end[here]
        moved = points[here, end] - points[here, start]
        whole = points[known, high] - points[known, low]
        expected, noise = _predicted(points[known, low], whole, points[here, start])
        expected *= ((end - start) / (high - low))[:, None]
        still = np.linalg.norm(moved, axis=1)
        with_group = np.linalg.norm(moved - expected, axis=1)
        group_moves = np.linalg.norm(expected, axis=1) > DEVIATIONS * noise
        stays = group_moves & (still < with_group)
        around = slice(max(0, frame - STRIDE // 2), frame + (STRIDE + 1) // 2)
        strange[here[stays], around] = True
    return visible & ~strange


def _predicted(places: Floats, moved: Floats, wanted: Floats) -> tuple[Floats, float]:
    """Displacements at the places ``wanted`` [m, 2], from those of tracks [n, 2], and their error.

    The error is the median of what is left of the displacements of the tracks.
    """
    middle = np.array([median(moved[:, 0]), median(moved[:, 1])])
    residual = np.linalg.norm(moved - middle, axis=1)
    if len(places) < LEAST_FOR_AFFINE:
        return np.broadcast_to(middle, wanted.shape).copy(), median(residual)
    centre = places.mean(axis=0)
    terms = np.column_stack([places - centre, np.ones(len(places))])
    fitted = np.zeros((3, 2))
    for _ in range(ROUNDS):
        scale = max(median(residual), 1e-6)
        weight = 1 / (1 + (residual / scale) ** 2)
        fitted = np.linalg.lstsq(terms * weight[:, None], moved * weight[:, None], rcond=None)[0]
        residual = np.linalg.norm(moved - terms @ fitted, axis=1)
    found = np.column_stack([wanted - centre, np.ones(len(wanted))]) @ fitted
    return np.asarray(found), median(residual)
