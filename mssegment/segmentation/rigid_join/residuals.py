"""The noise that is left once every group has an epipolar geometry of its own.

Noise that is measured among neighbouring matches includes the parallax between them, which is all
that a scene with depth consists of. Distances from the epipolar lines of a group do not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.geometry.epipolar import sampson
from mssegment.geometry.epipolar_fit import fit_epipolar
from mssegment.geometry.projective import homogeneous
from mssegment.models import Flags
from mssegment.preprocessing.noise import least_noise
from mssegment.records import Floats
from mssegment.special import median

LEAST_GROUP = 12
"""Fewest matches of a group that count: an epipolar geometry has up to seven parameters."""
PARAMETERS = 7
"""Parameters of an epipolar geometry."""
ROUNDS = 2
"""Rounds of fits and noise: the first ones are robust at too large a scale."""
NORMAL_DEVIATION = 1.4826
"""Standard deviation of normal noise over the median of its absolute value."""


def noise_of_groups(points: Floats, members: Sequence[Flags], noise: float) -> float:
    """The noise of matches about the epipolar geometry of each group.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.
    members : sequence of ndarray [P] of bool
        The matches of each group.
    noise : float
        The noise of one coordinate of the difference between a match and its motion, in pixels, as
        measured among neighbours.

    Returns
    -------
    float
        The same, not larger, and at least that of the best matchers.
    """
    groups = [points[own] for own in members if own.sum() >= LEAST_GROUP]
    for _ in range(ROUNDS if groups else 0):
        found = np.concatenate([_distances(matches, noise) for matches in groups])
        # a Sampson distance spreads the error over both views
        own = math.sqrt(2.0) * NORMAL_DEVIATION * median(found)
        noise = min(noise, max(own, least_noise(points)))
    return noise


def _distances(matches: Floats, noise: float) -> Floats:
    """Sampson distances [n] in pixels, corrected for what the fit has taken up."""
    centres = matches.mean(axis=0)
    unit = math.sqrt(float(((matches - centres) ** 2).sum(axis=-1).mean()) / 2)
    if unit == 0:
        return np.zeros(0)
    first, second = np.moveaxis((matches - centres) / unit, 1, 0)
    fit = fit_epipolar(first, second, np.ones(len(matches)), noise / unit)
    error = sampson(fit.matrix[None], homogeneous(first), homogeneous(second)).error[0]
    return np.asarray(np.abs(error) * unit / math.sqrt(1 - PARAMETERS / len(matches)))
