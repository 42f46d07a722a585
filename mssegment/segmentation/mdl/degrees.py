"""What a motion costs that departs from a translation by degrees.

Most motions between two pictures are nearly translations: how they turn and grow, shear, and bend
moves their tracks by less and less. The parameters of each degree are coded to the precision that
the tracks determine, as normal numbers whose variance is that of this degree of this motion. A
small body that hardly turns needs little more than its translation.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.records import Floats

PARAMETERS_OF_DEGREE = 2
"""Parameters of each degree: turning and growing; shear; perspective."""
RIDGE = 1e-9
"""Keeps the normal equations of collinear tracks regular, over their trace."""
TINY = 1e-12
"""Square in pixels that keeps divisions regular for coincident tracks."""


def squares_by_degree(
    first: Floats, displacements: Floats, residuals: Floats, weights: Floats
) -> list[float]:
    """Mean squared displacement by each degree of a motion, for its tracks.

    Parameters
    ----------
    first : ndarray [n, 2]
        Positions in the first picture.
    displacements : ndarray [n, 2]
        From the first to the second picture.
    residuals : ndarray [n]
        Of the motion.
    weights : ndarray [n]
        Weights of the tracks.

    Returns
    -------
    list of 3 floats
        What a similarity explains beyond a translation, an affine map beyond a similarity, and the
        motion beyond an affine map, in squared pixels.

    Examples
    --------
    >>> import numpy as np
    >>> square = np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]])
    >>> moved = 0.1 * square + [5.0, 0.0]
    >>> [round(one, 3) for one in squares_by_degree(square, moved, np.zeros(4), np.ones(4))]
    [0.02, 0.0, 0.0]
    """
    weights = weights / weights.sum()
    first = first - weights @ first
    moved = displacements - weights @ displacements
    weighted = weights[:, None] * first
    normal, mixed = weighted.T @ first, weighted.T @ moved
    trace = float(np.trace(normal)) + TINY
    turning = mixed[0, 1] - mixed[1, 0]
    similarity = float(np.trace(mixed) ** 2 + turning**2) / trace
    affine = float((mixed * np.linalg.solve(normal + RIDGE * trace * np.eye(2), mixed)).sum())
    total = float(weights @ (moved**2).sum(axis=1))
    beyond = total - float(weights @ residuals**2) - affine
    return [similarity, max(affine - similarity, 0.0), max(beyond, 0.0)]


def degree_cost(square: float, count: int, scale: float) -> float:
    """Nats to code the parameters of one degree, given their variance.

    Parameters
    ----------
    square : float
        Mean squared displacement that they make, in squared pixels.
    count : int
        Number of tracks.
    scale : float
        Scale of the residuals in pixels.

    Notes
    -----
    Of q normal parameters with variance v, known to the precision e, the evidence is the
    likelihood at its maximum less q/2 ln(1 + v/e^2) + (sum of squares) / 2 (v + e^2). At the most
    likely v this is q/2 (1 + ln(a)), where a is the mean square over e^2, or q a / 2 for a < 1.
    """
    ratio = square * count / (PARAMETERS_OF_DEGREE * scale**2)
    half = PARAMETERS_OF_DEGREE / 2
    return half * (1.0 + math.log(ratio)) if ratio > 1 else half * ratio
