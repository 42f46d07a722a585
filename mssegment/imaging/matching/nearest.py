"""Nearest descriptors both ways, by blocks of one matrix product."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mssegment.imaging.matching.views import Indices, Singles

BLOCK = 256


@dataclass(frozen=True)
class Pairs:
    """Row ``first`` of one set and row ``second`` of the other, and their correlation."""

    first: Indices
    second: Indices
    correlation: Singles


def mutual(first: Singles, second: Singles, least: float) -> Pairs:
    """Pairs of unit rows that are each other's nearest and correlate at least ``least``."""
    best = np.empty(len(first), np.intp)
    score = np.empty(len(first), np.float32)
    columns = np.full(len(second), -np.inf, np.float32)
    for start in range(0, len(first), BLOCK):
        rows = slice(start, start + BLOCK)
        block = first[rows] @ second.T
        best[rows] = block.argmax(axis=1)
        score[rows] = np.take_along_axis(block, best[rows, None], axis=1)[:, 0]
        np.maximum(columns, block.max(axis=0), out=columns)
    chosen = np.flatnonzero((score >= columns[best]) & (score >= least))
    return Pairs(chosen, best[chosen], score[chosen])
