"""From the ends of trajectories to distinct modes."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.records import Floats, Integers

TIE_DECIMALS = 6
"""Densities that agree to so many decimals of the largest are equal: modes are only so exact, and
otherwise rounding errors would choose which of two symmetric modes stays."""


def merge(
    manifold: Manifold, x: Floats, density: Floats, within: float
) -> tuple[Integers, Integers]:
    """Merge points that are near each other, keeping the densest.

    In order of decreasing density, equal ones in their own order, a point is merged into the
    densest kept point that is nearer than ``within``, and kept where there is none.

    Parameters
    ----------
    manifold
        The manifold.
    x
        The points [n, ...].
    density
        Their densities [n].
    within
        The distance, in that of the manifold.

    Returns
    -------
    kept
        The indices of the kept points [m], densest first.
    assignment
        For each point the position in ``kept`` of the one that it was merged into [n].

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.manifolds import Euclidean
    >>> ends, density = np.array([[0.0], [0.1], [5.0]]), np.array([0.3, 0.4, 0.2])
    >>> kept, assignment = merge(Euclidean(1), ends, density, within=1.0)
    >>> kept.tolist(), assignment.tolist()
    ([1, 2], [0, 0, 1])
    """
    relative = density / max(float(density.max(initial=0.0)), np.finfo(np.float64).tiny)
    order = np.argsort(-np.round(relative, TIE_DECIMALS), kind="stable")
    ordered = x[order]
    target = np.arange(len(x))
    prepared = manifold.prepare(ordered, within, cutoff=1.0)
    for start in range(0, len(x), prepared.block_rows):
        rows, columns = np.nonzero(
            prepared.block(ordered[start : start + prepared.block_rows]).scaled_sq_dist < 1.0
        )
        rows += start
        for i, j in zip(rows.tolist(), columns.tolist(), strict=True):
            if j < i and target[j] == j and target[i] == i:
                target[i] = j
    kept = np.flatnonzero(target == np.arange(len(x)))
    assignment = np.empty(len(x), dtype=np.int64)
    assignment[order] = np.searchsorted(kept, target)
    return order[kept], assignment
