"""Nearest neighbours: by OpenCV's k-d tree, in many coordinates by all distances.

Not by ``scipy.spatial``: loading it takes 0.24 s, half of the segmentation of two pictures, and
OpenCV is loaded anyway.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers

EXACT_TREE: dict[str, bool | int | float | str] = {"algorithm": 4}
"""FLANN's single k-d tree, whose answers are exact, but in single precision."""
EXTRA_CANDIDATES = 4
"""Further neighbours that are retrieved, of which double precision selects the nearest."""
MANY_COORDINATES = 12
"""From so many coordinates on a k-d tree visits most of the points, and all distances are
faster..."""
MANY_POINTS = 5000
"""... but not among more points than this."""
FEW_COORDINATES = 4
"""Up to this many coordinates, computing distances one coordinate at a time is faster."""


def nearest(
    points: npt.ArrayLike, queries: npt.ArrayLike, count: int = 1, within: float = np.inf
) -> tuple[Floats, Integers]:
    """The nearest points of each query, as ``scipy.spatial.cKDTree.query``.

    Parameters
    ----------
    points
        Where to look, finite [n, d].
    queries
        Finite [m, d].
    count
        The number of neighbours.
    within
        Only points closer than this are found.

    Returns
    -------
    distance, index
        [m, count], nearest first and, at equal distances, the smaller index first. Where there are
        fewer points, the distance is infinite and the index n.

    Examples
    --------
    >>> distance, index = nearest([[0.0, 0.0], [3.0, 4.0]], [[0.0, 0.0]], count=2)
    >>> distance.tolist(), index.tolist()
    ([[0.0, 5.0]], [[0, 1]])
    """
    space, targets = (np.asarray(p, dtype=np.float64) for p in (points, queries))
    n, m = len(space), len(targets)
    distance, index = np.full((m, count), np.inf), np.full((m, count), n, dtype=np.int64)
    if not n or not m:
        return distance, index
    middle = space.mean(axis=0)
    many = space.shape[1] >= MANY_COORDINATES and n <= MANY_POINTS
    kind = _AllDistances if many else _Tree
    candidates = kind(space - middle)
    for start in range(0, m, kind.queries):
        rows = slice(start, start + kind.queries)
        block = targets[rows]
        found = candidates(block - middle, min(count + EXTRA_CANDIDATES, n))
        exact = _distances(space, found, block)
        unsorted = np.flatnonzero(~(np.diff(exact, axis=1) > 0).all(axis=1))
        order = np.lexsort((found[unsorted], exact[unsorted]))
        exact[unsorted] = np.take_along_axis(exact[unsorted], order, axis=1)
        found[unsorted] = np.take_along_axis(found[unsorted], order, axis=1)
        filled = min(count, n)
        distance[rows, :filled], index[rows, :filled] = exact[:, :filled], found[:, :filled]
    far = ~(distance < within)
    distance[far], index[far] = np.inf, n
    return distance, index


class _Tree:
    """Candidates in few coordinates, from FLANN's k-d tree in single precision."""

    queries = 4096
    """Queries per call, to bound the memory."""

    def __init__(self, points: Floats) -> None:
        self._tree = cv2.flann.Index(points.astype(np.float32), EXACT_TREE)

    def __call__(self, queries: Floats, count: int) -> Integers:
        """Indices [m, count] of the nearest points of the ``queries`` [m, d], nearest first."""
        found, _ = self._tree.knnSearch(queries.astype(np.float32), count, params={})
        return np.asarray(found)


class _AllDistances:
    """Candidates in many coordinates, from inner products with all points."""

    queries = 256
    """Queries per call, to bound the memory."""

    def __init__(self, points: Floats) -> None:
        self._points, self._squares = points, np.einsum("nd,nd->n", points, points)

    def __call__(self, queries: Floats, count: int) -> Integers:
        """Indices [m, count] of the nearest points of the ``queries`` [m, d], in no order."""
        squared = self._squares - 2 * queries @ self._points.T
        if count == squared.shape[1]:
            return np.tile(np.arange(count), (len(squared), 1))
        return np.asarray(np.argpartition(squared, count - 1, axis=1)[:, :count])


def _distances(points: Floats, found: Integers, queries: Floats) -> Floats:
    """The distances [m, k] from ``queries`` [m, d] to the ``points`` with the indices ``found``."""
    if points.shape[1] > FEW_COORDINATES:
        gap = points[found] - queries[:, None]
        return np.asarray(np.sqrt(np.einsum("mkd,mkd->mk", gap, gap)))
    squares = sum(
        (points[:, axis].take(found) - queries[:, axis, None]) ** 2
        for axis in range(points.shape[1])
    )
    return np.asarray(np.sqrt(squares))


def nearest_others(points: npt.ArrayLike, count: int) -> Integers:
    """The nearest other points of each point.

    Parameters
    ----------
    points
        Finite [n, d].
    count
        The number of neighbours; at most n - 1 are returned.

    Returns
    -------
    array
        Indices [n, count], nearest first. A point is not its own neighbour; of coinciding points
        any may come first.

    Examples
    --------
    >>> nearest_others([[0.0], [1.0], [3.0]], 1).tolist()
    [[1], [0], [1]]
    """
    space = np.asarray(points, dtype=np.float64)
    found = nearest(space, space, min(count, len(space) - 1) + 1)[1]
    return without(found, np.arange(len(space)))


def without(found: Integers, own: Integers) -> Integers:
    """Remove one index from each row.

    Parameters
    ----------
    found
        Indices [m, k + 1].
    own
        The index to remove from each row [m]; where it is absent, the last one is removed.

    Returns
    -------
    array
        The other indices, in their order [m, k].

    Examples
    --------
    >>> import numpy as np
    >>> without(np.array([[4, 7, 8], [1, 2, 3]]), np.array([7, 9])).tolist()
    [[4, 8], [1, 2]]
    """
    itself = found == own[:, None]
    itself[~itself.any(axis=1), -1] = True
    return np.asarray(found[~itself].reshape(len(found), -1), dtype=np.int64)


def pairs_within(points: npt.ArrayLike, radius: float) -> Integers:
    """All pairs of points within a radius, as ``scipy.spatial.cKDTree.query_pairs``.

    By a grid of cells as wide as the radius: a point is compared with the later ones of its cell
    and with those of half of the cells around it.

    Parameters
    ----------
    points
        Finite [n, 2].
    radius
        The largest distance of a pair.

    Returns
    -------
    array
        Indices [k, 2], every pair once, in no particular order.

    Examples
    --------
    >>> pairs_within([[0.0, 0.0], [9.0, 9.0], [1.0, 0.0]], radius=2.0).tolist()
    [[0, 2]]
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
