"""Tracks that begin and end anywhere, strong perspective: partitions by normalised cuts.

Homographies keep bodies apart but split a body with depth; fundamental matrices hold a body
together but let others join that move along its epipolar lines. Both propose partitions, alone and
averaged, also with too many groups that are merged again; the normalised cut in the average picks.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.bodies import border_contrast
from mssegment.segmentation.consensus.comembership import CoMembership
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen

POWERS = (3, 4, 6)
JUDGE = 4
"""The power of the averaged agreement in which cuts are compared."""
SPARE = 2
"""Partitions into so many groups too many are merged down."""
JOINED = 0.157
"""Two groups are one body if their agreement, over that inside them, by homographies times by
fundamental matrices, times the sixth root of the contrast at the border, is above this."""
FEWEST = 8
"""Tracks without which a group is no body."""


class Cuts:
    """The partitions of incomplete tracks into 1, 2, 3, ... groups, and the choice among them."""

    def __init__(
        self,
        points: Floats,
        kinds: Mapping[str, CoMembership],
        most: int,
        rng: np.random.Generator,
    ) -> None:
        """``kinds`` by name of evidence; at most ``most`` groups will be asked for."""
        self._kinds = list(kinds.values())
        means = [kind.mean for kind in self._kinds]
        average = np.asarray(np.mean(means, axis=0))
        self._judge = sharpen(average, JUDGE)
        self._degrees = self._judge.sum(axis=1)
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
        self._proposed: dict[int, list[Integers]] = {}
        self._best: dict[int, Integers] = {}

    def best(self, groups: int) -> Integers:
        """The partition into ``groups`` with the least normalised cut, labels 0..groups-1 [P]."""
        if groups not in self._best:
            if groups == 1:
                return np.zeros(len(self._judge), dtype=np.int64)
            found = [
                self._merged(labels, groups)
                for more in range(SPARE + 1)
                for labels in self._propose(groups + more)
            ]
            self._best[groups] = min(found, key=self.normalised_cut)
        return self._best[groups]

    def count(self, least: int, most: int) -> int:
        """The number of bodies: groups are added as long as no two of them are joined."""
        groups = least
        while groups < most and self._all_apart(self.best(groups + 1), groups + 1):
            groups += 1
        return groups

    def normalised_cut(self, labels: Integers) -> float:
        """Sum over the groups of the agreement that leaves the group, over all it has."""
        groups = int(labels.max()) + 1
        member = np.eye(groups)[labels]
        inside = np.einsum("pg,pg->g", self._judge @ member, member)
        return float((1 - inside / np.maximum(self._degrees @ member, 1e-30)).sum())

    def joinedness(self, labels: Integers, first: int, second: int) -> float:
        """How much two groups look like one body: about 1 inside a body, near 0 between two."""
        one, two = np.flatnonzero(labels == first), np.flatnonzero(labels == second)
        product = 1.0
        for kind in self._kinds:
            inside = _agreement(kind, one, one) * _agreement(kind, two, two)
            product *= _agreement(kind, one, two) / max(np.sqrt(inside), 1e-12)
        contrast = border_contrast(self._contrast, self._gaps, one, two)
        return float(product * contrast ** (1 / 6))

    def _propose(self, groups: int) -> list[Integers]:
        if groups not in self._proposed:
            drawn = [partition(vectors, groups, self._rng) for vectors in self._vectors]
            # an empty group leaves a gap in the numbers
            self._proposed[groups] = [
                np.unique(labels, return_inverse=True)[1].ravel() for labels in drawn
            ]
        return self._proposed[groups]

    def _merged(self, labels: Integers, groups: int) -> Integers:
        """Merges the two groups whose union cuts least, until there are ``groups``.

        The sums between groups say what every merge would cut.
        """
        member = np.eye(int(labels.max()) + 1)[labels]
        between = member.T @ self._judge @ member
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
        return np.asarray(numbers[labels])

    def _all_apart(self, labels: Integers, groups: int) -> bool:
        if np.bincount(labels, minlength=groups).min() < FEWEST:
            return False
        pairs = combinations(range(groups), 2)
        return all(self.joinedness(labels, *pair) < JOINED for pair in pairs)


def _agreement(kind: CoMembership, rows: Integers, columns: Integers) -> float:
    """Mean agreement of the tracks ``rows`` with ``columns``, over the sets they share."""
    block = np.ix_(rows, columns)
    return float(kind.agreement[block].sum() / max(float(kind.shared[block].sum()), 1.0))
