"""Complete tracks: which partition describes them best, and into how many bodies.

A body is a Student t distribution in the leading principal components of the tracks. The cost of a
partition picks among those of one count; whether two groups are one body is decided by what their
union would cost, against how well the tracks at their common border agree.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.geometry.flats import principal_components
from mssegment.geometry.robust import StudentT, StudentTFit, hard_em
from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen

LEAST_SPREAD = 0.5
"""Standard deviation, in units, below which differences say nothing."""
FREEDOM = 5.0
"""Degrees of freedom of the Student t distribution."""
EM_ROUNDS = 12
SMALL_CHANGE = 0.1
"""Refinement by the distributions is taken if no more than this share of the tracks changes."""
POWERS = (4, 6, 8)
"""Powers of the agreement that are partitioned; the cost chooses."""
DISTINCT = 140.0
"""Two groups are two bodies if (cost of the union - cost apart) / sqrt(tracks), over the cube root
of the contrast at the border, is above this."""
BORDER_TRACKS, BORDER_SHARE = 8, 4
FEWEST = 5
"""Tracks without which a group is no body."""


def student_t_costs(fitted: StudentT, dimensions: int) -> Floats:
    """Description length of each track in each group [G, P] (nats, twice, up to a constant).

    (D + 5) ln(1 + q / 5) + ln|S|, where q is the squared Mahalanobis distance.
    """
    tails = np.log1p(fitted.squared / FREEDOM)
    return np.asarray((dimensions + FREEDOM) * tails + fitted.log_det[:, None])


def group_cost(components: Floats, total: int) -> float:
    """Description length of a group of tracks [n, D] out of ``total``.

    The sum of ``student_t_costs``, and - 2 ln(n / ``total``) per track.
    """
    count, dimensions = components.shape
    fitted = StudentTFit(components, FREEDOM, LEAST_SPREAD)(np.ones((1, count)))
    costs = student_t_costs(fitted, dimensions)
    return float(costs.sum() - 2 * count * np.log(count / total))


def partition_cost(components: Floats, labels: Integers) -> float:
    """Sum of ``group_cost`` over the groups of ``labels`` [P]."""
    return sum(group_cost(components[labels == group], len(labels)) for group in np.unique(labels))


def refine(components: Floats, labels: Integers) -> Integers:
    """Hard expectation maximization of labels 0.. [P]; groups below FEWEST tracks dissolve."""
    fit = StudentTFit(components, FREEDOM, LEAST_SPREAD)

    def costs(members: Floats) -> Floats:
        shares = members.mean(axis=1, keepdims=True)
        fitted = student_t_costs(fit(members), components.shape[1])
        return np.asarray(fitted - 2 * np.log(shares))

    return hard_em(labels, costs, EM_ROUNDS, FEWEST)


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
        saved = group_cost(self._components[both], total) - sum(
            group_cost(self._components[group], total) for group in (first, second)
        )
        contrast = border_contrast(self._pairwise, self._gaps, first, second)
        return float(max(saved, 0.0) / np.sqrt(total) / np.cbrt(contrast))
