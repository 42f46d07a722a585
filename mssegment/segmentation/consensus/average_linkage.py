"""Moving objects before a camera that stands still: compact, each in an affine motion of its own.

Bodies that drive in parallel share epipolar lines, and before a static camera no background has to
be held together over its depths. What tells objects apart is how far they get: affine motions
between frames as far apart as the tracks last. A track marks every hypothesis that explains it up
to the noise; groups of tracks that mark the same ones are joined, those that agree most first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Floats, HypothesisSet, Integers
from mssegment.sampling.observed import ObservedSet

NOISE_RANK = 6
"""The noise of a set: the median over the tracks of the sixth smallest residual (twice the
elemental subset) among hypotheses that are not made from the track."""
TOLERANCE = 3.0
"""A hypothesis explains a track up to so many times the noise (standard deviation of the mark)."""
JOINED = 0.2
"""Two groups are one object if the tracks of the one mark, on average, this share of what those of
the other do."""
FEWEST = 6
"""Tracks without which a group is no object: twice the elemental subset."""


class AverageLinkage:
    """The tree of joins among tracks, and where to cut it."""

    def __init__(self, points: Floats, sets: Sequence[HypothesisSet]) -> None:
        """For the tracks ``points`` [P, F, 2] (NaN where not seen) by sets on frame pairs."""
        agreement, weight = shared_marks(points, sets)
        self.seen = np.asarray((weight > 0).sum(axis=1) > 1)
        chosen = np.flatnonzero(self.seen)
        block = np.ix_(chosen, chosen)
        self._joins = joins(agreement[block], weight[block])
        self._size = len(chosen)

    def labels(self, least: int, most: int) -> Integers:
        """Groups 1, 2, ... of the seen tracks, at least ``least`` and at most ``most``; 0: none.

        Groups are joined as long as they agree, and then, where they are too many, those that
        agree most. Where they are too few the last joins are undone.
        """
        similar = np.array([similarity for _, _, similarity in self._joins])
        usual = int((similar >= JOINED).sum())
        counts = self._counts()
        allowed = np.flatnonzero((counts >= least) & (counts <= most))
        if not len(allowed):
            allowed = np.flatnonzero(counts == counts.max())
        return self._cut(int(allowed[np.abs(allowed - usual).argmin()]))

    def _counts(self) -> Integers:
        """How many groups have FEWEST tracks after 0, 1, 2, ... joins."""
        sizes, count, counts = np.ones(self._size, dtype=int), 0, [0]
        for kept, gone, _ in self._joins:
            before = int(sizes[kept] >= FEWEST) + int(sizes[gone] >= FEWEST)
            sizes[kept] += sizes[gone]
            count += int(sizes[kept] >= FEWEST) - before
            counts.append(count)
        return np.array(counts)

    def _cut(self, number: int) -> Integers:
        """The groups after ``number`` joins."""
        labels = np.arange(self._size)
        for kept, gone, _ in self._joins[:number]:
            labels[labels == gone] = kept
        names, sizes = np.unique(labels, return_counts=True)
        found = np.zeros(self._size, dtype=np.int64)
        for label, name in enumerate(names[sizes >= FEWEST], start=1):
            found[labels == name] = label
        return found


def shared_marks(points: Floats, sets: Sequence[HypothesisSet]) -> tuple[Floats, Floats]:
    """Cosine of the marks of every two tracks, summed over the sets that see both, and the weights.

    A mark is exp(-r^2 / 2 t^2), t TOLERANCE times the noise of the set. A set weighs as the square
    of its gap: so does what a difference of motions is worth against the noise.
    """
    agreement = np.zeros((len(points), len(points)))
    weights = np.zeros_like(agreement)
    for entry in sets:
        observed_set = ObservedSet.of(points, entry)
        seen, squared = observed_set.tracks, observed_set.ranking_sq_residuals()
        of_track = np.full(len(points), -1)
        of_track[seen] = np.arange(len(seen))
        others = squared.copy()
        others[of_track[entry.subsets], np.arange(len(entry.subsets))[:, None]] = np.inf
        rank = min(NOISE_RANK, squared.shape[1]) - 1
        noise = np.median(np.partition(others, rank, axis=1)[:, rank])
        marks = np.exp(-squared / (2 * TOLERANCE**2 * max(float(noise), 1e-18)))
        length = np.maximum(np.linalg.norm(marks, axis=1), 1e-12)
        weight = float(entry.frames[1] - entry.frames[0]) ** 2
        block = np.ix_(seen, seen)
        agreement[block] += weight * (marks @ marks.T) / (length[:, None] * length)
        weights[block] += weight
    return agreement, weights


def joins(agreement: Floats, weight: Floats) -> list[tuple[int, int, float]]:
    """Average linkage: the groups that agree most are joined first, down to one group.

    ``agreement`` [n, n] sums what ``weight`` [n, n] weighs; groups agree by the ratio of their
    sums. Each join is (the group that stays, the one that goes, their agreement).
    """
    agreement, weight = agreement.copy(), weight.copy()
    ratio = agreement / np.maximum(weight, 1e-12)
    np.fill_diagonal(ratio, -np.inf)
    found = []
    best = ratio.argmax(axis=1)
    value = ratio[np.arange(len(ratio)), best]
    for _ in range(len(ratio) - 1):
        i = int(value.argmax())
        j = int(best[i])
        i, j = min(i, j), max(i, j)
        found.append((i, j, float(ratio[i, j])))
        for sums in (agreement, weight):
            sums[i] += sums[j]
            sums[:, i] = sums[i]
        own = agreement[i] / np.maximum(weight[i], 1e-12)
        own[np.isneginf(ratio[i])] = -np.inf
        ratio[i], ratio[:, i] = own, own
        ratio[j], ratio[:, j] = -np.inf, -np.inf
        value[j] = -np.inf
        stale = np.flatnonzero(((best == i) | (best == j) | (own > value)) & (value > -np.inf))
        stale = np.union1d(stale, [i])
        best[stale] = ratio[stale].argmax(axis=1)
        value[stale] = ratio[stale, best[stale]]
    return found
