"""The third test for outliers: tracks of a group that move along like random walks.

The residuals of a group from its own local flats have one mode where the tracks move together, and
another where random walks made of the same steps lie. A track is an outlier if the walks explain
its residual better, unless it is too coherent for chance: unless the expected number of walks whose
residual is as small relative to how far they move is below one.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.sampling.chimeras import (
    FLAT_DIMENSION,
    LocalFlats,
    draw_walks,
    log_tail,
    spread_of_tracks,
)

FLAT_SPREAD = 0.15
"""Standard deviation of the logarithm of a residual because the flats go through noisy tracks
(simulated: 0.14 to 0.17); the noise of the track itself has 1 / sqrt(2 (2F - 3))."""
LEAST_GROUP = 8
"""Tracks of the smallest group that is tested."""
EM_ROUNDS = 30
"""Rounds of expectation maximization."""
LARGEST_SHARE = 0.5
"""A group of which most tracks are walks would be none."""


def walk_test(points: Floats, labels: Integers, rng: np.random.Generator) -> Flags:
    """Which tracks are outliers although they have a label; only complete tracks are tested.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int
        Their labels 1, 2, ...
    rng : numpy.random.Generator
        Draws the flats and the walks.

    Returns
    -------
    ndarray [P] of bool
        True for outliers.
    """
    outliers = np.zeros(len(points), dtype=bool)
    complete = np.isfinite(points).all(axis=(1, 2))
    for label in range(1, int(labels.max(initial=0)) + 1):
        members = np.flatnonzero((labels == label) & complete)
        if len(members) >= LEAST_GROUP and points.shape[1] > 2:
            outliers[members] = walks_among(points[members], rng)
    return outliers


def walks_among(points: Floats, rng: np.random.Generator) -> Flags:
    """Which tracks [n, F, 2] of one group are random walks, [n]."""
    flats = LocalFlats(points, rng)
    samples = draw_walks(points, flats.samples, rng)
    own, null = flats.own_residuals(), flats.residuals_of(samples)
    free = max(2 * points.shape[1] - FLAT_DIMENSION, 1)
    least = math.hypot(FLAT_SPREAD, 1 / math.sqrt(2 * free))
    relative, of_walks = own / spread_of_tracks(points), null / spread_of_tracks(samples)
    meaningful = math.log(len(points)) + log_tail(relative, of_walks) < 0
    return np.asarray((probability_of_null(own, null, least) > 0.5) & ~meaningful)


def probability_of_null(values: Floats, null: Floats, least: float) -> Floats:
    """Posterior probability [n] that each positive value is of the null hypothesis.

    Expectation maximization with two log-normal distributions: that of the ``null`` values, which
    is fixed, and one below it, whose standard deviation is at least ``least``.
    """
    logs, of_null = np.log(values + 1e-12), np.log(null + 1e-12)
    middle = float(np.median(of_null))
    spread = max(1.4826 * float(np.median(np.abs(of_null - middle))), least)
    mean = float(np.median(logs))
    deviation = max(1.4826 * float(np.median(np.abs(logs - mean))), least)
    share = 0.1
    probability = np.zeros(len(logs))
    for _ in range(EM_ROUNDS):
        mean = min(mean, middle)
        fits = (1 - share) * _normal(logs, mean, deviation)
        walks = share * _normal(logs, middle, spread)
        probability = np.where(logs < mean, 0.0, walks / (fits + walks + 1e-300))
        weights = 1 - probability
        total = max(float(weights.sum()), 1e-12)
        mean = float(weights @ logs) / total
        deviation = max(math.sqrt(float(weights @ (logs - mean) ** 2) / total), least)
        share = float(np.clip(probability.mean(), 1 / len(logs), LARGEST_SHARE))
    return probability


def _normal(values: Floats, mean: float, deviation: float) -> Floats:
    """Normal density up to a constant factor."""
    return np.asarray(np.exp(-0.5 * ((values - mean) / deviation) ** 2) / deviation)
