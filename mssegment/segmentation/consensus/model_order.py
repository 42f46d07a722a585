"""Complete tracks: which partition describes them best, and with how many groups.

A group is a Student t distribution in the leading principal components of the tracks. The cost of a
partition selects among those with the same number of groups. Whether two groups are one motion is
decided by R, how much more their union costs than its border explains (``SplitTest``), and by the
stronger of two facts about rigid motion: G, how much their residuals grow when both must have one
epipolar geometry, which is exact under perspective, and N, the evidence for two rigid bodies over
all frames, which is the stronger one in noise. Their separation is
R max(exp(G), (1 + N / N0)^(1/3)).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations

import numpy as np

from mssegment.geometry.flats import principal_components
from mssegment.geometry.robust import StudentT, StudentTFit, hard_em
from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.epipolar_evidence import EpipolarEvidence
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen
from mssegment.segmentation.consensus.split_test import SplitTest, nearest_of_each
from mssegment.segmentation.consensus.windowed_split import WindowedSplitTest

MIN_SPREAD = 0.5
"""Standard deviation, in the units of the components, below which differences are not
significant."""
DEGREES_OF_FREEDOM = 5.0
"""Of the Student t distribution."""
EM_ROUNDS = 12
"""Largest number of rounds of hard expectation maximization."""
MAX_REFINED_SHARE = 0.1
"""A refined partition is accepted if at most this share of the labels changes."""
POWERS = (4, 6, 8)
"""Powers of the agreement that are partitioned; the cost selects one."""
LOOK_AHEAD = 3
"""Numbers of groups beyond the present one that are examined: one more group may cut a motion in
two where two more find the next one."""
MIN_GROUP_SIZE = 5
"""Smallest number of tracks of a group."""
EPIPOLAR_GAPS = (0.1, 0.25, 0.5)
"""Gaps of the frame pairs of the epipolar geometry, as shares of the frames."""
PAIRS_PER_GAP = 6
"""Number of frame pairs of each gap, evenly spaced."""
DOUBT = 3.0
"""N0 in nats: odds of 20 to 1, the usual level of a test. (On random scenes and Hopkins155 the
number is right in 90.4 %; at 2 and 5 nats in 90.0 and 89.7 %, without N in 87.9 %.)"""
LEAST_SEPARATION = 1.5
"""Two groups are two motions if their separation is larger (chosen on random scenes and Hopkins155,
half of each, without N; at 1 and 2 the mean share of right numbers falls by less than two
points)."""
TRACKS_PER_PIECE, MOST_PIECES = 12, 8
"""The noise of the epipolar geometry is measured in pieces of so many tracks or more."""


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
    smallest : float
        Fewest tracks of a motion.
    rng : numpy.random.Generator
        Source of random numbers.
    """

    def __init__(
        self,
        points: Floats,
        agreements: Mapping[str, Floats],
        most: int,
        smallest: float,
        rng: np.random.Generator,
    ) -> None:
        self._smallest = smallest
        self._pairwise = next(iter(agreements.values()))
        combined = np.mean(list(agreements.values()), axis=0)
        self._components = principal_components(points)
        position = points.mean(axis=1)
        square = (position**2).sum(axis=1)
        self._distances = np.sqrt(
            np.maximum(square[:, None] + square - 2 * position @ position.T, 0)
        )
        self._vectors = [embedding(sharpen(combined, power), most) for power in POWERS]
        self._points, self._rng = points, rng
        self._best: dict[int, Integers] = {}
        self._tests: dict[bool, SplitTest] = {}
        self._evidence: EpipolarEvidence | None = None

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
        """The number of groups: more are made as long as all of them are apart.

        Groups of fewer than ``smallest`` tracks are outliers, which do not count.
        """
        groups = least
        while groups < most:
            ahead = range(groups + 1, min(groups + LOOK_AHEAD, most) + 1)
            single = len(self._large(groups)) <= 1
            apart = (
                n
                for n in ahead
                if len(self._large(n)) > len(self._large(groups)) and self.apart(n, single=single)
            )
            found = next(apart, None)
            if found is None:
                break
            groups = found
        return groups

    def _large(self, groups: int) -> list[Integers]:
        """The tracks of each group that is no outlier, in the partition into ``groups``."""
        labels = self.best(groups)
        members = [np.flatnonzero(labels == group) for group in range(groups)]
        return [own for own in members if len(own) >= self._smallest]

    def separations(self, groups: int) -> list[float]:
        """The separation of each of the ``groups`` from its nearest neighbour, over its limit."""
        labels = self.best(groups)
        members = [np.flatnonzero(labels == group) for group in range(int(labels.max()) + 1)]
        test = self._test(single=groups == 2)

        def separation(first: Integers, second: Integers) -> float:
            factor = max(rigid_factor(test, first, second), self._growth(first, second))
            return test.ratio(first, second) * factor / LEAST_SEPARATION

        return nearest_of_each(members, separation)

    def apart(self, groups: int, *, single: bool) -> bool:
        """Whether every two large groups are two motions.

        The pairs that agree most come first: they are the likeliest to be one motion.
        """
        test = self._test(single=single)
        pairs = list(combinations(self._large(groups), 2))
        pairs.sort(key=lambda pair: -float(self._pairwise[np.ix_(*pair)].mean()))
        # residuals never shrink: where R is large enough, the geometry need not be fitted
        return all(
            (ratio := test.ratio(*pair)) > LEAST_SEPARATION
            or ratio * rigid_factor(test, *pair) > LEAST_SEPARATION
            or ratio * self._growth(*pair) > LEAST_SEPARATION
            for pair in pairs
        )

    def _growth(self, first: Integers, second: Integers) -> float:
        """exp(G), at least 1: the factor by which one epipolar geometry makes residuals grow."""
        if self._evidence is None:
            pieces = max(min(MOST_PIECES, len(self._points) // TRACKS_PER_PIECE), 1)
            labels = self.best(pieces)
            self._evidence = EpipolarEvidence(self._points, epipolar_pairs(self._points.shape[1]))
            self._evidence.measure_noise([np.flatnonzero(labels == k) for k in np.unique(labels)])
        return math.exp(self._evidence.growth(first, second))

    def _test(self, *, single: bool) -> SplitTest:
        if single not in self._tests:
            known = self._tests.get(not single)
            self._tests[single] = (
                known.deciding(single=single)
                if known
                else SplitTest(self._points, self._pairwise, self._distances, single=single)
            )
        return self._tests[single]


def rigid_factor(test: SplitTest | WindowedSplitTest, first: Integers, second: Integers) -> float:
    """The cube root of 1 + N / N0, by which rigid motion over all frames tells groups apart."""
    return float(np.cbrt(1 + test.rigid_evidence(first, second) / DOUBT))


def epipolar_pairs(frames: int) -> list[tuple[int, int]]:
    """Pairs of frames between which the epipolar geometry of complete tracks is fitted."""
    found = []
    for gap in sorted({max(1, round(share * frames)) for share in EPIPOLAR_GAPS}):
        starts = np.unique(np.linspace(0, frames - 1 - gap, PAIRS_PER_GAP).round().astype(int))
        found += [(start, start + gap) for start in starts.tolist()]
    return found
