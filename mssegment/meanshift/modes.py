"""From the ends of trajectories to distinct modes."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.records import Floats, Integers


def merge(
    manifold: Manifold, x: Floats, density: Floats, within: float
) -> tuple[Integers, Integers]:
    """The distinct ones of ``x`` [n, ...], densest first, and for each point its place among them.

    Going down in density, a point nearer than ``within`` to one that is kept joins the densest
    such; otherwise it is kept. Returns the indices of the kept [m] and the assignment [n].
    """
    order = np.argsort(-density, kind="stable")
    ordered = x[order]
    joined = np.arange(len(x))
    prepared = manifold.prepare(ordered, within, reach=1.0)
    for start in range(0, len(x), prepared.rows):
        rows, columns = np.nonzero(
            prepared.block(ordered[start : start + prepared.rows]).scaled_sq_dist < 1.0
        )
        rows += start
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            if j < i and joined[j] == j and joined[i] == i:
                joined[i] = j
    kept = np.flatnonzero(joined == np.arange(len(x)))
    assignment = np.empty(len(x), dtype=np.int64)
    assignment[order] = np.searchsorted(kept, joined)
    return order[kept], assignment
