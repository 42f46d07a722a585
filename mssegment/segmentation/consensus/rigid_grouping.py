"""Incomplete tracks and strong perspective: groups that are joined until each is one rigid object.

Homographies separate objects, but cut an object with depth; fundamental matrices keep an object
together, but with others that move along its epipolar lines. Spectral partitions of the agreement
on homographies, and on both, into more pieces than there are objects are starts. From each the two
groups of largest ``Joinedness`` are joined, again and again. Among the partitions into K groups,
one from each start, that with the shortest description by epipolar geometry is chosen, and each
track joins the group that describes it best. There are more motions as long as every split of the
next partition saves more than its price, which is higher the more joined the two groups look.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from mssegment.geometry.robust import hard_em
from mssegment.records import Floats, Integers, Record
from mssegment.segmentation.consensus.coassociation import Coassociation
from mssegment.segmentation.consensus.epipolar_evidence import EpipolarEvidence
from mssegment.segmentation.consensus.joinedness import Joinedness
from mssegment.segmentation.consensus.model_order import rigid_factor
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen
from mssegment.segmentation.consensus.split_test import nearest_of_each
from mssegment.segmentation.consensus.windowed_split import WindowedSplitTest

POWER = 4
"""Power of the agreement that is partitioned."""
PIECES = (6, 8, 10)
"""Groups of the partitions that are starts."""
APART = 5.0
"""Two groups are two objects if R, what their split saves over its price, exceeds their joinedness
by this factor."""
JOINED = 1 / 8
"""Groups that are never seen together are two objects if their joinedness is below this."""
SPARE = 2
"""The finest start has at least so many groups more than there may be motions."""
REFINEMENT_ROUNDS, MAX_REFINED_SHARE, MIN_REFINED_SIZE = 3, 0.1, 8
"""Rounds of refinement, the largest share of the labels that it may change, and the smallest group
that it may leave."""
LEAST_AGREEMENT = 1e-3
"""Agreement that tracks have by chance."""
LARGE = 12
"""Smaller groups are joined with others first; they are too small for a fit of their own."""


class Candidate(Record, frozen=True):
    """A partition of tracks.

    Attributes
    ----------
    groups : tuple of ndarray of int
        The sorted tracks of each group.
    joinedness : float
        The largest of two groups; 0 for a single group.
    """

    groups: tuple[Integers, ...]
    joinedness: float

    @property
    def smallest(self) -> int:
        """Tracks of the smallest group."""
        return min(len(group) for group in self.groups)


class RigidGrouping:
    """Partitions of tracks into rigid objects, and the choice among them.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    kinds : mapping of str to Coassociation
        Agreement for each model, homographies first.
    pairs : sequence of (int, int)
        Pairs of frames for epipolar geometry.
    bounds : (int, int)
        The least and the largest number of groups.
    rng : numpy.random.Generator
        Source of random numbers.
    """

    def __init__(
        self,
        points: Floats,
        kinds: Mapping[str, Coassociation],
        pairs: Sequence[tuple[int, int]],
        bounds: tuple[int, int],
        rng: np.random.Generator,
    ) -> None:
        self._size, self._least, self._pairs = len(points), bounds[0], len(pairs)
        spare = max(bounds[1] - (max(PIECES) - SPARE), 0)
        pieces = [size + spare for size in PIECES]
        means = [kind.mean for kind in kinds.values()]
        starts: list[list[list[Integers]]] = []
        for source in (means[0], np.mean(means, axis=0)):
            vectors = embedding(sharpen(source, POWER), max(pieces))
            starts.append([_groups(partition(vectors, size, rng)) for size in pieces])
        self._evidence = EpipolarEvidence(points, pairs)
        self._evidence.measure_noise([group for start in starts for group in start[0]])
        planar, distances = next(iter(kinds.values())), _distances(points)
        self._joinedness = Joinedness(planar, distances, self._evidence)
        self._tracks = points, np.asarray(planar.mean, dtype=np.float64), distances
        self._tests: dict[bool, WindowedSplitTest] = {}
        self._found: dict[int, list[Candidate]] = {}
        for start in (one for of_source in starts for one in of_source):
            for candidate in self._joined(start):
                self._found.setdefault(len(candidate.groups), []).append(candidate)
        self._best: dict[int, Candidate] = {}

    def best(self, groups: int) -> Integers:
        """The partition into ``groups`` with the shortest description, labels 0, 1, ... [P]."""
        labels = np.zeros(self._size, dtype=np.int64)
        found = self._candidate(groups).groups
        for label, group in enumerate(found):
            labels[group] = label
        return self._refined(labels) if len(found) > 1 else labels

    def _refined(self, labels: Integers) -> Integers:
        """The labels after each track has joined the group that describes it with fewest nats.

        That is its residuals from the geometry of the group, the planes that it shares with the
        group in each frame pair, and the share of the group. Not taken where too many tracks
        change, or a group becomes too small.
        """

        def costs(members: Floats) -> Floats:
            groups = [np.flatnonzero(row) for row in members]
            codes = np.stack([self._evidence.code_lengths(group) for group in groups])
            shared = np.log(self._joinedness.agreement_of_tracks(groups) + LEAST_AGREEMENT)
            shares = np.log(members.mean(axis=1, keepdims=True))
            return np.asarray(codes - self._pairs * shared - shares)

        found = hard_em(labels, costs, REFINEMENT_ROUNDS, MIN_REFINED_SIZE)
        similar = found.max() == labels.max() and (found != labels).mean() <= MAX_REFINED_SHARE
        return found if similar else labels

    def count(self, least: int, most: int) -> int:
        """The number of groups: more are made as long as all of them are apart."""
        groups = least
        while groups < most and self._all_apart(groups + 1):
            groups += 1
        return groups

    def _all_apart(self, groups: int) -> bool:
        """Whether the partition into ``groups`` holds large groups only, and none are joined."""
        if groups not in self._found:
            return False
        found = self._candidate(groups)
        if found.smallest < LARGE:
            return False
        separation = self._separation(single=groups == 2, bound=1.0)
        return all(separation(*pair) > 1 for pair in combinations(found.groups, 2))

    def separations(self, groups: int) -> list[float]:
        """``_separation`` of each of the ``groups`` of the best partition and its nearest one."""
        labels = self.best(groups)
        members = [np.flatnonzero(labels == group) for group in range(int(labels.max()) + 1)]
        return nearest_of_each(members, self._separation(single=groups == 2))

    def _separation(
        self, *, single: bool, bound: float = np.inf
    ) -> Callable[[Integers, Integers], float]:
        """R / (``APART`` J) of two groups; above 1 they are two objects.

        R says what a split saves over its price. In J, rigid motion over all frames stands for
        epipolar geometry where it is the stronger evidence for two bodies. Groups that no window
        shows together are judged by their joinedness alone. Where a lower limit that needs no fit
        exceeds ``bound``, it will do.
        """
        if single not in self._tests:
            self._tests[single] = WindowedSplitTest(*self._tracks, single=single)
        test = self._tests[single]

        def separation(first: Integers, second: Integers) -> float:
            ratio = test.ratio(first, second)
            least = JOINED if ratio is None else ratio / APART
            lower = least / max(self._joinedness.bound(first, second), 1e-12)
            if lower > bound:
                return lower
            found = least / max(self._joinedness(first, second), 1e-12)
            if ratio is None or found > bound:
                return found
            return max(found, lower * rigid_factor(test, first, second))

        return separation

    def _candidate(self, groups: int) -> Candidate:
        """The best partition into ``groups``, or the nearest number that was found."""
        groups = min(self._found, key=lambda found: abs(found - groups))
        if groups not in self._best:
            found = self._found[groups]
            large = [one for one in found if one.smallest >= LARGE]
            self._best[groups] = min(
                large or found, key=lambda one: self._evidence.cost(one.groups)
            )
        return self._best[groups]

    def _joined(self, groups: list[Integers]) -> Iterator[Candidate]:
        """The partitions that joining the most joined groups leads to, down to the least number."""
        while True:
            if len(groups) == 1:
                yield Candidate(tuple(groups), 0.0)
                return
            joinedness, pair = self._most_joined(groups)
            yield Candidate(tuple(groups), joinedness)
            if len(groups) <= self._least:
                return
            union = np.sort(np.concatenate([groups[index] for index in pair]))
            groups = [group for index, group in enumerate(groups) if index not in pair]
            groups.append(union)

    def _most_joined(self, groups: Sequence[Integers]) -> tuple[float, tuple[int, int]]:
        """The largest joinedness and its pair; small groups, where there are any, come first."""
        pairs = list(combinations(range(len(groups)), 2))
        small = {index for index, group in enumerate(groups) if len(group) < LARGE}
        if small:
            pairs = [pair for pair in pairs if small.intersection(pair)]
        return self._joinedness.most_joined(groups, pairs)


def _groups(labels: Integers) -> list[Integers]:
    """The tracks of each label; some labels may have none."""
    return [np.flatnonzero(labels == label) for label in np.unique(labels)]


def _distances(points: Floats) -> Floats:
    """Distances [P, P] of the mean positions of tracks."""
    visible = np.asarray(np.isfinite(points).all(axis=2))
    total = np.where(visible[..., None], points, 0.0).sum(axis=1)
    place = total / np.maximum(visible.sum(axis=1), 1)[:, None]
    square = (place**2).sum(axis=1)
    return np.asarray(np.sqrt(np.maximum(square[:, None] + square - 2 * place @ place.T, 0)))
