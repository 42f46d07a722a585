"""Neighbourhoods of tracks, from which elemental subsets are drawn.

The tracks of one motion are close to each other, so a subset of neighbours is far more likely to be
of one motion than a subset drawn uniformly.

References
----------
Myatt, Torr, Nasuto, Bishop and Craddock, NAPSAC: high noise, high dimensional robust estimation,
BMVC 2002.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest_others
from mssegment.records import Floats, Integers

PATH_WEIGHT = 10.0
"""Weight of the shape of a path relative to its mean position in distances over many frames."""


def random_subset(tracks: Flags, count: int, rng: np.random.Generator) -> Flags:
    """The ``tracks`` [P], or ``count`` of them, drawn at random, if there are more."""
    if tracks.sum() <= count:
        return tracks
    drawn = np.zeros(len(tracks), dtype=bool)
    drawn[rng.choice(np.flatnonzero(tracks), count, replace=False)] = True
    return drawn


def neighbour_space(points: Floats) -> Floats:
    """Vectors [P, d] of tracks [P, F, 2] whose distances, in pixels, define neighbours.

    For two views, the match (x, y, x', y'). For more, the mean position and the path relative to
    it.
    """
    if points.shape[1] == 2:
        return np.asarray(points.reshape(len(points), -1))
    position = points.mean(axis=1)
    path = (points - position[:, None]) * np.sqrt(PATH_WEIGHT / points.shape[1])
    return np.concatenate([position, path.reshape(len(points), -1)], axis=1)


def nearest_neighbours(points: Floats, count: int) -> Integers:
    """The ``count`` nearest other tracks of each track [P, F, 2], nearest first, [P, count]."""
    return nearest_others(neighbour_space(points), count)
