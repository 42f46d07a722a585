"""Moving objects before a static camera: compact, each with an affine motion of its own.

Objects that drive in parallel share epipolar lines, and before a static camera no background with
different depths has to be kept in one group. What separates objects is how far they move: affine
motions are computed between frames as far apart as tracks last. A track marks every hypothesis that
explains it up to noise; groups of tracks that mark the same ones are merged, those that agree most
first.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Floats, HypothesisSet, Integers
from mssegment.sampling.observed import ObservedSet

NOISE_RANK = 6
"""The noise of a set is the median over the tracks of the sixth smallest residual (twice the
size of an elemental subset) from hypotheses that were not computed from the track."""
MARK_DEVIATIONS = 3.0
"""Standard deviation of a mark, relative to the noise."""
MIN_AGREEMENT = 0.2
"""Two groups are one object if their tracks mark, on average, at least this share of the same
hypotheses."""
MIN_GROUP_SIZE = 6
"""Smallest number of tracks of an object: twice the size of an elemental subset."""


class AverageLinkage:
    """Hierarchical clustering of tracks by their agreement.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    sets : sequence of HypothesisSet
        Hypotheses between frame pairs.

    Attributes
    ----------
    usable : ndarray [P] of bool
        Tracks that share a set with other tracks.
    """

    def __init__(self, points: Floats, sets: Sequence[HypothesisSet]) -> None:
        agreement, weight = shared_marks(points, sets)
        self.usable = np.asarray((weight > 0).sum(axis=1) > 1)
        tracks = np.flatnonzero(self.usable)
        block = np.ix_(tracks, tracks)
        self._merges = average_linkage(agreement[block], weight[block])
        self._size = len(tracks)

    def labels(self, least: int, most: int) -> Integers:
        """Cut the hierarchy into groups.

        Groups are merged as long as they agree. If there are too many, those that agree most are
        merged further; if there are too few, the last merges are undone.

        Parameters
        ----------
        least, most : int
            Bounds of the number of groups.

        Returns
        -------
        ndarray of int
            Labels 1, 2, ... of the usable tracks; 0 for none.
        """
        similarities = np.array([similarity for _, _, similarity in self._merges])
        preferred = int((similarities >= MIN_AGREEMENT).sum())
        counts = self._counts()
        allowed = np.flatnonzero((counts >= least) & (counts <= most))
        if not len(allowed):
            allowed = np.flatnonzero(counts == counts.max())
        return self._cut(int(allowed[np.abs(allowed - preferred).argmin()]))

    def _counts(self) -> Integers:
        """Number of groups with at least MIN_GROUP_SIZE tracks after 0, 1, 2, ... merges."""
        sizes, count, counts = np.ones(self._size, dtype=int), 0, [0]
        for kept, merged, _ in self._merges:
            before = int(sizes[kept] >= MIN_GROUP_SIZE) + int(sizes[merged] >= MIN_GROUP_SIZE)
            sizes[kept] += sizes[merged]
            count += int(sizes[kept] >= MIN_GROUP_SIZE) - before
            counts.append(count)
        return np.array(counts)

    def _cut(self, number: int) -> Integers:
        """Labels of the groups after ``number`` merges."""
        labels = np.arange(self._size)
        for kept, merged, _ in self._merges[:number]:
            labels[labels == merged] = kept
        names, sizes = np.unique(labels, return_counts=True)
        found = np.zeros(self._size, dtype=np.int64)
        for label, name in enumerate(names[sizes >= MIN_GROUP_SIZE], start=1):
            found[labels == name] = label
        return found


def shared_marks(points: Floats, sets: Sequence[HypothesisSet]) -> tuple[Floats, Floats]:
    """Cosine similarity of the marks of all pairs of tracks, summed over the sets, and weights.

    A mark is exp(-r^2 / 2 t^2), where t is ``MARK_DEVIATIONS`` times the noise of the set. The
    weight of a set is the square of its gap, because the signal-to-noise ratio of a difference of
    motions is proportional to the gap.
    """
    agreement = np.zeros((len(points), len(points)))
    weights = np.zeros_like(agreement)
    for hypotheses in sets:
        observed_set = ObservedSet.of(points, hypotheses)
        tracks, squared = observed_set.tracks, observed_set.ranking_sq_residuals()
        row = np.full(len(points), -1)
        row[tracks] = np.arange(len(tracks))
        others, subsets = squared.copy(), hypotheses.subsets
        others[row[subsets], np.arange(len(subsets))[:, None]] = np.inf
        rank = min(NOISE_RANK, squared.shape[1]) - 1
        noise = np.median(np.partition(others, rank, axis=1)[:, rank])
        marks = np.exp(-squared / (2 * MARK_DEVIATIONS**2 * max(float(noise), 1e-18)))
        length = np.maximum(np.linalg.norm(marks, axis=1), 1e-12)
        weight = float(hypotheses.frames[1] - hypotheses.frames[0]) ** 2
        block = np.ix_(tracks, tracks)
        agreement[block] += weight * (marks @ marks.T) / (length[:, None] * length)
        weights[block] += weight
    return agreement, weights


def average_linkage(agreement: Floats, weight: Floats) -> list[tuple[int, int, float]]:
    """Merge the groups that agree most, down to one group.

    Parameters
    ----------
    agreement : ndarray [n, n]
        Weighted sums of the agreement of pairs.
    weight : ndarray [n, n]
        Sums of the weights. The agreement of two groups is the ratio of their sums.

    Returns
    -------
    list of (int, int, float)
        For each merge: the group that remains, the one that is merged into it, and their agreement.

    Examples
    --------
    >>> import numpy as np
    >>> agreement = np.array([[1.0, 0.9, 0.1], [0.9, 1.0, 0.3], [0.1, 0.3, 1.0]])
    >>> average_linkage(agreement, np.ones((3, 3)))
    [(0, 1, 0.9), (0, 2, 0.2)]
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
