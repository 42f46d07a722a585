"""Objects before a static camera that were found in parts, and tracks that are no object.

The parts of a large object are tracked one after the other while it enters the picture or passes
behind a post, so that their tracks have few frames in common, and parts at different distances from
the camera move differently. Two groups are parts of one object if they move alike, and are
neighbours in the frame that moves along with them (``body_frame``).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers, by_size
from mssegment.sequences.body_frame import LEAST_TRACKS, connections
from mssegment.special import median, nan_median

LARGEST_RELIEF = 1 / 3
"""Largest difference of the velocities of neighbours in an object, relative to their speed. The
image of a point moves the faster the nearer it is, so this is the depth of an object relative to
its distance."""
LEAST_OBJECT = 6
"""Tracks of an object, at least: twice as many as determine an affine motion."""
COMPARED_FRAMES = 8
"""Moments at which two groups are compared."""
LONGEST_STEP = 8
"""Frames over which velocities are measured, at most."""
TRACKED_WINDOW = 15.0
"""Pixels; the side of the window of the tracker (``imaging.matching.klt``)."""
LEAST_FOR_AFFINE = 9
"""Tracks from which on an affine map is fitted to their velocities: three times its minimum."""


def split_apart(points: Floats, labels: Integers, shown: Flags) -> Integers:
    """Split groups into those that lie apart on what moves along with them.

    Two objects may move alike, one here and one there.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups, ``BACKGROUND`` for static tracks.
    shown : ndarray [P, F] of bool
        The frames in which each track moves with its group (``membership.members``).

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k, the largest group first; ``OUTLIER`` for what lies apart and is too small
        for an object.
    """
    static, found, count = points[labels == BACKGROUND], labels.copy(), 0
    for label in range(1, int(labels.max(initial=0)) + 1):
        rows = np.flatnonzero(labels == label)
        links = connections(points[rows], shown[rows], static)
        size = (len(rows), len(rows))
        graph = coo_matrix((np.ones(len(links), dtype=np.int8), links.T), shape=size)
        _, component = connected_components(graph, directed=False)
        large = np.bincount(component)[component] >= LEAST_OBJECT
        found[rows] = np.where(large, component + count + 1, OUTLIER)
        count += len(rows)
    return by_size(found)


def join_parts(points: Floats, labels: Integers, shown: Flags) -> Integers:
    """Give the parts of each object one label: they move alike, and are neighbours.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups, ``BACKGROUND`` for static tracks.
    shown : ndarray [P, F] of bool
        The frames in which each track moves with its group (``membership.members``).

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k, the largest group first.
    """
    count = int(labels.max(initial=0))
    if not count:
        return labels
    judged = (labels > 0) | (labels == BACKGROUND)
    rows = [np.flatnonzero(labels == label) for label in range(count + 1)]
    pairs = [
        (first - 1, second - 1)
        for first in range(1, count + 1)
        for second in range(first + 1, count + 1)
        if _are_parts(
            points,
            shown,
            judged & (labels != first) & (labels != second),
            rows[first],
            rows[second],
        )
    ]
    links = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(links), dtype=np.int8), links.T), shape=(count, count))
    _, joined = connected_components(graph, directed=False)
    return by_size(np.where(labels > 0, joined[np.maximum(labels, 1) - 1] + 1, labels))


def _are_parts(
    points: Floats, shown: Flags, others: Flags, first: Integers, second: Integers
) -> bool:
    """Whether some tracks of two groups are neighbours on an object, and both move alike."""
    own = [np.where(shown[rows][..., None], points[rows], np.nan) for rows in (first, second)]
    if not move_alike(*own):
        return False
    rows = np.concatenate([first, second])
    groups = np.repeat([1, 2], [len(first), len(second)])
    joined = np.unique(connections(points[rows], shown[rows], points[others], groups))
    return bool(min((joined < len(first)).sum(), (joined >= len(first)).sum()) >= LEAST_TRACKS)


def coherent(points: Floats, labels: Integers, shown: Flags) -> Integers:
    """The labels without groups that do not move as one: these are outliers.

    What passes drags along the tracks at its border, and tracks slip along edges. They move one
    after the other, while the nearest neighbours in an object move alike.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups.
    shown : ndarray [P, F] of bool
        The frames in which each track moves with its group.

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k of the groups that are left, the largest first.
    """
    found = labels.copy()
    for label in range(1, int(labels.max(initial=0)) + 1):
        own = labels == label
        if _incoherence(points[own], shown[own]) > LARGEST_RELIEF:
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
    for frame in _compared(frames):
        here = points[both[:, frame]]
        places, moved = here[:, frame], here[:, frame + step] - here[:, frame]
        speed += median(np.linalg.norm(moved, axis=1))
        if len(places) >= LEAST_FOR_AFFINE:
            terms = np.column_stack([places - places.mean(axis=0), np.ones(len(places))])
            moved = moved - terms @ np.linalg.lstsq(terms, moved, rcond=None)[0]
        _, near = nearest(places, places, 2)
        difference += median(np.linalg.norm(moved - moved[near[:, 1]], axis=1))
    return difference / speed if speed else 0.0


def _compared(frames: Integers) -> Integers:
    """Some of the frames, evenly spread."""
    count = min(len(frames), COMPARED_FRAMES)
    return np.asarray(frames[np.linspace(0, len(frames) - 1, count).round().astype(int)])


def _step(frames: int) -> int:
    """The number of frames over which velocities are measured."""
    return max(1, min(frames // 4, LONGEST_STEP))


def without_borders(points: Floats, labels: Integers, shown: Flags) -> Integers:
    """The labels without groups that are only the border of a faster one: these are outliers.

    Along a border a tracker sees both sides in its window, and follows a mean of both motions.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for groups, before a static camera.
    shown : ndarray [P, F] of bool
        The frames in which each track moves with its group.

    Returns
    -------
    ndarray [P] of int64
        The labels 1..k of the groups that are left, the largest first.
    """
    seen = np.where(shown[..., None], points, np.nan)
    rows = [np.flatnonzero(labels == label) for label in range(int(labels.max(initial=0)) + 1)]
    found = labels.copy()
    for own in rows[1:]:
        larger = [other for other in rows[1:] if len(other) > len(own)]
        if any(_is_border(seen[own], seen[other]) for other in larger):
            found[own] = OUTLIER
    return by_size(found)


def _is_border(own: Floats, other: Floats) -> bool:
    """Whether tracks [n, F, 2] follow a mean of rest and of the motion of others near them."""
    step = _step(own.shape[1])
    known = [
        np.isfinite(one[:, step:, 0] - one[:, :-step, 0]).sum(axis=0) >= LEAST_TRACKS
        for one in (own, other)
    ]
    frames = np.flatnonzero(known[0] & known[1])
    if not len(frames):
        return False
    frames = _compared(frames)
    slow, fast = (
        nan_median(one[:, frames + step] - one[:, frames], axis=0) for one in (own, other)
    )
    share = float((slow * fast).sum() / max((fast * fast).sum(), 1e-12))
    left = float(np.linalg.norm(slow - share * fast, axis=1).sum())
    if not 0 < share < 1 or left > LARGEST_RELIEF * float(np.linalg.norm(fast, axis=1).sum()):
        return False
    apart = np.concatenate(
        [
            np.min(
                np.linalg.norm(_visible(own[:, f])[:, None] - _visible(other[:, f]), axis=2), axis=1
            )
            for f in frames
        ]
    )
    return bool(np.median(apart) <= TRACKED_WINDOW)


def _visible(points: Floats) -> Floats:
    return points[np.isfinite(points[:, 0])]


def move_alike(first: Floats, second: Floats) -> bool:
    """Whether two groups of tracks [n, F, 2] and [m, F, 2] move alike while both are visible."""
    steps = [np.diff(one, axis=1) for one in (first, second)]
    known = [np.isfinite(one[..., 0]).sum(axis=0) >= LEAST_TRACKS for one in steps]
    frames = np.flatnonzero(known[0] & known[1])
    if not len(frames):
        return False
    velocity = np.stack([nan_median(one[:, frames], axis=0) for one in steps])
    # over some frames, since a step is hardly more than the noise where motion is slow
    starts = np.arange(0, len(frames), LONGEST_STEP)
    moved = np.add.reduceat(velocity, starts, axis=1)
    speed = np.linalg.norm(moved, axis=2).sum(axis=1).min()
    difference = np.linalg.norm(moved[1] - moved[0], axis=1).sum()
    return bool(difference <= LARGEST_RELIEF * speed)
