"""Labels where motions touch, and where they do not.

Coded by its neighbours, the label of a track costs little inside a motion: two bodies that are
apart in the picture, and a body with a gap, need few nats. Coded by frequency, every track pays,
however the motions lie. Which is right depends on whether a cut could be one through an object.
Such a cut has a border as long as that of two squares side by side, and its two sides differ by
what varies smoothly within an object, parallax. So two motions share one code by frequency as far
as they touch, or as far as their misfit is parallax; otherwise the neighbours say which one it is.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.labelling import frequency_cost, neighbour_cost

BORDER = 1.25
"""Tracks of a square that have one of another square beside it among their eight nearest, over the
root of the number of tracks in each (random points; a test repeats it)."""


def contacts(labels: Integers, neighbours: Integers, motions: int) -> Floats:
    """How far motions touch: 0 for two that are apart, 1 for a cut through an object.

    Parameters
    ----------
    labels : ndarray [P] of int
        Labels 1..m, 0 for outliers.
    neighbours : ndarray [P, 8] of int
        Nearest other tracks.
    motions : int
        Their number m.

    Returns
    -------
    ndarray [m, m]
        Symmetric; 1 on the diagonal.

    Examples
    --------
    >>> import numpy as np
    >>> near = np.array([[1, 2], [0, 2], [1, 3], [2, 4], [5, 3], [4, 3]])
    >>> contacts(np.array([1, 1, 1, 2, 2, 2]), near, 2).round(2).tolist()
    [[1.0, 0.46], [0.46, 1.0]]
    """
    count = np.bincount(labels, minlength=motions + 1)[1:]
    of_neighbours = labels[neighbours]
    touching = np.zeros((motions, motions))
    for b in range(motions):
        beside = labels[(of_neighbours == b + 1).any(axis=1)]
        touching[:, b] = np.bincount(beside, minlength=motions + 1)[1:]
    smaller = np.minimum(count[:, None], count)
    border = np.maximum(np.minimum(BORDER * np.sqrt(smaller), smaller), 1.0)
    found = np.minimum((touching + touching.T) / (2 * border), 1.0)
    np.fill_diagonal(found, 1.0)
    return np.asarray(found)


def contact_cost(labels: Integers, neighbours: Integers, smooth: Floats) -> float:
    """Nats to code labels [P]: by frequency among motions that touch, otherwise by neighbours.

    Whether a track is an outlier is coded by frequency. A frequency of n labels is itself told to
    the precision of n, half of ln n, also where there are no outliers.

    Parameters
    ----------
    labels : ndarray [P] of int
        Labels 1..m, 0 for outliers.
    neighbours : ndarray [P, 8] of int
        Nearest other tracks.
    smooth : ndarray [m]
        Share of the squared misfit of each motion that may vary smoothly; two motions of which it
        is 1 are coded as if they touched.
    """
    assigned = labels > 0
    outliers = frequency_cost(assigned.astype(np.int64))
    by_neighbours = neighbour_cost(labels, neighbours) - outliers
    by_frequency = frequency_cost(labels[assigned])
    if assigned.any():
        outliers += 0.5 * math.log(len(labels))
    if by_frequency <= 0:
        return outliers + by_neighbours
    count = np.bincount(labels, minlength=len(smooth) + 1)[1:]
    common = np.maximum(
        contacts(labels, neighbours, len(smooth)), np.minimum(smooth[:, None], smooth)
    )
    np.fill_diagonal(common, 1.0)
    used = count > 0
    among = float((count[used] * np.log((common @ count)[used] / count[used])).sum())
    told = 0.5 * (int(used.sum()) - 1) * math.log(int(assigned.sum()))
    share = among / by_frequency
    return outliers + among + share * told + (1 - share) * by_neighbours
