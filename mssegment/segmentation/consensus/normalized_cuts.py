"""Incomplete tracks under strong perspective: partitions by normalized cuts.

Homographies separate objects but split an object with depth; fundamental matrices keep an object
together but include others that move along its epipolar lines. Both propose partitions, alone and
averaged, also with too many groups that are then merged. The partitions with the least normalized
cut in the average are candidates. The candidate with the least product of cut and root of the
largest joinedness is selected, because the cut alone favours halves of one large object. The number
of groups is decided on the least cut: the least joined of many partitions always looks more
separate than it is.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.geometry.robust import relabelled
from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.border import border_contrast
from mssegment.segmentation.consensus.coassociation import Coassociation
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen

POWERS = (3, 4, 6)
"""Powers of the agreement that are partitioned."""
AVERAGE_POWER = 4
"""Power of the average agreement in which cuts are compared."""
EXTRA_GROUPS = 4
"""Partitions with up to this many groups too many are merged."""
CONTENDERS = 8
"""Number of partitions, those with the least normalized cuts, whose joinedness is computed."""
JOINED_LIMIT = 0.157
"""Two groups are one object if their ``joinedness`` is above this."""
MIN_GROUP_SIZE = 8
"""Smallest number of tracks of a group."""


class NormalizedCuts:
    """Partitions of incomplete tracks into 1, 2, 3, ... groups, and the choice among them.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    kinds : mapping of str to Coassociation
        Agreement for each model.
    most : int
        Largest number of groups.
    rng : numpy.random.Generator
        Source of random numbers.

    References
    ----------
    Shi and Malik, Normalized cuts and image segmentation, 2000.
    """

    def __init__(
        self,
        points: Floats,
        kinds: Mapping[str, Coassociation],
        most: int,
        rng: np.random.Generator,
    ) -> None:
        self._kinds = list(kinds.values())
        means = [kind.mean for kind in self._kinds]
        average = np.asarray(np.mean(means, axis=0))
        self._affinity = sharpen(average, AVERAGE_POWER).astype(np.float32)
        self._pairwise = np.asarray(means[0], dtype=np.float64)
        visible = np.asarray(np.isfinite(points).all(axis=2))
        total = np.where(visible[..., None], points, 0.0).sum(axis=1)
        position = total / np.maximum(visible.sum(axis=1), 1)[:, None]
        square = (position**2).sum(axis=1)
        self._distances = np.sqrt(
            np.maximum(square[:, None] + square - 2 * position @ position.T, 0)
        )
        sources = [*means, average] if len(means) > 1 else means
        self._vectors = [
            embedding(sharpen(source, power), most + EXTRA_GROUPS)
            for source in sources
            for power in POWERS
        ]
        self._rng = rng
        self._proposed: dict[int, list[tuple[Integers, Floats]]] = {}
        self._best: dict[int, list[tuple[float, Integers]]] = {}

    def best(self, groups: int) -> Integers:
        """The best partition into ``groups`` by cut and joinedness, labels 0..groups-1 [P]."""
        if groups == 1:
            return np.zeros(len(self._affinity), dtype=np.int64)
        contenders = self._least_cuts(groups)
        return min(contenders, key=lambda pair: pair[0] * np.sqrt(self._max_joinedness(pair[1])))[1]

    def _least_cuts(self, groups: int) -> list[tuple[float, Integers]]:
        """The distinct partitions into ``groups`` with the least normalized cuts."""
        if groups not in self._best:
            found = [
                self._merged(labels, between, groups)
                for extra in range(EXTRA_GROUPS + 1)
                for labels, between in self._propose(groups + extra)
            ]
            distinct = {labels.tobytes(): (cut, labels) for cut, labels in found}
            self._best[groups] = sorted(distinct.values(), key=lambda pair: pair[0])[:CONTENDERS]
        return self._best[groups]

    def count(self, least: int, most: int) -> int:
        """The number of groups: groups are added as long as no two of them are joined."""
        groups = least
        while groups < most and self._all_separate(groups + 1):
            groups += 1
        return groups

    def joinedness(self, labels: Integers, first: int, second: int) -> float:
        """How much two groups look like one object: about 1 inside an object, near 0 between two.

        The product over the models of their agreement relative to that within each, times the sixth
        root of the contrast at the border.
        """
        one, two = np.flatnonzero(labels == first), np.flatnonzero(labels == second)
        product = 1.0
        for kind in self._kinds:
            inside = _agreement(kind, one, one) * _agreement(kind, two, two)
            product *= _agreement(kind, one, two) / max(np.sqrt(inside), 1e-12)
        contrast = border_contrast(self._pairwise, self._distances, one, two)
        return float(product * contrast ** (1 / 6))

    def _propose(self, groups: int) -> list[tuple[Integers, Floats]]:
        """Partitions into ``groups``, each with the sums of the affinity between its groups."""
        if groups not in self._proposed:
            self._proposed[groups] = []
            for vectors in self._vectors:
                drawn = partition(vectors, groups, self._rng)
                # some groups may be empty
                labels = relabelled(drawn)
                member = np.eye(int(labels.max()) + 1, dtype=np.float32)[labels]
                between = member.T @ (self._affinity @ member)
                self._proposed[groups].append((labels, between.astype(np.float64)))
        return self._proposed[groups]

    def _merged(self, labels: Integers, between: Floats, groups: int) -> tuple[float, Integers]:
        """Merge the two groups whose union increases the cut least, until there are ``groups``.

        Returns the normalized cut (the sum over the groups of the affinity that leaves the group,
        relative to all of its affinity) and the labels. The sums ``between`` groups determine the
        cut of every merge.
        """
        merged = np.arange(len(between))
        while len(between) > groups:
            degrees = between.sum(axis=1)
            inside = np.diag(between) / degrees
            gains = {
                (i, j): (between[i, i] + between[j, j] + 2 * between[i, j])
                / (degrees[i] + degrees[j])
                - inside[i]
                - inside[j]
                for i, j in combinations(range(len(between)), 2)
            }
            i, j = max(gains, key=lambda pair: gains[pair])
            join = np.delete(np.eye(len(between)), j, axis=1)
            join[j, i] = 1
            between = join.T @ between @ join
            merged = np.where(merged == j, i, merged - (merged > j))
        cut = float((1 - np.diag(between) / between.sum(axis=1)).sum())
        return cut, np.asarray(merged[labels])

    def _max_joinedness(self, labels: Integers) -> float:
        """The largest ``joinedness`` of two groups; 1, as inside an object, for a small group."""
        sizes = np.bincount(labels)
        if len(sizes) < 2 or sizes.min() < MIN_GROUP_SIZE:
            return 1.0
        return max(self.joinedness(labels, *pair) for pair in combinations(range(len(sizes)), 2))

    def _all_separate(self, groups: int) -> bool:
        """Whether no two groups of the least cut are joined."""
        _, labels = self._least_cuts(groups)[0]
        return int(labels.max()) + 1 == groups and self._max_joinedness(labels) < JOINED_LIMIT


def _agreement(kind: Coassociation, rows: Integers, columns: Integers) -> float:
    """Mean agreement of the tracks ``rows`` with ``columns`` over the sets that apply to both."""
    block = np.ix_(rows, columns)
    return float(kind.agreement[block].sum() / max(float(kind.shared[block].sum()), 1.0))
