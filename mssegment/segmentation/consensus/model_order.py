"""Complete tracks: which partition describes them best, and into how many bodies.

A body is a Student-t cloud in the leading principal components of the tracks. The cost of a
partition picks among those of one count; whether two groups are one body is decided by what their
union would cost, against how well the tracks at their common border agree.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.records import Floats, Integers, Record
from mssegment.sampling.validation import extent
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen

DIMENSIONS = 12
"""Principal components of the tracks."""
UNIT = 160.0
"""The tracks spread over so many units (pixels of a picture of 640, roughly)."""
LEAST_SPREAD = 0.5
"""Standard deviation, in units, below which differences say nothing."""
FREEDOM = 5.0
"""Degrees of freedom of the Student-t cloud."""
ROUNDS = 3
EM_ROUNDS = 12
SMALL_CHANGE = 0.1
"""A partition is refined by the clouds if no more than this share of the tracks changes group."""
POWERS = (4, 6, 8)
"""Powers of the agreement that are partitioned; the cost chooses."""
DISTINCT = 140.0
"""Two groups are two bodies if (cost of the union - cost apart) / sqrt(tracks), over the cube root
of the contrast at the border, is above this."""
BORDER_TRACKS, BORDER_SHARE = 8, 4
FEWEST = 5
"""Tracks without which a group is no body."""


def principal_components(points: Floats) -> Floats:
    """The tracks [P, F, 2] in DIMENSIONS leading principal components, in units, [P, D]."""
    vectors = points.reshape(len(points), -1)
    vectors = (vectors - vectors.mean(axis=0)) * (UNIT / extent(points))
    _, directions = np.linalg.eigh(vectors.T @ vectors)
    return np.asarray(vectors @ directions[:, : -DIMENSIONS - 1 : -1])


class Cloud(Record, frozen=True):
    """A robust Student-t cloud: ``middle`` [D], the Cholesky factor ``lower`` [D, D] of its S."""

    middle: Floats
    lower: Floats

    @classmethod
    def fitted(cls, components: Floats) -> Cloud:
        """To the tracks [n, D], reweighted for outlying ones."""
        count, dimensions = components.shape
        weights = np.ones(count)
        for _ in range(ROUNDS):
            middle = weights @ components / weights.sum()
            centred = components - middle
            covariance = (weights[:, None] * centred).T @ centred / count
            covariance += LEAST_SPREAD**2 * np.eye(dimensions)
            cloud = cls(middle, np.linalg.cholesky(covariance))
            weights = (dimensions + FREEDOM) / (FREEDOM + cloud.squared_distances(components))
        return cloud

    def squared_distances(self, components: Floats) -> Floats:
        """Squared Mahalanobis distances of the tracks [n, D]."""
        return np.asarray(
            (np.linalg.solve(self.lower, (components - self.middle).T) ** 2).sum(axis=0)
        )

    def costs(self, components: Floats) -> Floats:
        """Description length of each track (nats, up to a constant): (D + 5) ln(1 + q / 5) + ln|S|,
        q its squared Mahalanobis distance.
        """
        tails = np.log1p(self.squared_distances(components) / FREEDOM)
        spread = 2 * np.log(np.diag(self.lower)).sum()
        return np.asarray((components.shape[1] + FREEDOM) * tails + spread)


def cloud_cost(components: Floats, total: int) -> float:
    """Description length (nats) of a group of tracks [n, D] out of ``total``, as a cloud.

    The sum of ``Cloud.costs``, and - 2 ln(n / ``total``) per track.
    """
    count = len(components)
    costs = Cloud.fitted(components).costs(components)
    return float(costs.sum() - 2 * count * np.log(count / total))


def partition_cost(components: Floats, labels: Integers) -> float:
    """Sum of ``cloud_cost`` over the groups of ``labels`` [P]."""
    return sum(cloud_cost(components[labels == group], len(labels)) for group in np.unique(labels))


def refine(components: Floats, labels: Integers) -> Integers:
    """Hard expectation maximization of labels 0.. [P]; groups below FEWEST tracks dissolve."""
    for _ in range(EM_ROUNDS):
        names, sizes = np.unique(labels, return_counts=True)
        names = names[sizes >= FEWEST]
        if not len(names):
            return np.zeros(len(labels), dtype=np.int64)
        costs = np.stack(
            [
                Cloud.fitted(components[labels == name]).costs(components)
                - 2 * np.log((labels == name).mean())
                for name in names
            ]
        )
        found = names[costs.argmin(axis=0)]
        if np.array_equal(found, labels):
            break
        labels = found
    return np.unique(labels, return_inverse=True)[1].ravel()


def border_contrast(agreement: Floats, gaps: Floats, first: Integers, second: Integers) -> float:
    """How well two groups agree where they meet, against how well each agrees at such a distance.

    About 1 inside one body, near 0 between two. ``agreement`` and the distances ``gaps`` are
    [P, P]; the quarter of the smaller group nearest to the other is asked.
    """
    small, large = (first, second) if len(first) <= len(second) else (second, first)
    across = gaps[np.ix_(small, large)]
    count = min(BORDER_TRACKS, len(large))
    partners = np.argpartition(across, count - 1, axis=1)[:, :count]
    distance = np.take_along_axis(across, partners, axis=1).mean(axis=1)
    border = distance.argsort(kind="stable")[: max(FEWEST, len(small) // BORDER_SHARE)]
    between = agreement[small[border][:, None], large[partners[border]]].mean()
    within = np.abs(gaps[np.ix_(small[border], small)] - distance[border, None])
    within[np.arange(len(border)), border] = np.inf
    count = min(BORDER_TRACKS, len(small) - 1)
    partners = np.argpartition(within, count - 1, axis=1)[:, :count]
    inside = agreement[small[border][:, None], small[partners]].mean()
    return float((between + 1e-3) / (inside + 1e-3))


class PartitionSearch:
    """The partitions of complete tracks into 1, 2, 3, ... groups, and the choice among them."""

    def __init__(
        self,
        points: Floats,
        agreements: Mapping[str, Floats],
        most: int,
        rng: np.random.Generator,
    ) -> None:
        """``agreements`` [P, P] by kind of evidence; at most ``most`` groups will be asked for."""
        self._pairwise = next(iter(agreements.values()))
        combined = np.mean(list(agreements.values()), axis=0)
        self._components = principal_components(points)
        place = points.mean(axis=1)
        square = (place**2).sum(axis=1)
        self._gaps = np.sqrt(np.maximum(square[:, None] + square - 2 * place @ place.T, 0))
        self._vectors = [embedding(sharpen(combined, power), most) for power in POWERS]
        self._rng = rng
        self._best: dict[int, Integers] = {}

    def best(self, groups: int) -> Integers:
        """The partition into ``groups`` that costs least, labels 0..groups-1 [P]."""
        if groups not in self._best:
            found = [partition(vectors, groups, self._rng) for vectors in self._vectors]
            if groups > 1:
                found.sort(key=lambda labels: partition_cost(self._components, labels))
            self._best[groups] = self._refined(found[0], groups)
        return self._best[groups]

    def _refined(self, labels: Integers, groups: int) -> Integers:
        found = refine(self._components, labels) if groups > 1 else labels
        same = found.max() + 1 == groups and (found != labels).mean() <= SMALL_CHANGE
        return found if same else labels

    def count(self, least: int, most: int) -> int:
        """The number of bodies: groups are added as long as all of them are distinct."""
        groups = least
        while groups < most and self.distinctness(self.best(groups + 1), groups + 1) > DISTINCT:
            groups += 1
        return groups

    def distinctness(self, labels: Integers, groups: int) -> float:
        """Of the two groups that are most like one body; 0 where a group is too small."""
        members = [np.flatnonzero(labels == group) for group in range(groups)]
        if min(map(len, members)) < FEWEST:
            return 0.0
        return min(self._apart(*pair) for pair in combinations(members, 2))

    def _apart(self, first: Integers, second: Integers) -> float:
        both = np.concatenate([first, second])
        total = len(both)
        saved = cloud_cost(self._components[both], total) - sum(
            cloud_cost(self._components[group], total) for group in (first, second)
        )
        contrast = border_contrast(self._pairwise, self._gaps, first, second)
        return float(max(saved, 0.0) / np.sqrt(total) / np.cbrt(contrast))
