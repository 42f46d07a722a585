"""Mutual nearest neighbours among descriptors, in blocks of one matrix product."""

from __future__ import annotations

import numpy as np

from mssegment.imaging.matching.resampling import Floats32, Indices
from mssegment.neighbours import pairs_within
from mssegment.records import Floats, Record

CORRELATION_ROWS = 128
"""Rows of a block of correlations, which then stays in the cache while it is reduced."""


class Pairs(Record, frozen=True):
    """Pairs of row ``first`` [n] of one set and row ``second`` [n] of the other.

    ``correlation`` [n] is the scalar product of the two unit rows.
    """

    first: Indices
    second: Indices
    correlation: Floats32


def mutual(
    first: Floats32,
    second: Floats32,
    min_correlation: float,
    *,
    ratio: float = 1.0,
    places: Floats | None = None,
    apart: float = 0.0,
) -> Pairs:
    """Pairs of descriptors that are each other's nearest.

    With ``ratio`` < 1 this includes Lowe's ratio test (IJCV 2004): the distance to the nearest
    descriptor must be below that share of the distance to the nearest one at another place.

    Parameters
    ----------
    first : float32 array [n, d]
        Unit descriptors of view 1.
    second : float32 array [m, d]
        Unit descriptors of view 2.
    min_correlation : float
        Least correlation of a pair.
    ratio : float
        Largest ratio of the two distances.
    places : float array [m, 2], optional
        Positions of ``second`` in pixels; without them the ratio is not tested.
    apart : float
        Descriptors within this distance in pixels are at the same place (another scale or
        direction of one corner).

    Returns
    -------
    Pairs
        Sorted by the row of ``first``.
    """
    best = np.empty(len(first), np.intp)
    score = np.empty(len(first), np.float32)
    runner_up = np.full(len(first), -1.0, np.float32)
    column_best = np.full(len(second), -np.inf, np.float32)
    if not len(first) or not len(second):
        return Pairs(best[:0], best[:0], score[:0])
    same = _SamePlace(places, apart) if places is not None and ratio < 1 else None
    buffer = np.empty((CORRELATION_ROWS, len(second)), np.float32)
    for start in range(0, len(first), CORRELATION_ROWS):
        rows = slice(start, start + CORRELATION_ROWS)
        block = np.matmul(first[rows], second.T, out=buffer[: len(first[rows])])
        best[rows] = block.argmax(axis=1)
        score[rows] = block[np.arange(len(block)), best[rows]]
        np.maximum(column_best, block.max(axis=0), out=column_best)
        if same is not None:
            block[same.entries(best[rows])] = -1.0
            runner_up[rows] = block.max(axis=1)
    good = (score >= column_best[best]) & (score >= min_correlation)
    # 1 - correlation is half the squared distance of unit vectors
    good &= (1 - score) <= ratio**2 * (1 - runner_up)
    chosen = np.flatnonzero(good)
    return Pairs(chosen, best[chosen], score[chosen])


class _SamePlace:
    """For each position the indices of those at most ``apart`` from it, itself included."""

    def __init__(self, places: Floats, apart: float) -> None:
        pairs = pairs_within(places, apart)
        own = np.repeat(np.arange(len(places))[:, None], 2, axis=1)
        both = np.concatenate([own, pairs, pairs[:, ::-1]])
        self.others = both[np.argsort(both[:, 0], kind="stable"), 1]
        self.counts = np.bincount(both[:, 0], minlength=len(places))
        self.ends = np.cumsum(self.counts)

    def entries(self, chosen: Indices) -> tuple[Indices, Indices]:
        """Row and column of every position that shares the place of its row's ``chosen`` one."""
        counts = self.counts[chosen]
        rows = np.repeat(np.arange(len(chosen)), counts)
        back = np.cumsum(counts)[rows] - np.arange(len(rows))
        return rows, self.others[self.ends[chosen][rows] - back]
