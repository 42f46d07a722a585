"""Validation between frame pairs: how badly each track fits the hypotheses around it."""

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

LOCAL = 20
"""A track's misfit comes from hypotheses whose seed is among so many nearest tracks."""
MISFIT_OF_EXTENT, MISFIT_OF_MEDIAN = 0.0125, 8.0
"""First test: an outlier's misfit is above both shares: of the extent, and of the median misfit."""
PERSPECTIVE_OF_EXTENT, PERSPECTIVE_OF_MEDIAN = 0.15, 40.0
"""The same where perspective is strong: tracks without a plane near them misfit, and are right."""
SPARED, RARE = 3.0, 0.025
"""Where fewer than this share of the tracks are beyond the limit, there are hardly any outliers
about, only the edge of right tracks: tests of outliers are so many times gentler."""
AT_MOST = 0.6
"""If more than this share of the tracks were outliers, the tests mean nothing."""


class Misfit:
    """How badly each track fits the motions around it, set after set.

    Per frame pair the best residual among the hypotheses that are seeded in the track's nearest
    and not made from itself; the geometric mean over the pairs.
    """

    def __init__(self, points: Floats, among: Integers | None = None) -> None:
        """For the tracks ``points`` [P, F, 2] (pixels); the nearest are sought ``among`` these."""
        self._points = points
        self._among = among
        self._logs, self._counts = np.zeros(len(points)), np.zeros(len(points))
        self._nearest: dict[bytes, Integers] = {}

    def add(self, observed_set: ObservedSet, squared: Floats) -> None:
        """Add a set with its ``ranking_sq_residuals``; only sets of local models count."""
        if not observed_set.model.is_local:
            return
        entry, seen, squared = observed_set.hypotheses, observed_set.tracks, squared.copy()
        of_track = np.full(len(self._points), -1)
        of_track[seen] = np.arange(len(seen))
        made_of = of_track[entry.subsets]
        hypothesis, place = np.nonzero(made_of >= 0)
        squared[made_of[hypothesis, place], hypothesis] = np.inf
        around = self._around(entry, seen)
        best = np.where(around, squared, np.inf).min(axis=1)
        best = np.where(np.isfinite(best), best, squared.min(axis=1))
        usable = np.isfinite(best)
        residual = np.sqrt(best[usable]) * entry.normalization.scale
        self._logs[seen[usable]] += np.log(np.maximum(residual, 1e-9))
        self._counts[seen[usable]] += 1

    def pixels(self) -> Floats:
        """The misfit of each track [P], NaN for what no pair sees."""
        counts = np.where(self._counts > 0, self._counts, np.nan)
        return np.asarray(np.exp(self._logs / counts))

    def _around(self, entry: HypothesisSet, seen: Integers) -> Flags:
        """Which hypotheses are seeded near which of the seen tracks, [n, hypotheses]."""
        seeds, column = np.unique(entry.subsets[:, 0], return_inverse=True)
        column_of = np.full(len(self._points), len(seeds))
        column_of[seeds] = np.arange(len(seeds))
        near = np.zeros((len(seen), len(seeds) + 1), dtype=bool)
        np.put_along_axis(near, column_of[self._near(entry, seen)], True, axis=1)
        return near[:, column]

    def _near(self, entry: HypothesisSet, seen: Integers) -> Integers:
        """The tracks nearest to each of the seen, [n, k]; by whole tracks if all are complete."""
        frames = list(entry.frames)
        base = seen if self._among is None else self._among
        base = base[np.isfinite(self._points[base][:, frames]).all(axis=(1, 2))]
        whole = bool(
            np.isfinite(self._points[seen]).all() and np.isfinite(self._points[base]).all()
        )
        key = seen.tobytes() + (b"" if whole else repr(frames).encode())
        if key not in self._nearest:
            of, to = self._points[base], self._points[seen]
            if not whole:
                of, to = of[:, frames], to[:, frames]
            if self._among is None:
                found = nearest_neighbours(to, LOCAL)
            else:
                places, asked = neighbour_space(of), neighbour_space(to)
                found = nearest(places, asked, min(LOCAL, len(base)))[1]
            self._nearest = {key: base[found]}
        return self._nearest[key]


def two_frame_misfit(
    points: Floats, sets: Sequence[HypothesisSet], among: Integers | None = None
) -> Floats:
    """The ``Misfit`` of the tracks [P, F, 2] in pixels [P]; NaN: seen in no pair."""
    misfit = Misfit(points, among)
    for entry in sets:
        if models.class_named(entry.model).is_local and len(entry.points):
            observed_set = ObservedSet.of(points, entry)
            misfit.add(observed_set, observed_set.ranking_sq_residuals())
    return misfit.pixels()


def misfit_limit(points: Floats, misfit: Floats, *, perspective: bool = False) -> float:
    """The misfit in pixels above which a track is an outlier, before ``spared``."""
    of_extent, of_median = MISFIT_OF_EXTENT, MISFIT_OF_MEDIAN
    if perspective:
        of_extent, of_median = PERSPECTIVE_OF_EXTENT, PERSPECTIVE_OF_MEDIAN
    return max(of_extent * extent(points), of_median * float(np.nanmedian(misfit)))


def spared(misfit: Floats, limit: float) -> float:
    """What the limits are multiplied with: more than 1 where hardly any outliers are about."""
    return SPARED if (misfit > limit).mean() < RARE else 1.0


def first_test(points: Floats, misfit: Floats, *, perspective: bool = False) -> Flags:
    """Which tracks pass: their misfit is not far above the others', nor large for the picture."""
    if not np.isfinite(misfit).any():
        return np.ones(len(points), dtype=bool)
    limit = misfit_limit(points, misfit, perspective=perspective)
    kept = np.asarray(~(misfit > spared(misfit, limit) * limit))
    return kept if kept.mean() > 1 - AT_MOST else np.ones(len(points), dtype=bool)
