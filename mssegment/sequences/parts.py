"""Objects before a static camera that were found in parts, and tracks that are no object.

The parts of a large object are tracked one after the other while it enters the picture, so that
their tracks have few frames in common, and parts at different distances from the camera move
differently. Two groups are parts of one object if nothing static is seen between them, and they
move alike where they meet.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers, Record, by_size

LARGEST_RELIEF = 1 / 3
"""Largest difference of the velocities of neighbours in an object, relative to their speed. The
image of a point moves the faster the nearer it is, so this is the depth of an object relative to
its distance."""
NEIGHBOURS = 6
"""Nearest neighbours of a track, as many as points of a plane have on average."""
MOMENTS_OF_NEIGHBOURS = 16
"""Moments at which neighbours are looked for."""
LEAST_OBJECT = 6
"""Tracks of an object, at least: twice as many as determine an affine motion."""
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


def split_apart(points: Floats, labels: Integers) -> Integers:
    """Split groups into those that lie apart, with other tracks between them.

    Two objects may move alike, one here and one there. Two tracks of a group are connected if at
    some moment one is among the nearest neighbours of the other, of all tracks.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups.

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k, the largest group first; ``OUTLIER`` for what lies apart and is too small
        for an object.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    edges = [np.zeros((0, 2), dtype=np.int64)]
    shown = visible[labels > 0].any(axis=0)
    frames = np.flatnonzero(shown)
    if not len(frames):
        return labels
    moments = min(len(frames), MOMENTS_OF_NEIGHBOURS)
    for frame in frames[np.linspace(0, len(frames) - 1, moments).round().astype(int)]:
        here = np.flatnonzero(visible[:, frame])
        own = np.flatnonzero(labels[here] > 0)
        count = min(NEIGHBOURS + 1, len(here))
        _, near = nearest(points[here, frame], points[here[own], frame], count)
        pairs = np.stack([np.repeat(here[own], count), here[near.ravel()]], axis=1)
        edges.append(pairs[labels[pairs[:, 0]] == labels[pairs[:, 1]]])
    links = np.concatenate(edges)
    size = (len(labels), len(labels))
    graph = coo_matrix((np.ones(len(links), dtype=np.int8), links.T), shape=size)
    _, component = connected_components(graph, directed=False)
    found = np.where(labels > 0, component + 1, labels)
    small = np.bincount(np.maximum(found, 0))[np.maximum(found, 0)] < LEAST_OBJECT
    return by_size(np.where((labels > 0) & small, OUTLIER, found))


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
            moved = moved - terms @ np.linalg.lstsq(terms, moved, rcond=None)[0]
        _, near = nearest(places, places, 2)
        difference += float(np.median(np.linalg.norm(moved - moved[near[:, 1]], axis=1)))
    return difference / speed if speed else 0.0


def _step(frames: int) -> int:
    """The number of frames over which velocities are measured."""
    return max(1, min(frames // 4, LONGEST_STEP))


def move_alike(first: Floats, second: Floats) -> bool:
    """Whether two groups of tracks [n, F, 2] and [m, F, 2] move alike while both are visible."""
    step = _step(first.shape[1])
    moved = [one[:, step:] - one[:, :-step] for one in (first, second)]
    shown = [np.isfinite(one[..., 0]).sum(axis=0) >= LEAST_TRACKS for one in moved]
    frames = np.flatnonzero(shown[0] & shown[1])
    if not len(frames):
        return False
    velocity = np.stack([np.nanmedian(one[:, frames], axis=0) for one in moved])
    speed = np.linalg.norm(velocity, axis=2).min(axis=0).sum()
    difference = np.linalg.norm(velocity[1] - velocity[0], axis=1).sum()
    return bool(difference <= LARGEST_RELIEF * speed)


def _are_parts(points: Floats, visible: Flags, labels: Integers, first: int, second: int) -> bool:
    """Whether two groups are parts of one object, at most of the moments compared."""
    step = _step(points.shape[1])
    both = visible[:, :-step] & visible[:, step:]
    shown = np.stack([both[labels == one].sum(axis=0) for one in (first, second)]).min(axis=0)
    frames = np.flatnonzero(shown >= LEAST_TRACKS)
    if not len(frames):
        return False
    chosen = frames[np.linspace(0, len(frames) - 1, COMPARED_FRAMES).round().astype(int)]
    chosen = np.unique(chosen).tolist()
    moments = [_Moment.of(points, both[:, f], f, step, labels, first, second) for f in chosen]
    alike = [moment for moment in moments if moment.is_alike]
    if 2 * len(alike) <= len(moments):
        return False
    apart = [moment for moment in alike if moment.is_separated]
    return 2 * len(apart) <= len(alike)


class _Moment(Record, frozen=True):
    """Two groups at one moment: whether they move alike, and something static is between them."""

    is_alike: bool
    is_separated: bool

    @classmethod
    def of(
        cls,
        points: Floats,
        shown: Flags,
        frame: int,
        step: int,
        labels: Integers,
        first: int,
        second: int,
    ) -> _Moment:
        """From the tracks that are ``shown`` [P] in the frame and ``step`` frames later."""
        a, b = np.flatnonzero(shown & (labels == first)), np.flatnonzero(shown & (labels == second))
        one, two = points[a, frame], points[b, frame]
        moved1, moved2 = points[a, frame + step] - one, points[b, frame + step] - two
        apart = np.linalg.norm(one[:, None] - two, axis=2)
        count = max(LEAST_TRACKS, min(len(one), len(two)) // BORDER_SHARE)
        i, j = np.unravel_index(np.argsort(apart, axis=None, kind="stable")[:count], apart.shape)
        extent = max(float(np.linalg.norm(np.ptp(own, axis=0))) for own in (one, two))
        speed = min(float(np.median(np.linalg.norm(own, axis=1))) for own in (moved1, moved2))
        difference = float(np.median(np.linalg.norm(moved1[i] - moved2[j], axis=1)))
        distance = float(np.median(apart[i, j]))
        static = np.flatnonzero(shown & (labels == BACKGROUND))
        way = np.linalg.norm(one[i][:, None] - points[static, frame], axis=2)
        way += np.linalg.norm(two[j][:, None] - points[static, frame], axis=2)
        inside = way <= DETOUR * apart[i, j][:, None]
        return cls(
            difference <= LARGEST_RELIEF * speed and distance <= extent,
            bool(2 * inside.any(axis=1).sum() > len(inside)),
        )
