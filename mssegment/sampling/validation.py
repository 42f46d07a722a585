"""Validation between frame pairs: how well each track fits the hypotheses near it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.geometry.flats import extent
from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import Floats, HypothesisSet, Integers
from mssegment.sampling.neighbourhoods import nearest_neighbours, neighbour_space
from mssegment.sampling.observed import ObservedSet

MISFIT_NEIGHBOURS = 20
"""The misfit of a track is with respect to hypotheses seeded at this many nearest neighbours."""
MISFIT_OF_EXTENT, MISFIT_OF_MEDIAN = 0.0125, 8.0
"""First test: the misfit of an outlier exceeds both shares, of the extent and of the median
misfit."""
PERSPECTIVE_OF_EXTENT, PERSPECTIVE_OF_MEDIAN = 0.15, 40.0
"""The same under strong perspective, where tracks without a plane near them have a large misfit."""
FEW_OUTLIERS_FACTOR, FEW_OUTLIERS_SHARE = 3.0, 0.025
"""If less than this share of the tracks exceeds the limit, there are hardly any outliers, and the
limit is multiplied by this factor: the largest misfits are then those of inliers."""
MAX_OUTLIER_SHARE = 0.6
"""If more than this share of the tracks would be outliers, the test is not applied."""


class Misfit:
    """Accumulates, set by set, how badly each track fits the motions near it.

    Per frame pair, the smallest residual from hypotheses that are seeded at a nearest neighbour of
    the track and were not computed from it. The misfit is their geometric mean over the pairs.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    among : ndarray of int, optional
        Tracks among which neighbours are searched; all by default.
    """

    def __init__(self, points: Floats, among: Integers | None = None) -> None:
        self._points = points
        self._among = among
        self._logs, self._counts = np.zeros(len(points)), np.zeros(len(points))
        self._cache: dict[bytes, Integers] = {}

    def add(self, observed_set: ObservedSet, squared: Floats) -> None:
        """Add a set with its ``ranking_sq_residuals``; ignored if its model is not local."""
        if not observed_set.model.is_local:
            return
        hypotheses, tracks = observed_set.hypotheses, observed_set.tracks
        # a track is not compared with hypotheses that were computed from it
        squared = squared.copy()
        row = np.full(len(self._points), -1)
        row[tracks] = np.arange(len(tracks))
        subset_rows = row[hypotheses.subsets]
        hypothesis, member = np.nonzero(subset_rows >= 0)
        squared[subset_rows[hypothesis, member], hypothesis] = np.inf
        near = self._seeded_nearby(hypotheses, tracks)
        best = np.where(near, squared, np.inf).min(axis=1)
        best = np.where(np.isfinite(best), best, squared.min(axis=1))
        usable = np.isfinite(best)
        residual = np.sqrt(best[usable]) * hypotheses.normalization.scale
        self._logs[tracks[usable]] += np.log(np.maximum(residual, 1e-9))
        self._counts[tracks[usable]] += 1

    def pixels(self) -> Floats:
        """The misfit of each track [P] in pixels; NaN if it is not visible in any pair."""
        counts = np.where(self._counts > 0, self._counts, np.nan)
        return np.asarray(np.exp(self._logs / counts))

    def _seeded_nearby(self, hypotheses: HypothesisSet, tracks: Integers) -> Flags:
        """Whether each hypothesis has its seed near each of the ``tracks``, [n, hypotheses]."""
        seeds, column = np.unique(hypotheses.subsets[:, 0], return_inverse=True)
        column_of = np.full(len(self._points), len(seeds))
        column_of[seeds] = np.arange(len(seeds))
        near = np.zeros((len(tracks), len(seeds) + 1), dtype=bool)
        np.put_along_axis(near, column_of[self._neighbours(hypotheses, tracks)], True, axis=1)
        return near[:, column]

    def _neighbours(self, hypotheses: HypothesisSet, tracks: Integers) -> Integers:
        """The nearest neighbours of ``tracks``, [n, k]: over all frames if all are complete."""
        frames = list(hypotheses.frames)
        candidates = tracks if self._among is None else self._among
        candidates = candidates[np.isfinite(self._points[candidates][:, frames]).all(axis=(1, 2))]
        space, queries = self._points[candidates], self._points[tracks]
        complete = bool(np.isfinite(queries).all() and np.isfinite(space).all())
        key = tracks.tobytes() + (b"" if complete else repr(frames).encode())
        if key not in self._cache:
            if not complete:
                space, queries = space[:, frames], queries[:, frames]
            if self._among is None:
                found = nearest_neighbours(queries, MISFIT_NEIGHBOURS)
            else:
                count = min(MISFIT_NEIGHBOURS, len(candidates))
                found = nearest(neighbour_space(space), neighbour_space(queries), count)[1]
            self._cache = {key: candidates[found]}
        return self._cache[key]


def two_frame_misfit(
    points: Floats, sets: Sequence[HypothesisSet], among: Integers | None = None
) -> Floats:
    """The ``Misfit`` [P] of tracks [P, F, 2] in pixels; NaN if not visible in any pair."""
    misfit = Misfit(points, among)
    for hypotheses in sets:
        if models.class_named(hypotheses.model).is_local and len(hypotheses.points):
            observed_set = ObservedSet.of(points, hypotheses)
            misfit.add(observed_set, observed_set.ranking_sq_residuals())
    return misfit.pixels()


def misfit_limit(points: Floats, misfit: Floats, *, perspective: bool = False) -> float:
    """The misfit in pixels above which a track is an outlier, before ``limit_factor``."""
    of_extent, of_median = MISFIT_OF_EXTENT, MISFIT_OF_MEDIAN
    if perspective:
        of_extent, of_median = PERSPECTIVE_OF_EXTENT, PERSPECTIVE_OF_MEDIAN
    return max(of_extent * extent(points), of_median * float(np.nanmedian(misfit)))


def limit_factor(misfit: Floats, limit: float) -> float:
    """Factor for the limits of outlier tests: larger than 1 if there are hardly any outliers."""
    return FEW_OUTLIERS_FACTOR if (misfit > limit).mean() < FEW_OUTLIERS_SHARE else 1.0


def first_test(points: Floats, misfit: Floats, *, perspective: bool = False) -> Flags:
    """Which tracks are inliers: their misfit is not much larger than that of the others.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels.
    misfit : ndarray [P]
        Their ``two_frame_misfit``.
    perspective : bool
        Whether perspective is strong.

    Returns
    -------
    ndarray [P] of bool
        All True if too many tracks would fail.
    """
    if not np.isfinite(misfit).any():
        return np.ones(len(points), dtype=bool)
    limit = misfit_limit(points, misfit, perspective=perspective)
    passed = np.asarray(~(misfit > limit_factor(misfit, limit) * limit))
    return passed if passed.mean() > 1 - MAX_OUTLIER_SHARE else np.ones(len(points), dtype=bool)
