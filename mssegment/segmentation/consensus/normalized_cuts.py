"""Tracks that begin and end anywhere, strong perspective: partitions by normalised cuts.

Homographies keep bodies apart but split a body with depth; fundamental matrices hold a body
together but let others join that move along its epipolar lines. Both propose partitions, alone and
averaged, also with too many groups that are merged again. The normalised cut in the average picks
a few, and of these the one whose groups are least joined, weighed against the cut: a cut alone
likes halves of one large body. The count is decided on the least cut: the least joined of many
partitions always looks more like separate bodies.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.coassociation import Coassociation
from mssegment.segmentation.consensus.model_order import border_contrast
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen

POWERS = (3, 4, 6)
JUDGE = 4
"""The power of the averaged agreement in which cuts are compared."""
SPARE = 4
"""Partitions into so many groups too many are merged down."""
CONTEST = 8
"""So many partitions with the least normalised cuts are judged by how joined their groups are."""
JOINED = 0.157
"""Two groups are one body if their agreement, over that inside them, by homographies times by
fundamental matrices, times the sixth root of the contrast at the border, is above this."""
FEWEST = 8
"""Tracks without which a group is no body."""


class NormalizedCuts:
    """The partitions of incomplete tracks into 1, 2, 3, ... groups, and the choice among them."""

    def __init__(
        self,
        points: Floats,
        kinds: Mapping[str, Coassociation],
        most: int,
        rng: np.random.Generator,
    ) -> None:
        """``kinds`` by name of evidence; at most ``most`` groups will be asked for."""
        self._kinds = list(kinds.values())
        means = [kind.mean for kind in self._kinds]
        average = np.asarray(np.mean(means, axis=0))
        self._judge = sharpen(average, JUDGE).astype(np.float32)
        self._contrast = np.asarray(means[0], dtype=np.float64)
        seen = np.asarray(np.isfinite(points).all(axis=2))
        total = np.where(seen[..., None], points, 0.0).sum(axis=1)
        place = total / np.maximum(seen.sum(axis=1), 1)[:, None]
        square = (place**2).sum(axis=1)
        self._gaps = np.sqrt(np.maximum(square[:, None] + square - 2 * place @ place.T, 0))
        sources = [*means, average] if len(means) > 1 else means
        self._vectors = [
            embedding(sharpen(source, power), most + SPARE)
            for source in sources
            for power in POWERS
        ]
        self._rng = rng
        self._proposed: dict[int, list[tuple[Integers, Floats]]] = {}
        self._best: dict[int, list[tuple[float, Integers]]] = {}

    def best(self, groups: int) -> Integers:
        """The partition into ``groups`` whose cut is least and least joined, 0..groups-1 [P]."""
        if groups == 1:
            return np.zeros(len(self._judge), dtype=np.int64)
        contest = self._least_cuts(groups)
        return min(contest, key=lambda pair: pair[0] * np.sqrt(self._most_joined(pair[1])))[1]

    def _least_cuts(self, groups: int) -> list[tuple[float, Integers]]:
        """The CONTEST different partitions into ``groups`` with the least normalised cuts."""
        if groups not in self._best:
            found = [
                self._merged(labels, between, groups)
                for more in range(SPARE + 1)
                for labels, between in self._propose(groups + more)
            ]
            different = {labels.tobytes(): (cut, labels) for cut, labels in found}
            self._best[groups] = sorted(different.values(), key=lambda pair: pair[0])[:CONTEST]
        return self._best[groups]

    def count(self, least: int, most: int) -> int:
        """The number of bodies: groups are added as long as no two of them are joined."""
        groups = least
        while groups < most and self._all_apart(groups + 1):
            groups += 1
        return groups

    def joinedness(self, labels: Integers, first: int, second: int) -> float:
        """How much two groups look like one body: about 1 inside a body, near 0 between two."""
        one, two = np.flatnonzero(labels == first), np.flatnonzero(labels == second)
        product = 1.0
        for kind in self._kinds:
            inside = _agreement(kind, one, one) * _agreement(kind, two, two)
            product *= _agreement(kind, one, two) / max(np.sqrt(inside), 1e-12)
        contrast = border_contrast(self._contrast, self._gaps, one, two)
        return float(product * contrast ** (1 / 6))

    def _propose(self, groups: int) -> list[tuple[Integers, Floats]]:
        """Partitions into ``groups``, each with the sums of agreement between its groups."""
        if groups not in self._proposed:
            self._proposed[groups] = []
            for vectors in self._vectors:
                drawn = partition(vectors, groups, self._rng)
                # an empty group leaves a gap in the numbers
                labels = np.unique(drawn, return_inverse=True)[1].ravel()
                member = np.eye(int(labels.max()) + 1, dtype=np.float32)[labels]
                between = member.T @ (self._judge @ member)
                self._proposed[groups].append((labels, between.astype(np.float64)))
        return self._proposed[groups]

    def _merged(self, labels: Integers, between: Floats, groups: int) -> tuple[float, Integers]:
        """Merges the two groups whose union cuts least, until there are ``groups``.

        Gives the normalised cut, the sum over the groups of the agreement that leaves the group
        over all it has, and the labels. The sums between groups say what every merge would cut.
        """
        numbers = np.arange(len(between))
        while len(between) > groups:
            degrees = between.sum(axis=1)
            kept = np.diag(between) / degrees
            merges = {
                (i, j): (between[i, i] + between[j, j] + 2 * between[i, j])
                / (degrees[i] + degrees[j])
                - kept[i]
                - kept[j]
                for i, j in combinations(range(len(between)), 2)
            }
            i, j = max(merges, key=lambda pair: merges[pair])
            join = np.delete(np.eye(len(between)), j, axis=1)
            join[j, i] = 1
            between = join.T @ between @ join
            numbers = np.where(numbers == j, i, numbers - (numbers > j))
        cut = float((1 - np.diag(between) / between.sum(axis=1)).sum())
        return cut, np.asarray(numbers[labels])

    def _most_joined(self, labels: Integers) -> float:
        """The largest ``joinedness`` of two groups; 1, as inside a body, for a tiny group."""
        sizes = np.bincount(labels)
        if len(sizes) < 2 or sizes.min() < FEWEST:
            return 1.0
        return max(self.joinedness(labels, *pair) for pair in combinations(range(len(sizes)), 2))

    def _all_apart(self, groups: int) -> bool:
        _, labels = self._least_cuts(groups)[0]
        return int(labels.max()) + 1 == groups and self._most_joined(labels) < JOINED


def _agreement(kind: Coassociation, rows: Integers, columns: Integers) -> float:
    """Mean agreement of the tracks ``rows`` with ``columns``, over the sets they share."""
    block = np.ix_(rows, columns)
    return float(kind.agreement[block].sum() / max(float(kind.shared[block].sum()), 1.0))
