"""What matches with local affines say about each other: who is confirmed, what they predict."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.views import Indices
from mssegment.neighbours import nearest
from mssegment.records import Floats

NEIGHBOURS = 10
TOLERANCE = 3.0
TOLERANCE_PER_DISTANCE = 0.15


def supported(first: Floats, second: Floats, affines: Floats, least: int) -> npt.NDArray[np.bool_]:
    """Which matches [n] ``least`` of their 10 nearest in view 1 confirm by their local affines.

    A neighbour confirms where its affine predicts this match's position in view 2 within the
    greater of 3 pixels and 0.15 of the distance between the two in view 1.
    """
    count = min(NEIGHBOURS, len(first) - 1)
    if count < least:
        return np.zeros(len(first), bool)
    distance, index = nearest(first, first, count + 1)
    distance, index = distance[:, 1:], index[:, 1:]
    allowed = np.maximum(TOLERANCE, TOLERANCE_PER_DISTANCE * distance)
    x, y = first[:, :1], first[:, 1:]
    miss = np.zeros(index.shape)
    for row, at_origin in enumerate(predict(np.zeros_like(first), first, second, affines).T):
        along_x, along_y = affines[:, row, 0], affines[:, row, 1]
        predicted = along_x.take(index) * x + along_y.take(index) * y + at_origin.take(index)
        miss += (predicted - second[:, row, None]) ** 2
    return np.asarray((miss < allowed**2).sum(axis=1) >= least)


def predict(points: Floats, first: Floats, second: Floats, affines: Floats) -> Floats:
    """Where matches (``first`` -> ``second``, ``affines``) send ``points`` [..., 2]."""
    moved = np.einsum("...ij,...j->...i", affines, points - first)
    return np.asarray(second + moved)


def nearest_matches(
    points: Floats, first: Floats, count: int, radius: float
) -> tuple[Indices, Indices]:
    """Each point with each of its ``count`` nearest matches within ``radius``: index pairs."""
    near = min(count, len(first))
    _, index = nearest(first, points, near, radius)
    rows, slots = np.nonzero(index < len(first))
    return rows, index[rows, slots]


def distance_to(points: Floats, first: Floats) -> Floats:
    """From each point to the nearest match in view 1, pixels."""
    gap, _ = nearest(first, points)
    return gap[:, 0]
