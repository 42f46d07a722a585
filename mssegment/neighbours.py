"""Nearest neighbours, without loading ``scipy.spatial``.

Importing that takes longer than finding all neighbours of the tracks of two pictures; OpenCV,
which has a tree of its own, is there anyway.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers

EXACT_TREE: dict[str, bool | int | float | str] = {"algorithm": 4}
"""FLANN's single k-d tree, whose answers are exact, but in single precision."""
MORE = 4
"""So many more are asked for, of which double precision chooses."""
QUERIES = 4096
"""Queries at a time."""
FEW = 4
"""Of points of so few coordinates each is gathered on its own, which is faster."""


def nearest(
    points: npt.ArrayLike, queries: npt.ArrayLike, count: int = 1, within: float = np.inf
) -> tuple[Floats, Integers]:
    """Distances and indices [m, count] of the ``count`` nearest ``points`` [n, d], nearest first.

    ``queries`` [m, d]; both are finite. Of equally near ones the first comes first. Where fewer are
    closer than ``within``, the distance is infinite and the index n.
    """
    space, asked = (np.asarray(p, dtype=np.float64) for p in (points, queries))
    n, m = len(space), len(asked)
    distance, index = np.full((m, count), np.inf), np.full((m, count), n, dtype=np.int64)
    if not n or not m:
        return distance, index
    middle = space.mean(axis=0)
    tree = cv2.flann.Index((space - middle).astype(np.float32), EXACT_TREE)
    for start in range(0, m, QUERIES):
        rows = slice(start, start + QUERIES)
        some = asked[rows]
        found, _ = tree.knnSearch(
            (some - middle).astype(np.float32), min(count + MORE, n), params={}
        )
        away = _distances(space, found, some)
        unsure = np.flatnonzero(~(np.diff(away, axis=1) > 0).all(axis=1))
        order = np.lexsort((found[unsure], away[unsure]))
        away[unsure] = np.take_along_axis(away[unsure], order, axis=1)
        found[unsure] = np.take_along_axis(found[unsure], order, axis=1)
        filled = min(count, n)
        distance[rows, :filled], index[rows, :filled] = away[:, :filled], found[:, :filled]
    far = ~(distance < within)
    distance[far], index[far] = np.inf, n
    return distance, index


def _distances(points: Floats, found: Integers, queries: Floats) -> Floats:
    """From each of ``queries`` [m, d] to the ``points`` [n, d] that ``found`` [m, k] names."""
    if points.shape[1] > FEW:
        return np.asarray(np.sqrt(np.sum((points[found] - queries[:, None]) ** 2, axis=2)))
    squares = sum(
        (points[:, axis].take(found) - queries[:, axis, None]) ** 2
        for axis in range(points.shape[1])
    )
    return np.asarray(np.sqrt(squares))


def nearest_others(points: npt.ArrayLike, count: int) -> Integers:
    """The ``count`` nearest other ``points`` [n, d] of each, nearest first; fewer of few points.

    Of points in one place another one may come first; a point is never its own neighbour.
    """
    space = np.asarray(points, dtype=np.float64)
    found = nearest(space, space, min(count, len(space) - 1) + 1)[1]
    return without(found, np.arange(len(space)))


def without(found: Integers, own: Integers) -> Integers:
    """The indices ``found`` [m, k + 1] without ``own`` [m], or without the last, [m, k]."""
    itself = found == own[:, None]
    itself[~itself.any(axis=1), -1] = True
    return np.asarray(found[~itself].reshape(len(found), -1), dtype=np.int64)


def pairs_within(points: npt.ArrayLike, radius: float) -> Integers:
    """The pairs [k, 2] of ``points`` [n, 2], all finite, that are at most ``radius`` apart.

    Every pair once, in no particular order. A grid of cells as wide as the radius: a point is
    compared with those of its cell that come later and of half of the cells around it.
    """
    where = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    wide = radius if radius > 0 else 1.0
    cell = np.floor((where - where.min(axis=0, initial=np.inf)) / wide).astype(np.int64) + 1
    row = int(cell[:, 1].max(initial=0)) + 2
    key = cell[:, 0] * row + cell[:, 1]
    order = np.argsort(key, kind="stable")
    key, where, place = key[order], where[order], np.arange(len(order))
    found = []
    for across in (0, 1, row - 1, row, row + 1):
        first = np.searchsorted(key, key + across, side="left") if across else place + 1
        last = np.searchsorted(key, key + across, side="right")
        count = np.maximum(last - first, 0)
        one = np.repeat(place, count)
        other = np.arange(count.sum()) + np.repeat(first - np.cumsum(count) + count, count)
        near = np.sum((where[one] - where[other]) ** 2, axis=1) <= radius**2
        found.append(np.stack([order[one[near]], order[other[near]]], axis=1))
    return np.concatenate(found)
