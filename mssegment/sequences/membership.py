"""When a track moves with its object: tracks of the static world are taken along only for a while.

What passes covers the window of the picture by which a tracker follows a point of the static world,
and takes the track along. Until then it stood still, and it was no part of the object. In each
frame a track either stands still or moves as its group does, whichever predicts better how far it
moves around that frame.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import OUTLIER, Floats, Integers, Record
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


def left_behind(labels: Integers, visible: Flags, shown: Flags) -> Flags:
    """The tracks that stand still at their end, while their group moves on.

    Parameters
    ----------
    labels : ndarray [P] of int64
        1..m for groups.
    visible, shown : ndarray [P, F] of bool
        The frames in which each track is visible, and in which it moves with its group.

    Returns
    -------
    ndarray [P] of bool
        Those tracks; the static world has kept them, or has got them back.
    """
    last = visible.shape[1] - 1 - visible[:, ::-1].argmax(axis=1)
    return np.asarray((labels > 0) & visible.any(axis=1) & ~shown[np.arange(len(labels)), last])


def _members(points: Floats, visible: Flags) -> Flags:
    """The same for the tracks of one group [n, F, 2].

    A track that has stood still while the group moved stays behind until it moves with it again. A
    group stops as a whole: where less than half of what has moved stands still, that stays behind.
    """
    frames = points.shape[1]
    strange = np.zeros_like(visible)
    behind, has_moved, judged = (np.zeros(len(points), dtype=bool) for _ in range(3))
    moving: list[int] = []
    velocity = np.zeros(2)
    for frame in range(0, frames + STRIDE // 2, STRIDE):
        around = slice(max(0, frame - HALF_STEP), min(frames - 1, frame + HALF_STEP) + 1)
        steps = _Steps.of(points[:, around], visible[:, around])
        rows, stays = steps.judged(~behind)
        if len(rows):
            strange[rows[stays & ~judged[rows]], : frame + 1] = True
            behind[rows], judged[rows] = stays, True
            has_moved[rows[~stays]] = True
            moving.append(int((~stays).sum()))
            if moving[-1]:
                velocity = steps.velocity(rows[~stays])
        elif moving:
            at_rest = steps.at_rest(velocity) & has_moved & ~behind
            if 2 * at_rest.sum() < np.median(moving):
                behind |= at_rest
        strange[behind, max(0, frame - STRIDE // 2) : frame + (STRIDE + 1) // 2] = True
    return visible & ~strange


class _Steps(Record, frozen=True):
    """Tracks [n, k, 2] in the frames around one, and how far they move while they are visible.

    ``moved`` [n, 2] in ``duration`` [n] frames, 0 for tracks that are visible in fewer than two.
    """

    points: Floats
    start: Integers
    duration: Integers
    moved: Floats
    whole: Flags

    @classmethod
    def of(cls, points: Floats, visible: Flags) -> _Steps:
        rows, last = np.arange(len(points)), points.shape[1] - 1
        start, end = visible.argmax(axis=1), last - visible[:, ::-1].argmax(axis=1)
        duration = np.where(visible.any(axis=1), end - start, 0)
        moved = points[rows, end] - points[rows, start]
        return cls(points, start, duration, moved, visible[:, 0] & visible[:, -1])

    def judged(self, of_group: Flags) -> tuple[Integers, Flags]:
        """The tracks that can be judged, and which of them stand still.

        None where the group does not move, or too few tracks ``of_group`` tell how.
        """
        known = self.whole & of_group
        if known.sum() < LEAST_TRACKS:
            return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=bool)
        rows = np.flatnonzero(self.duration > 0)
        places = self.points[rows, self.start[rows]]
        expected, noise = predicted(self.points[known, 0], self.moved[known], places)
        expected *= (self.duration[rows] / (self.points.shape[1] - 1))[:, None]
        group_moves = np.linalg.norm(expected, axis=1) > DEVIATIONS * noise
        moved = self.moved[rows]
        stays = np.linalg.norm(moved, axis=1) < np.linalg.norm(moved - expected, axis=1)
        return rows[group_moves], stays[group_moves]

    def velocity(self, rows: Integers) -> Floats:
        """The median velocity of some tracks, in pixels a frame."""
        return np.asarray(np.median(self.moved[rows] / self.duration[rows][:, None], axis=0))

    def at_rest(self, velocity: Floats) -> Flags:
        """The tracks [n] that rather stand still than move with a velocity."""
        expected = self.duration[:, None] * velocity
        stays = np.linalg.norm(self.moved, axis=1) < np.linalg.norm(self.moved - expected, axis=1)
        return np.asarray((self.duration > 0) & stays)


def predicted(places: Floats, moved: Floats, wanted: Floats) -> tuple[Floats, float]:
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
