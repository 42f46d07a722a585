"""Co-association of tracks: how often two tracks mark the same hypotheses.

References
----------
Fred and Jain, Combining multiple clusterings using evidence accumulation, 2005.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet

Singles = npt.NDArray[np.float32]


class Coassociation(Record, frozen=True):
    """Agreement of all pairs of tracks on the sets of one model.

    Attributes
    ----------
    agreement : ndarray [P, P]
        Sum over the sets that apply to both tracks.
    shared : ndarray [P, P]
        Number of these sets.
    """

    agreement: Singles
    shared: Singles

    @property
    def mean(self) -> Singles:
        """Average agreement over the sets that apply to both tracks, 0 if there are none."""
        return np.asarray(self.agreement / np.maximum(self.shared, 1), dtype=np.float32)


class CoassociationAccumulator:
    """Co-association by model, set after set.

    Parameters
    ----------
    total : int
        Number of tracks.
    """

    def __init__(self, total: int) -> None:
        self._total = total
        self._agreement: dict[str, Singles] = {}
        self._seen: dict[str, list[Singles]] = {}

    def add(self, observed_set: ObservedSet, squared: Floats) -> None:
        """Add a set with its ``ranking_sq_residuals``; tracks mark the hypotheses that fit best."""
        model, tracks = observed_set.hypotheses.model, observed_set.tracks
        own = marks_of(observed_set, squared)
        # the rows of all tracks: to add a block of a matrix takes longer than the product
        marks = np.zeros((self._total, own.shape[1]), dtype=np.float32)
        marks[tracks] = own
        agreement = marks @ marks.T
        agreement /= own[:1].sum()
        if model in self._agreement:
            np.add(self._agreement[model], agreement, out=self._agreement[model])
        else:
            self._agreement[model] = agreement
        seen = np.zeros(self._total, dtype=np.float32)
        seen[tracks] = 1.0
        self._seen.setdefault(model, []).append(seen)

    @property
    def kinds(self) -> dict[str, Coassociation]:
        """The co-association for each name of a model."""
        found = {}
        for model, agreement in self._agreement.items():
            seen = np.array(self._seen[model])
            found[model] = Coassociation(agreement, seen.T @ seen)
        return found


def marks_of(observed_set: ObservedSet, squared: Floats) -> Singles:
    """1 where a track marks a hypothesis of the set, else 0, [n, hypotheses] like ``squared``."""
    total = squared.shape[1]
    count = min(max(3, round(observed_set.model.marked_share * total)), total)
    return mark_best(squared, count)


def mark_best(squared: Floats, count: int) -> Singles:
    """1 at the ``count`` smallest of each row of [n, hypotheses], else 0."""
    marks = np.zeros(squared.shape, dtype=np.float32)
    smallest = np.argpartition(squared, count - 1, axis=1)[:, :count]
    np.put_along_axis(marks, smallest, np.float32(1), axis=1)
    return marks
