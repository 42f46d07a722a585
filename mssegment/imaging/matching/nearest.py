"""Nearest descriptors both ways, by blocks of one matrix product."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.views import Indices, Singles
from mssegment.neighbours import nearest
from mssegment.records import Floats, Record

BLOCK = 128
"""Rows of a block of correlations, so that it stays in the cache while it is looked at."""
NEIGHBOURS = 32


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
    same = _same_place(places, apart) if places is not None and ratio < 1 else None
    for start in range(0, len(first), BLOCK):
        rows = slice(start, start + BLOCK)
        block = first[rows] @ second.T
        best[rows] = block.argmax(axis=1)
        score[rows] = np.take_along_axis(block, best[rows, None], axis=1)[:, 0]
        np.maximum(columns, block.max(axis=0), out=columns)
        if same is not None:
            np.put_along_axis(block, same[best[rows]], -1.0, axis=1)
            runner_up[rows] = block.max(axis=1)
    good = (score >= columns[best]) & (score >= least)
    good &= (1 - score) <= ratio**2 * (1 - runner_up)
    chosen = np.flatnonzero(good)
    return Pairs(chosen, best[chosen], score[chosen])


def _same_place(places: Floats, apart: float) -> npt.NDArray[np.intp]:
    """For each position the indices of those within ``apart``, filled up with its own."""
    count = min(NEIGHBOURS, len(places))
    _, index = nearest(places, places, count, apart)
    return np.where(index == len(places), np.arange(len(places))[:, None], index)
