"""The iteration (9)-(10) of the paper, for any manifold and all starts at once.

This is the algorithm of section 4 with two savings: only what still moves is iterated, and a
trajectory that comes within a tenth of the bandwidth of a denser one follows it from there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Cloud, Manifold
from mssegment.meanshift.kernels import Kernel
from mssegment.records import Floats, Integers

EVERY = 8
"""One trajectory in so many can be followed, besides those that already are."""


def shift(cloud: Cloud, kernel: Kernel, x: Floats) -> tuple[Floats, Floats]:
    """The mean shift vectors (9) and the densities (7) at ``x`` [m, ...].

    Works through ``x`` in blocks that fit the cache. The density is that of (7) without the
    constant c_{k,h}: the mean of k(d^2 / h^2) over the points.
    """
    step = np.empty(x.shape)
    density = np.empty(len(x))
    for start in range(0, len(x), cloud.rows):
        block = slice(start, start + cloud.rows)
        view = cloud.seen_from(x[block])
        profile_sums, weights = kernel.weigh(view.z)
        density[block] = profile_sums / cloud.size
        summed = view.weighted_sum(weights)
        total = weights.sum(axis=1, dtype=np.float64).reshape(-1, *(1,) * (x.ndim - 1))
        step[block] = np.divide(summed, total, out=np.zeros_like(summed), where=total > 0)
    return step, density


@dataclass
class Ascent:
    """Trajectories on their way up.

    ``x`` [n, ...] is where each one is and ``density`` [n] the density where its last step began;
    ``leader`` [n] is the trajectory that each one follows (itself, while on its own way);
    ``converged`` [n] where the last shift was shorter than the tolerance.
    """

    x: Floats
    density: Floats
    leader: Integers
    converged: npt.NDArray[np.bool_]
    iterations: int = 0
    history: list[tuple[Integers, Floats]] | None = None

    @classmethod
    def from_starts(cls, starts: Floats, record: bool = False) -> Ascent:
        """Trajectories that stand at ``starts``."""
        n = len(starts)
        x = np.array(starts, dtype=np.float64)
        history = [(np.arange(n), x.copy())] if record else None
        return cls(x, np.zeros(n), np.arange(n), np.zeros(n, dtype=bool), 0, history)

    def last_leader(self) -> Integers:
        """For each trajectory the one that it ends with."""
        last = self.leader
        while True:
            further = last[last]
            if np.array_equal(further, last):
                return last
            last = further


def ascend(
    manifold: Manifold,
    cloud: Cloud,
    kernel: Kernel,
    bandwidth: float,
    starts: Floats,
    tolerance: float,
    max_iterations: int,
    follow_within: float = 0.0,
    record: bool = False,
) -> Ascent:
    """Move ``starts`` [n, ...] by (10) until every shift is below ``tolerance`` bandwidths.

    A trajectory within ``follow_within`` bandwidths of a denser one follows it.
    """
    ascent = Ascent.from_starts(starts, record)
    moving = np.arange(len(starts))
    while moving.size and ascent.iterations < max_iterations:
        ascent.iterations += 1
        x = ascent.x[moving]
        step, ascent.density[moving] = shift(cloud, kernel, x)
        ascent.x[moving] = manifold.exp(x, step)
        ascent.converged[moving] = manifold.norm(x, step) <= tolerance * bandwidth
        if ascent.history is not None:
            ascent.history.append((moving, ascent.x[moving]))
        moving = moving[~ascent.converged[moving]]
        if follow_within > 0 and moving.size:
            moving = _follow(manifold, ascent, moving, follow_within * bandwidth)
    return ascent


def _follow(manifold: Manifold, ascent: Ascent, moving: Integers, within: float) -> Integers:
    """Let the ``moving`` follow denser trajectories nearby; the indices of those that do not."""
    alone = ascent.leader == np.arange(len(ascent.leader))
    followed = np.zeros(len(alone), dtype=bool)
    followed[ascent.leader[~alone]] = True
    followed[moving[::EVERY]] = True
    ahead = np.flatnonzero(followed & alone)
    ahead = ahead[np.argsort(-ascent.density[ahead], kind="stable")]
    rank = np.full(len(alone), len(ahead))
    rank[ahead] = np.arange(len(ahead))
    cloud = manifold.cloud(ascent.x[ahead], within, precise=False)
    for start in range(0, len(moving), cloud.rows):
        block = moving[start : start + cloud.rows]
        near = cloud.seen_from(ascent.x[block]).z < 1.0
        near &= ascent.density[ahead] >= ascent.density[block, None]
        first = np.argmax(near, axis=1)
        joins = near[np.arange(len(block)), first] & (first < rank[block])
        ascent.leader[block[joins]] = ahead[first[joins]]
    return np.asarray(moving[ascent.leader[moving] == moving])
