"""Objects before a static camera that were found in parts, and tracks that are no object.

The parts of a large object are tracked one after the other while it enters the picture, so that
their tracks have few frames in common, and parts at different distances from the camera move
differently. Two groups are parts of one object if nothing static is seen between them, and they
move alike where they meet.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers, Record

LARGEST_RELIEF = 1 / 3
"""Largest difference of the velocities of neighbours in an object, relative to their speed. The
image of a point moves the faster the nearer it is, so this is the depth of an object relative to
its distance."""
COMPARED_FRAMES = 8
"""Moments at which two groups are compared."""
LONGEST_STEP = 8
"""Frames over which velocities are measured, at most."""
LEAST_TRACKS = 3
"""Tracks of a group in a frame that say how it moves."""
LEAST_FOR_AFFINE = 9
"""Tracks from which on an affine map is fitted to their velocities: three times its minimum."""
BORDER_SHARE = 4
"""The pairs of tracks at the border are as many as 1 / BORDER_SHARE of the smaller group."""
DETOUR = 1.1
"""A track lies between two others if the way over it is at most so much longer."""


def join_parts(points: Floats, labels: Integers) -> Integers:
    """Give the parts of each object one label.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups, ``BACKGROUND`` for static tracks.

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k, the largest group first.
    """
    count = int(labels.max(initial=0))
    visible = np.asarray(np.isfinite(points).all(axis=2))
    parent = list(range(count + 1))

    def root(label: int) -> int:
        while parent[label] != label:
            label = parent[label]
        return label

    for first in range(1, count + 1):
        for second in range(first + 1, count + 1):
            if root(first) != root(second) and _are_parts(points, visible, labels, first, second):
                parent[root(second)] = root(first)
    joined = np.array([root(label) for label in range(count + 1)])
    return by_size(np.where(labels > 0, joined[np.maximum(labels, 0)], labels))


def coherent(points: Floats, labels: Integers) -> Integers:
    """The labels without groups that do not move as one: these are outliers.

    What passes drags along the tracks at its border, and tracks slip along edges. They move one
    after the other, while the nearest neighbours in an object move alike.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups.

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k of the groups that are left, the largest first.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    found = labels.copy()
    for label in range(1, int(labels.max(initial=0)) + 1):
        own = labels == label
        if _incoherence(points[own], visible[own]) > LARGEST_RELIEF:
            found[own] = OUTLIER
    return by_size(found)


def _incoherence(points: Floats, visible: Flags) -> float:
    """How much neighbours in a group differ in velocity, relative to their speed.

    The affine part of the velocities, such as that of a turn, is no difference.
    """
    step = _step(points.shape[1])
    both = visible[:, :-step] & visible[:, step:]
    frames = np.flatnonzero(both.sum(axis=0) >= LEAST_TRACKS)
    if not len(frames):
        return 0.0  # nothing to tell from
    difference = speed = 0.0
    for frame in frames[np.linspace(0, len(frames) - 1, COMPARED_FRAMES).round().astype(int)]:
        here = points[both[:, frame]]
        places, moved = here[:, frame], here[:, frame + step] - here[:, frame]
        speed += float(np.median(np.linalg.norm(moved, axis=1)))
        if len(places) >= LEAST_FOR_AFFINE:
            terms = np.column_stack([places - places.mean(axis=0), np.ones(len(places))])
            moved = moved - terms @ np.linalg.lstsq(terms, moved)[0]
        _, near = nearest(places, places, 2)
        difference += float(np.median(np.linalg.norm(moved - moved[near[:, 1]], axis=1)))
    return difference / speed if speed else 0.0


def _step(frames: int) -> int:
    """The number of frames over which velocities are measured."""
    return max(1, min(frames // 4, LONGEST_STEP))


def by_size(labels: Integers) -> Integers:
    """The labels with the positive ones renumbered, the largest group first."""
    names, sizes = np.unique(labels[labels > 0], return_counts=True)
    found = labels.copy()
    for number, name in enumerate(names[np.argsort(-sizes, kind="stable")], start=1):
        found[labels == name] = number
    return found


def _are_parts(points: Floats, visible: Flags, labels: Integers, first: int, second: int) -> bool:
    """Whether two groups are parts of one object, at most of the moments compared."""
    step = _step(points.shape[1])
    both = visible[:, :-step] & visible[:, step:]
    shown = np.stack([both[labels == one].sum(axis=0) for one in (first, second)]).min(axis=0)
    frames = np.flatnonzero(shown >= LEAST_TRACKS)
    if not len(frames):
        return False
    chosen = frames[np.linspace(0, len(frames) - 1, COMPARED_FRAMES).round().astype(int)]
    verdicts = []
    for frame in np.unique(chosen).tolist():
        here = points[both[:, frame]][:, [frame, frame + step]]
        verdicts.append(_agree(_Moment.of(here, labels[both[:, frame]], first, second)))
    return 2 * sum(verdicts) > len(verdicts)


class _Moment(Record, frozen=True):
    """Two groups at one moment: positions and displacements [n, 2], and the static positions."""

    positions: tuple[Floats, Floats]
    moved: tuple[Floats, Floats]
    static: Floats

    @classmethod
    def of(cls, pairs: Floats, labels: Integers, first: int, second: int) -> _Moment:
        """From positions [n, 2, 2] in two frames and ``labels`` [n]."""
        a, b = pairs[labels == first], pairs[labels == second]
        return cls(
            (a[:, 0], b[:, 0]),
            (a[:, 1] - a[:, 0], b[:, 1] - b[:, 0]),
            pairs[labels == BACKGROUND][:, 0],
        )


def _agree(moment: _Moment) -> bool:
    """Whether the groups move alike where they meet, with nothing static between them."""
    (one, two), (moved1, moved2) = moment.positions, moment.moved
    apart = np.linalg.norm(one[:, None] - two, axis=2)
    count = max(LEAST_TRACKS, min(len(one), len(two)) // BORDER_SHARE)
    i, j = np.unravel_index(np.argsort(apart, axis=None, kind="stable")[:count], apart.shape)
    extent = max(float(np.linalg.norm(np.ptp(own, axis=0))) for own in (one, two))
    speed = min(float(np.median(np.linalg.norm(own, axis=1))) for own in (moved1, moved2))
    difference = float(np.median(np.linalg.norm(moved1[i] - moved2[j], axis=1)))
    if difference > LARGEST_RELIEF * speed or float(np.median(apart[i, j])) > extent:
        return False
    if not len(moment.static):
        return True
    way = np.linalg.norm(one[i][:, None] - moment.static, axis=2)
    way += np.linalg.norm(two[j][:, None] - moment.static, axis=2)
    between = (way <= DETOUR * apart[i, j][:, None]).any(axis=1)
    return bool(2 * between.sum() <= len(between))
