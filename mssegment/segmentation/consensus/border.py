"""How well two groups of tracks agree at their border."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Integers

BORDER_NEIGHBOURS, BORDER_FRACTION = 8, 4
"""Neighbours of a track across the border; the border is 1 / BORDER_FRACTION of the smaller
group."""
MIN_BORDER_SIZE = 5
"""Smallest number of tracks at a border."""


def border_contrast(
    agreement: Floats, distances: Floats, first: Integers, second: Integers
) -> float:
    """How well two groups agree at their border, relative to the agreement within a group.

    The agreement of tracks with neighbours across the border is compared with that of tracks of one
    group at the same distance, for the quarter of the smaller group that is nearest to the other.

    Parameters
    ----------
    agreement : ndarray [P, P]
        Agreement of pairs of tracks.
    distances : ndarray [P, P]
        Distances of their positions, in pixels.
    first, second : ndarray of int
        The tracks of the two groups.

    Returns
    -------
    float
        About 1 inside one object, near 0 between two.
    """
    small, large = (first, second) if len(first) <= len(second) else (second, first)
    across = distances[np.ix_(small, large)]
    count = min(BORDER_NEIGHBOURS, len(large))
    neighbours = np.argpartition(across, count - 1, axis=1)[:, :count]
    distance = np.take_along_axis(across, neighbours, axis=1).mean(axis=1)
    border = distance.argsort(kind="stable")[: max(MIN_BORDER_SIZE, len(small) // BORDER_FRACTION)]
    between = agreement[small[border][:, None], large[neighbours[border]]].mean()
    within = np.abs(distances[np.ix_(small[border], small)] - distance[border, None])
    within[np.arange(len(border)), border] = np.inf
    count = min(BORDER_NEIGHBOURS, len(small) - 1)
    neighbours = np.argpartition(within, count - 1, axis=1)[:, :count]
    inside = agreement[small[border][:, None], small[neighbours]].mean()
    return float((between + 1e-3) / (inside + 1e-3))
