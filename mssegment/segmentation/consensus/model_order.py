"""Complete tracks: which partition describes them best, and with how many groups.

A group is a Student t distribution in the leading principal components of the tracks. The cost of a
partition selects among those with the same number of groups. Whether two groups are one motion is
decided by how much more their union costs, relative to how well the tracks at their border agree.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.geometry.flats import principal_components
from mssegment.geometry.robust import StudentT, StudentTFit, hard_em
from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen

MIN_SPREAD = 0.5
"""Standard deviation, in the units of the components, below which differences are not
significant."""
DEGREES_OF_FREEDOM = 5.0
"""Of the Student t distribution."""
EM_ROUNDS = 12
MAX_REFINED_SHARE = 0.1
"""A refined partition is accepted if at most this share of the labels changes."""
POWERS = (4, 6, 8)
"""Powers of the agreement that are partitioned; the cost selects one."""
MIN_DISTINCTNESS = 140.0
"""Two groups are distinct if (cost of the union - cost of both) / sqrt(tracks) / cbrt(contrast
at the border) exceeds this."""
BORDER_NEIGHBOURS, BORDER_FRACTION = 8, 4
"""Neighbours of a track across the border; the border is 1 / BORDER_FRACTION of the smaller
group."""
MIN_GROUP_SIZE = 5
"""Smallest number of tracks of a group."""


def student_t_costs(fitted: StudentT, dimensions: int) -> Floats:
    """Twice the description length of each track in each group [G, P], in nats, up to a constant.

    (D + nu) ln(1 + q / nu) + ln|S|, where q is the squared Mahalanobis distance and nu the degrees
    of freedom.
    """
    tails = np.log1p(fitted.squared / DEGREES_OF_FREEDOM)
    return np.asarray((dimensions + DEGREES_OF_FREEDOM) * tails + fitted.log_det[:, None])


def group_cost(components: Floats, total: int) -> float:
    """Twice the description length in nats of a group of tracks [n, D] out of ``total``.

    The sum of ``student_t_costs``, and - 2 ln(n / ``total``) per track for its label.
    """
    count, dimensions = components.shape
    fitted = StudentTFit(components, DEGREES_OF_FREEDOM, MIN_SPREAD)(np.ones((1, count)))
    costs = student_t_costs(fitted, dimensions)
    return float(costs.sum() - 2 * count * np.log(count / total))


def partition_cost(components: Floats, labels: Integers) -> float:
    """Sum of ``group_cost`` over the groups of ``labels`` [P]."""
    return sum(group_cost(components[labels == group], len(labels)) for group in np.unique(labels))


def refine(components: Floats, labels: Integers) -> Integers:
    """Refine labels 0, 1, ... [P] by hard EM; groups below ``MIN_GROUP_SIZE`` are dissolved."""
    fit = StudentTFit(components, DEGREES_OF_FREEDOM, MIN_SPREAD)

    def costs(members: Floats) -> Floats:
        shares = members.mean(axis=1, keepdims=True)
        fitted = student_t_costs(fit(members), components.shape[1])
        return np.asarray(fitted - 2 * np.log(shares))

    return hard_em(labels, costs, EM_ROUNDS, MIN_GROUP_SIZE)


def border_contrast(
    agreement: Floats, distances: Floats, first: Integers, second: Integers
) -> float:
    """How well two groups agree at their border, relative to the agreement within a group.

    The agreement of tracks with neighbours across the border is compared with that of tracks of one
    group at the same distance, for the quarter of the smaller group that is nearest to the other.

    Parameters
    ----------
    agreement : ndarray [P, P]
        Agreement of pairs of tracks.
    distances : ndarray [P, P]
        Distances of their positions, in pixels.
    first, second : ndarray of int
        The tracks of the two groups.

    Returns
    -------
    float
        About 1 inside one object, near 0 between two.
    """
    small, large = (first, second) if len(first) <= len(second) else (second, first)
    across = distances[np.ix_(small, large)]
    count = min(BORDER_NEIGHBOURS, len(large))
    neighbours = np.argpartition(across, count - 1, axis=1)[:, :count]
    distance = np.take_along_axis(across, neighbours, axis=1).mean(axis=1)
    border = distance.argsort(kind="stable")[: max(MIN_GROUP_SIZE, len(small) // BORDER_FRACTION)]
    between = agreement[small[border][:, None], large[neighbours[border]]].mean()
    within = np.abs(distances[np.ix_(small[border], small)] - distance[border, None])
    within[np.arange(len(border)), border] = np.inf
    count = min(BORDER_NEIGHBOURS, len(small) - 1)
    neighbours = np.argpartition(within, count - 1, axis=1)[:, :count]
    inside = agreement[small[border][:, None], small[neighbours]].mean()
    return float((between + 1e-3) / (inside + 1e-3))


class SpectralClustering:
    """Partitions of complete tracks into 1, 2, 3, ... groups, and the choice among them.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Complete tracks in pixels.
    agreements : mapping of str to ndarray [P, P]
        Mean agreement for each model.
    most : int
        Largest number of groups.
    rng : numpy.random.Generator
        Source of random numbers.
    """

    def __init__(
        self,
        points: Floats,
        agreements: Mapping[str, Floats],
        most: int,
        rng: np.random.Generator,
    ) -> None:
        self._pairwise = next(iter(agreements.values()))
        combined = np.mean(list(agreements.values()), axis=0)
        self._components = principal_components(points)
        position = points.mean(axis=1)
        square = (position**2).sum(axis=1)
        self._distances = np.sqrt(
            np.maximum(square[:, None] + square - 2 * position @ position.T, 0)
        )
        self._vectors = [embedding(sharpen(combined, power), most) for power in POWERS]
        self._rng = rng
        self._best: dict[int, Integers] = {}

    def best(self, groups: int) -> Integers:
        """The partition of least cost into ``groups``, labels 0..groups-1 [P]."""
        if groups not in self._best:
            found = [partition(vectors, groups, self._rng) for vectors in self._vectors]
            if groups > 1:
                found.sort(key=lambda labels: partition_cost(self._components, labels))
            self._best[groups] = self._refined(found[0], groups)
        return self._best[groups]

    def _refined(self, labels: Integers, groups: int) -> Integers:
        """The refined labels, unless too many of them change, or the number of groups."""
        found = refine(self._components, labels) if groups > 1 else labels
        similar = found.max() + 1 == groups and (found != labels).mean() <= MAX_REFINED_SHARE
        return found if similar else labels

    def count(self, least: int, most: int) -> int:
        """The number of groups: groups are added as long as all of them are distinct."""
        groups = least
        while groups < most:
            if self.distinctness(self.best(groups + 1), groups + 1) <= MIN_DISTINCTNESS:
                break
            groups += 1
        return groups

    def distinctness(self, labels: Integers, groups: int) -> float:
        """Distinctness of the two most similar groups; 0 if a group is too small."""
        members = [np.flatnonzero(labels == group) for group in range(groups)]
        if min(map(len, members)) < MIN_GROUP_SIZE:
            return 0.0
        return min(self._pair_distinctness(*pair) for pair in combinations(members, 2))

    def _pair_distinctness(self, first: Integers, second: Integers) -> float:
        """Distinctness of two groups, given as indices of tracks."""
        union = np.concatenate([first, second])
        total = len(union)
        saved = group_cost(self._components[union], total) - sum(
            group_cost(self._components[group], total) for group in (first, second)
        )
        contrast = border_contrast(self._pairwise, self._distances, first, second)
        return float(max(saved, 0.0) / np.sqrt(total) / np.cbrt(contrast))
