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
    predicted = predict(first[:, None], first[index], second[index], affines[index])
    miss = np.linalg.norm(predicted - second[:, None], axis=2)
    allowed = np.maximum(TOLERANCE, TOLERANCE_PER_DISTANCE * distance)
    return np.asarray((miss < allowed).sum(axis=1) >= least)


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
