"""The third test for outliers: tracks of a group that do not move with it.

The group is one rigid object, a flat that perspective bends (``geometry.projective_flats``). Each
track is compared with surrogates of its own, whose path is turned by random angles: they move as
far as it does, but not with the group. The residuals of inliers have one mode; that of a track that
moves by itself is one more draw from those of its surrogates. A track is an outlier if its
surrogates explain its residual better than the mode of the inliers does, unless it is too coherent
for chance: unless fewer than one track of the group would by chance fit as much better than its
surrogates. Tracks that deviate from a rigid object but move along with it may stay: if those found
fit better on average than even the better half of independent tracks would, none is an outlier.

Incomplete tracks are compared with the affine flat of their group over the frames in which each is
visible (``geometry.incomplete_flats``). What perspective and drift leave of them is smooth, so that
only tracks that are not, as mismatches and random walks are not, can be outliers.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from mssegment.geometry.incomplete_flats import IncompleteFlat, incomplete_flat
from mssegment.geometry.projective_flats import FLAT_DIMENSION, BentFlat, bent_flat
from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.sampling.chimeras import (
    GOOD_TRACKS,
    WALK_RESIDUAL,
    LocalFlats,
    noise_of_tracks,
)
from mssegment.segmentation.consensus.group_test import (
    TINY,
    moves,
    turned_paths,
    turned_steps,
)
from mssegment.segmentation.consensus.split_test import FEWEST_FOR_PERSPECTIVE

SURROGATES = 12
"""Surrogates of each track, which give its mean to 0.3 standard deviations, and one standard
deviation for all tracks."""
ROUNDS = 2
"""Fits of the flat, the second one without the outliers of the first."""
LEAST_GROUP = 8
"""Tracks of the smallest group that is tested."""
LEAST_FRAMES = 3
"""Frames of the shortest incomplete track that is tested: two say nothing of smoothness."""
USUAL = 0.95
"""A track fits a group if it fits better than the worst members, those beyond this quantile."""
EM_ROUNDS = 30
"""Rounds of expectation maximization."""
FIRST_SHARE, LARGEST_SHARE = 0.1, 0.5
"""Share of the outliers at first, and the largest: a group of which most tracks are outliers would
be none."""
OF_BETTER_HALF = -math.sqrt(2 / math.pi)
"""Mean of the smaller half of a standard normal distribution."""

Flat = BentFlat | IncompleteFlat


@dataclass(frozen=True)
class Null:
    """Normal distribution of the logarithm of the residual of each track under a null hypothesis.

    ``middle`` [n] are its means; the standard deviation ``spread`` is common.
    """

    middle: Floats
    spread: float

    def scores(self, logs: Floats) -> Floats:
        """Standard deviations [n] from the means."""
        return np.asarray((logs - self.middle) / self.spread)

    def meaningful(self, logs: Floats) -> Flags:
        """Which logarithms of residuals [n] are so small that fewer than one is by chance."""
        return np.asarray(self.scores(logs) < NormalDist().inv_cdf(1 / max(len(logs), 2)))


def walk_test(
    points: Floats, labels: Integers, rng: np.random.Generator, *, incomplete: bool = False
) -> Flags:
    """Which tracks are outliers although they have a label.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int
        Their labels 1, 2, ...
    rng : numpy.random.Generator
        Draws the flats and the surrogates.
    incomplete : bool
        Whether all tracks of ``LEAST_FRAMES`` frames are tested, or only complete ones.

    Returns
    -------
    ndarray [P] of bool
        True for outliers.
    """
    outliers = np.zeros(len(points), dtype=bool)
    frames = np.isfinite(points).all(axis=2).sum(axis=1)
    tested = frames >= (LEAST_FRAMES if incomplete else points.shape[1])
    for label in range(1, int(labels.max(initial=0)) + 1):
        members = np.flatnonzero((labels == label) & tested)
        if len(members) >= LEAST_GROUP and points.shape[1] > 2:
            outliers[members] = walks_among(points[members], rng)
    return outliers


def walks_among(points: Floats, rng: np.random.Generator) -> Flags:
    """Which tracks [n, F, 2] of one group do not move with it, [n]."""
    complete = bool(np.isfinite(points).all())
    fitted = _bent_flats(points, rng) if complete else _incomplete_flats(points)
    frames = float(np.median(np.isfinite(points).all(axis=2).sum(axis=1)))
    least = 1 / math.sqrt(2 * max(2 * frames - FLAT_DIMENSION, 1))
    outliers = np.zeros(len(points), dtype=bool)
    for _ in range(ROUNDS):
        logs, null = _compared(points, ~outliers, fitted, rng)
        found = (probability_of_null(logs, null, least) > 0.5) & ~null.meaningful(logs)
        if not complete:
            found &= _rough(points, np.exp(logs))
        if found.any() and null.scores(logs)[found].mean() < OF_BETTER_HALF:
            found[:] = False
        settled = bool((found == outliers).all()) or (~found).sum() < LEAST_GROUP
        outliers = found
        if settled:
            break
    return outliers


def fit_by_chance(members: Floats, others: Floats, rng: np.random.Generator) -> Flags:
    """Which ``others`` [m, F, 2] may fit the geometry of a group [n, F, 2] by chance, [m].

    Of those that are as rough as they misfit: what fits the flat of the group worse than its worst
    members, those beyond the quantile ``USUAL``, or no better than one of the surrogates of all m.
    """
    flat = incomplete_flat(members, good=GOOD_TRACKS)
    limit = float(np.nanquantile(flat.own_residuals(members), USUAL))
    residuals = flat.residuals(others)
    meaningful = _null(flat, others, rng).meaningful(np.log(residuals + TINY))
    return _rough(others, residuals) & ~((residuals <= limit) & meaningful)


def _rough(points: Floats, residuals: Floats) -> Flags:
    """Which tracks [n, F, 2] have residuals [n] like the noise of their own paths."""
    return np.asarray(residuals <= WALK_RESIDUAL * noise_of_tracks(points))


def _bent_flats(points: Floats, rng: np.random.Generator) -> Callable[[Flags], Flat]:
    """What fits the flat to some [n] of the complete tracks; at first good ones count more."""
    local = LocalFlats(points, rng).own_residuals()
    trust = geman_mcclure_weights(local**2, float(np.quantile(local, GOOD_TRACKS)) ** 2 + TINY)

    def fitted(kept: Flags) -> Flat:
        bent = int(kept.sum()) >= FEWEST_FOR_PERSPECTIVE
        return bent_flat(points[kept], 0.0, perspective=bent, good=GOOD_TRACKS, weights=trust[kept])

    return fitted


def _incomplete_flats(points: Floats) -> Callable[[Flags], Flat]:
    """What fits the affine flat to some [n] of the incomplete tracks."""
    return lambda kept: incomplete_flat(points[kept], good=GOOD_TRACKS)


def _compared(
    points: Floats, kept: Flags, fitted: Callable[[Flags], Flat], rng: np.random.Generator
) -> tuple[Floats, Null]:
    """Logarithms of the residuals [n] from the flat of the ``kept`` tracks, and their null."""
    flat = fitted(kept)
    residuals = flat.residuals(points)
    residuals[kept] = flat.own_residuals(points[kept])
    return np.log(residuals + TINY), _null(flat, points, rng)


def _null(flat: Flat, points: Floats, rng: np.random.Generator) -> Null:
    """Of the residuals of surrogates of each track [n, F, 2] from a flat."""
    turned = turned_paths if moves(points) else turned_steps
    drawn = np.concatenate([turned(points, rng) for _ in range(SURROGATES)])
    found = np.log(flat.residuals(drawn).reshape(SURROGATES, -1) + TINY)
    spread = float(np.sqrt(np.nanmedian(found.var(axis=0, ddof=1))))
    return Null(found.mean(axis=0), spread + TINY)


def probability_of_null(logs: Floats, null: Null, least: float) -> Floats:
    """Posterior probability [n] that each logarithm of a residual is of its null hypothesis.

    Expectation maximization with a normal distribution of the inliers, whose mean and standard
    deviation, at least ``least``, are free, and the ``null``, of which only the share is free. It
    starts at the small residuals: many tracks may be outliers.
    """
    low, mean = (float(q) for q in np.quantile(logs, [GOOD_TRACKS / 4, GOOD_TRACKS]))
    deviation = max(mean - low, least)
    share, of_null = FIRST_SHARE, _normal(null.scores(logs), 0.0, 1.0) / null.spread
    probability = np.zeros(len(logs))
    for _ in range(EM_ROUNDS):
        fits = (1 - share) * _normal(logs, mean, deviation)
        probability = np.where(
            logs < mean, 0.0, share * of_null / (fits + share * of_null + 1e-300)
        )
        weights = 1 - probability
        total = max(float(weights.sum()), 1e-12)
        mean = float(weights @ logs) / total
        deviation = max(math.sqrt(float(weights @ (logs - mean) ** 2) / total), least)
        share = float(np.clip(probability.mean(), 1 / len(logs), LARGEST_SHARE))
    return probability


def _normal(values: Floats, mean: float, deviation: float) -> Floats:
    """Normal density up to a constant factor."""
    return np.asarray(np.exp(-0.5 * ((values - mean) / deviation) ** 2) / deviation)
