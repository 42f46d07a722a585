"""Joinedness: how much two groups of tracks look like one rigid object.

    J = H sqrt(B) exp(-G)

- H is the agreement of homographies across the groups over that within them: parts of one object
  share planes.
- B is that agreement at the border of the groups only, where depths are the same.
- G is the growth of the residuals from the epipolar geometry of each group to that of the union:
  parts of one object have one epipolar geometry, whatever their depths.

J is about 1 inside an object and near 0 between two. Each factor alone fails: planes of one object
agree little, objects that meet agree at their border, and what moves along the epipolar lines of
something else has its geometry.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.border import border_contrast
from mssegment.segmentation.consensus.coassociation import Coassociation
from mssegment.segmentation.consensus.epipolar_evidence import EpipolarEvidence

FEWEST_FOR_BORDER = 5
"""Groups of fewer tracks have no border to speak of."""


class Joinedness:
    """The joinedness of pairs of groups among the same tracks.

    Groups are sorted indices of tracks.

    Parameters
    ----------
    planar : Coassociation
        Agreement of homographies.
    distances : ndarray [P, P]
        Distances of the mean positions in pixels.
    evidence : EpipolarEvidence
        Of the same tracks.
    """

    def __init__(
        self, planar: Coassociation, distances: Floats, evidence: EpipolarEvidence
    ) -> None:
        self._planar, self._mean = planar, np.asarray(planar.mean, dtype=np.float64)
        self._distances, self._evidence = distances, evidence
        self._roots: dict[tuple[bytes, bytes], float] = {}
        self._growths: dict[tuple[bytes, bytes], float] = {}

    def agreement(self, groups: Sequence[Integers]) -> Floats:
        """H of every two groups, [groups, groups]: the mean agreement over that within them.

        Means are over the sets that apply to both tracks.
        """
        member = np.zeros((len(self._mean), len(groups)), dtype=np.float32)
        for column, group in enumerate(groups):
            member[group, column] = 1.0
        planar = self._planar
        total, count = (member.T @ (one @ member) for one in (planar.agreement, planar.shared))
        mean = total.astype(np.float64) / np.maximum(count, 1.0)
        root = np.sqrt(np.maximum(np.diagonal(mean), 1e-12))
        return np.asarray(mean / (root[:, None] * root))

    def agreement_of_tracks(self, groups: Sequence[Integers]) -> Floats:
        """Mean agreement of each track with each group, [groups, P]."""
        return np.stack([self._mean[:, group].mean(axis=1) for group in groups])

    def most_joined(
        self, groups: Sequence[Integers], pairs: Sequence[tuple[int, int]]
    ) -> tuple[float, tuple[int, int]]:
        """The largest J among ``pairs`` of groups, and its pair.

        J is at most H sqrt(B), and H sqrt(B) at most H, so that most pairs need no fit.
        """
        bound = self.agreement(groups)
        largest, best = -1.0, pairs[0]
        for i, j in sorted(pairs, key=lambda pair: -bound[pair]):
            if bound[i, j] <= largest:
                break
            joined = bound[i, j] * self._root_contrast(groups[i], groups[j])
            if joined > largest:
                joined *= math.exp(-self._growth(groups[i], groups[j]))
            if joined > largest:
                largest, best = joined, (i, j)
        return max(float(largest), 0.0), best

    def bound(self, first: Integers, second: Integers) -> float:
        """H sqrt(B) of two groups, which J cannot exceed and which needs no fit."""
        within = float(self.agreement([first, second])[0, 1])
        return within * self._root_contrast(first, second)

    def __call__(self, first: Integers, second: Integers) -> float:
        """J of two groups."""
        return self.bound(first, second) * math.exp(-self._growth(first, second))

    def _root_contrast(self, first: Integers, second: Integers) -> float:
        """The root of B, at most 1; 1 for groups too small to have a border."""
        if min(len(first), len(second)) < FEWEST_FOR_BORDER:
            return 1.0
        key = _key(first, second)
        if key not in self._roots:
            contrast = border_contrast(self._mean, self._distances, first, second)
            self._roots[key] = min(math.sqrt(contrast), 1.0)
        return self._roots[key]

    def _growth(self, first: Integers, second: Integers) -> float:
        key = _key(first, second)
        if key not in self._growths:
            self._growths[key] = self._evidence.growth(first, second)
        return self._growths[key]


def _key(first: Integers, second: Integers) -> tuple[bytes, bytes]:
    one, two = first.tobytes(), second.tobytes()
    return (one, two) if one < two else (two, one)
