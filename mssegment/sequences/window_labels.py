"""The segmentation of a window, and what it says of its motions without earlier windows."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mssegment.models import Flags
from mssegment.records import BACKGROUND, NOT_JUDGED, Floats, Integers, Record, field
from mssegment.sequences.history import STATIC_WORLD
from mssegment.special import nan_median

Votes = Mapping[int, float]

LEAST_VOTES = 3.0
"""Tracks that a motion must share with an object: as many as determine an affine motion."""
NO_OBJECT = -1
"""The identity of what is no object."""


class WindowLabels(Record, frozen=True):
    """The segmentation of one window.

    Attributes
    ----------
    start : int
        The number of its first frame.
    tracks : ndarray [P] of int64
        The numbers that the tracks have in all windows.
    points : ndarray [P, L, 2]
        Their positions in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for a motion, ``OUTLIER``, ``BACKGROUND`` or ``NOT_JUDGED``.
    camera_motion : int or None
        The label that seems to be the motion of the static world.
    stuck : ndarray [P] of bool, optional
        The tracks that stand still at their end, while their motion goes on.
    """

    start: int
    tracks: Integers
    points: Floats
    labels: Integers
    camera_motion: int | None = None
    stuck: Flags | None = None

    @property
    def motions(self) -> int:
        """The number of motions."""
        return int(self.labels.max(initial=0))


class WindowIdentities(Record, frozen=True):
    """What the motions of a window are.

    Attributes
    ----------
    motions : tuple of int
        The identity of each motion, label 1 first; ``STATIC_WORLD`` for that of the camera,
        ``NO_OBJECT`` for what is none.
    tracks : ndarray [P] of int64
        The identity of each track; -1 for none.
    resting : tuple of int
        The objects that stand still in this window.
    origins : dict
        For objects that begin by a split, the object that they were part of.
    merged : dict
        For objects whose tracks are now of another object, that object.
    """

    motions: tuple[int, ...]
    tracks: Integers
    resting: tuple[int, ...] = ()
    origins: dict[int, int] = field(default_factory=dict)
    merged: dict[int, int] = field(default_factory=dict)


def identities_of_tracks(
    window: WindowLabels,
    own: list[Integers],
    identity: Mapping[int, int],
    resting: Mapping[int, Integers],
) -> Integers:
    """The identity of each track, of motions and of objects that rest."""
    tracks = np.where(window.labels == BACKGROUND, STATIC_WORLD, NO_OBJECT).astype(np.int64)
    for j, rows in enumerate(own):
        tracks[rows] = identity[j]
    for known, rows in resting.items():
        tracks[rows] = known
    return tracks


def travel(points: Floats) -> float:
    """How far tracks [n, L, 2] move as a group, in pixels.

    What moved less than the window of the tracker may have been taken along, or have slipped.
    """
    with_next = np.isfinite(points[:, 1:, 0]) & np.isfinite(points[:, :-1, 0])
    frames = np.flatnonzero(with_next.any(axis=0))
    steps = nan_median(points[:, frames + 1] - points[:, frames], axis=0)
    return float(np.linalg.norm(steps.sum(axis=0))) if len(frames) else 0.0


def net_displacement(points: Floats) -> float:
    """The median distance of the last position of tracks [n, L, 2] from the first, in pixels."""
    visible = np.asarray(np.isfinite(points).all(axis=2))
    rows = np.arange(len(points))
    first = visible.argmax(axis=1)
    last = points.shape[1] - 1 - visible[:, ::-1].argmax(axis=1)
    return float(np.median(np.linalg.norm(points[rows, last] - points[rows, first], axis=1)))


def parent_of(votes: Votes) -> int | None:
    """The object of which most tracks of a new motion were, if any."""
    moving = {i: count for i, count in votes.items() if i != STATIC_WORLD}
    if not moving:
        return None
    best = max(moving, key=lambda i: (moving[i], -i))
    enough = moving[best] >= max(LEAST_VOTES, sum(votes.values()) / 2)
    return best if enough else None


def merged_into(
    window: WindowLabels, tracks: Integers, usual: Integers, present: set[int]
) -> dict[int, int]:
    """The objects that are not present, whose tracks are now of another object."""
    found = {}
    for known in np.unique(usual[usual > STATIC_WORLD]).tolist():
        if known in present:
            continue
        now = tracks[(usual == known) & (window.labels != NOT_JUDGED)]
        moving = now[now > STATIC_WORLD]
        if len(moving) >= max(LEAST_VOTES, len(now) / 2):
            found[known] = int(np.bincount(moving).argmax())
    return found
