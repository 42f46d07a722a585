"""From the ends of trajectories to modes: merged, without saddle points, ranked."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.records import Floats, Integers


def merge(
    manifold: Manifold, x: Floats, density: Floats, within: float
) -> tuple[Integers, Integers]:
    """The distinct ones of ``x`` [n, ...], densest first, and for each point its place among them.

    Going down in density, a point within ``within`` of a kept one joins the nearest such;
    otherwise it is kept. Returns the indices of the kept [m] and the assignment [n].
    """
    order = np.argsort(-density, kind="stable")
    assignment = np.full(len(x), -1)
    kept: list[int] = []
    while order.size:
        best = order[0]
        z = manifold.cloud(x[[best]], within).seen_from(x[order]).z[:, 0]
        near = z < 1.0
        near[0] = True
        assignment[order[near]] = len(kept)
        kept.append(int(best))
        order = order[~near]
    return np.array(kept, dtype=np.int64), assignment
