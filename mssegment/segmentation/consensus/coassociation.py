"""Tracks that fit the same hypotheses belong together: how often two tracks mark the same ones."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet

Singles = npt.NDArray[np.float32]


class Coassociation(Record, frozen=True):
    """Agreement of every two tracks on the sets of one kind.

    ``agreement`` [P, P] sums over the sets that both tracks are seen in, ``shared`` [P, P] counts
    these sets.
    """

    agreement: Singles
    shared: Singles

    @property
    def mean(self) -> Singles:
        """The average over the sets that two tracks share, 0 where they share none."""
        return np.asarray(self.agreement / np.maximum(self.shared, 1), dtype=np.float32)


class Coassociations:
    """Co-membership by kind of evidence, set after set."""

    def __init__(self, total: int) -> None:
        """For ``total`` tracks."""
        self._total = total
        self.kinds: dict[str, Coassociation] = {}

    def add(self, observed_set: ObservedSet, squared: Floats) -> None:
        """Add a set with its ``ranking_sq_residuals``: tracks mark the hypotheses that fit best."""
        entry, seen = observed_set.hypotheses, observed_set.tracks
        marks = marks_of(observed_set, squared)
        agreement = marks @ marks.T / marks[:1].sum()
        if entry.model not in self.kinds:
            zeros = np.zeros((self._total, self._total), dtype=np.float32)
            self.kinds[entry.model] = Coassociation(zeros, zeros.copy())
        kind = self.kinds[entry.model]
        if len(seen) == self._total:
            np.add(kind.agreement, agreement, out=kind.agreement)
            np.add(kind.shared, np.float32(1), out=kind.shared)
        else:
            block = np.ix_(seen, seen)
            kind.agreement[block] += agreement
            kind.shared[block] += 1


def marks_of(observed_set: ObservedSet, squared: Floats) -> Singles:
    """1 where a track marks a hypothesis of the set, else 0, [n, hypotheses] as ``squared``."""
    count = squared.shape[1]
    best = min(max(3, round(observed_set.model.marked_share * count)), count)
    return mark_best(squared, best)


def mark_best(squared: Floats, best: int) -> Singles:
    """1 at the ``best`` smallest of each row of [n, hypotheses], else 0."""
    marks = np.zeros(squared.shape, dtype=np.float32)
    smallest = np.argpartition(squared, best - 1, axis=1)[:, :best]
    np.put_along_axis(marks, smallest, np.float32(1), axis=1)
    return marks
