"""Nearest descriptors both ways, by blocks of one matrix product."""

from __future__ import annotations

import numpy as np

from mssegment.imaging.matching.views import Indices, Singles
from mssegment.neighbours import pairs_within
from mssegment.records import Floats, Record

BLOCK = 128
"""Rows of a block of correlations, so that it stays in the cache while it is looked at."""


class Pairs(Record, frozen=True):
    """Row ``first`` of one set and row ``second`` of the other, and their correlation."""

    first: Indices
    second: Indices
    correlation: Singles


def mutual(
    first: Singles,
    second: Singles,
    least: float,
    *,
    ratio: float = 1.0,
    places: Floats | None = None,
    apart: float = 0.0,
) -> Pairs:
    """Pairs of unit rows that are each other's nearest and correlate at least ``least``.

    With ``ratio`` < 1 the distance to the nearest must be below that share of the distance to
    the nearest at another place: ``places`` [n, 2] are the positions of ``second``, and what is
    within ``apart`` of the nearest is the same place (another scale or direction of it).
    """
    best = np.empty(len(first), np.intp)
    score = np.empty(len(first), np.float32)
    runner_up = np.full(len(first), -1.0, np.float32)
    columns = np.full(len(second), -np.inf, np.float32)
    if not len(first) or not len(second):
        return Pairs(best[:0], best[:0], score[:0])
    same = _SamePlace(places, apart) if places is not None and ratio < 1 else None
    room = np.empty((BLOCK, len(second)), np.float32)
    for start in range(0, len(first), BLOCK):
        rows = slice(start, start + BLOCK)
        block = np.matmul(first[rows], second.T, out=room[: len(first[rows])])
        best[rows] = block.argmax(axis=1)
        score[rows] = block[np.arange(len(block)), best[rows]]
        np.maximum(columns, block.max(axis=0), out=columns)
        if same is not None:
            block[same.as_of(best[rows])] = -1.0
            runner_up[rows] = block.max(axis=1)
    good = (score >= columns[best]) & (score >= least)
    good &= (1 - score) <= ratio**2 * (1 - runner_up)
    chosen = np.flatnonzero(good)
    return Pairs(chosen, best[chosen], score[chosen])


class _SamePlace:
    """For each position those at most ``apart`` from it, itself among them."""

    def __init__(self, places: Floats, apart: float) -> None:
        pairs = pairs_within(places, apart)
        own = np.repeat(np.arange(len(places))[:, None], 2, axis=1)
        both = np.concatenate([own, pairs, pairs[:, ::-1]])
        self.others = both[np.argsort(both[:, 0], kind="stable"), 1]
        self.counts = np.bincount(both[:, 0], minlength=len(places))
        self.ends = np.cumsum(self.counts)

    def as_of(self, chosen: Indices) -> tuple[Indices, Indices]:
        """The row and the position of all that are at the place of one ``chosen`` per row."""
        counts = self.counts[chosen]
        rows = np.repeat(np.arange(len(chosen)), counts)
        back = np.cumsum(counts)[rows] - np.arange(len(rows))
        return rows, self.others[self.ends[chosen][rows] - back]
