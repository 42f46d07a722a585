"""Which tracks lie together: the neighbourhoods that elemental subsets come from.

The tracks of one body lie together, so a subset of neighbours is far likelier to be of one body
than one drawn anywhere (NAPSAC: Myatt, Torr, Nasuto, Bishop and Craddock, BMVC 2002).
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest_others
from mssegment.records import Floats, Integers

PATH_WEIGHT = 10.0
"""Weight of the shape of a path against its place, when neighbours are sought over many frames."""


def some_of(tracks: Flags, most: int, rng: np.random.Generator) -> Flags:
    """The ``tracks`` [P], or so many of them, drawn at random, where they are more."""
    if tracks.sum() <= most:
        return tracks
    drawn = np.zeros(len(tracks), dtype=bool)
    drawn[rng.choice(np.flatnonzero(tracks), most, replace=False)] = True
    return drawn


def neighbour_space(points: Floats) -> Floats:
    """Where near means "may be the same body": tracks [P, F, 2] as vectors [P, d], pixels.

    Two views: the match (x, y, x', y') itself. More: the mean position, and the path about it.
    """
    if points.shape[1] == 2:
        return np.asarray(points.reshape(len(points), 4))
    place = points.mean(axis=1)
    path = (points - place[:, None]) * np.sqrt(PATH_WEIGHT / points.shape[1])
    return np.concatenate([place, path.reshape(len(points), -1)], axis=1)


def nearest_neighbours(points: Floats, count: int) -> Integers:
    """The ``count`` nearest other tracks of each track [P, F, 2], nearest first, [P, count]."""
    return nearest_others(neighbour_space(points), count)
