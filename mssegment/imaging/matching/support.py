"""How matches with local affine maps confirm each other, and where they predict new matches."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.resampling import Indices
from mssegment.neighbours import nearest
from mssegment.records import Floats

SUPPORTING_MATCHES = 10
"""Nearest matches that may support a match."""
MIN_TRANSFER_TOLERANCE = 3.0
"""Pixels by which a supporting match may mispredict a match close to it."""
TRANSFER_TOLERANCE_SLOPE = 0.15
"""Pixels of tolerance per pixel between the two matches: a local affine map extrapolates badly."""


def has_support(
    first: Floats, second: Floats, affines: Floats, min_support: int
) -> npt.NDArray[np.bool_]:
    """Tell which matches are confirmed by enough of their neighbours.

    A neighbour, one of the 10 nearest matches in view 1, supports a match if its local affine map
    predicts the position in view 2 within the greater of 3 pixels and 0.15 times the distance
    between the two in view 1.

    Parameters
    ----------
    first, second : float array [n, 2]
        Positions in views 1 and 2, pixels.
    affines : float array [n, 2, 2]
        Linear part of each match's local affine map from view 1 to view 2.
    min_support : int
        Supporting neighbours that a match needs.

    Returns
    -------
    bool array [n]
    """
    if len(first) - 1 < min_support:
        return np.zeros(len(first), bool)
    return np.asarray(_supported(first, second, affines)[1].sum(axis=1) >= min_support)


def supporting_pairs(first: Floats, second: Floats, affines: Floats) -> tuple[Indices, Indices]:
    """Pairs of matches, both among the nearest of the other, that support each other.

    Parameters are those of ``has_support``; the indices of both are [k], in either order.
    """
    if len(first) < 2:
        return np.zeros(0, np.intp), np.zeros(0, np.intp)
    index, supported = _supported(first, second, affines)
    one, slot = np.nonzero(supported)
    other = index[one, slot]
    forth, back = one * len(first) + other, np.sort(other * len(first) + one)
    both = back.take(np.searchsorted(back, forth), mode="clip") == forth
    return one[both], other[both]


def _supported(
    first: Floats, second: Floats, affines: Floats
) -> tuple[Indices, npt.NDArray[np.bool_]]:
    """The nearest matches [n, k] of each, and whether each of them supports it."""
    count = min(SUPPORTING_MATCHES, len(first) - 1)
    distance, index = nearest(first, first, count + 1)
    distance, index = distance[:, 1:], index[:, 1:]
    tolerance = np.maximum(MIN_TRANSFER_TOLERANCE, TRANSFER_TOLERANCE_SLOPE * distance)
    x, y = first[:, :1], first[:, 1:]
    squared_error = np.zeros(index.shape)
    for row, at_origin in enumerate(predict(np.zeros_like(first), first, second, affines).T):
        along_x, along_y = affines[:, row, 0], affines[:, row, 1]
        predicted = along_x.take(index) * x + along_y.take(index) * y + at_origin.take(index)
        squared_error += (predicted - second[:, row, None]) ** 2
    return index, np.asarray(squared_error < tolerance**2)


def predict(points: Floats, first: Floats, second: Floats, affines: Floats) -> Floats:
    """Map ``points`` [..., 2] of view 1 to view 2 by the local affine maps of matches.

    ``first`` and ``second`` [..., 2] are the positions of the matches in pixels, ``affines``
    [..., 2, 2] the linear parts of their maps.
    """
    moved = np.einsum("...ij,...j->...i", affines, points - first)
    return np.asarray(second + moved)


def nearest_matches(
    points: Floats, first: Floats, count: int, radius: float
) -> tuple[Indices, Indices]:
    """Pairs of a point and one of its ``count`` nearest matches within ``radius`` pixels.

    ``points`` [n, 2] and the matches ``first`` [m, 2] are positions in view 1. Returns the indices
    of the points and those of the matches, both [k].
    """
    near = min(count, len(first))
    _, index = nearest(first, points, near, radius)
    rows, slots = np.nonzero(index < len(first))
    return rows, index[rows, slots]


def distance_to_matches(points: Floats, first: Floats) -> Floats:
    """Distance [n] in pixels from ``points`` [n, 2] to the nearest of the matches ``first``."""
    distance, _ = nearest(first, points)
    return distance[:, 0]
