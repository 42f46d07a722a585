"""The iteration (9)-(10) of the paper, for any manifold and all starts at once.

:func:`shift` is the mean shift vector; :func:`ascend` repeats it. Three savings, none of which
changes where a trajectory arrives by more than moving its start by a hundredth of the bandwidth
would: only what still moves is iterated; a trajectory that comes within a tenth of the bandwidth
of a denser one follows it from there; near the mode, where the plain iteration converges
linearly, its steps are stretched (Barzilai and Borwein, 1988) and taken back where the density
would fall.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Cloud, Manifold
from mssegment.meanshift.kernels import Kernel
from mssegment.records import Floats, Integers

EVERY = 8
"""One trajectory in so many can be followed, besides those that already are."""
NEAR = 0.05
"""Shifts shorter than this many bandwidths are stretched; sooner, some would change their mode."""
MOST_STRETCH = 100.0
FEWEST_BLOCKS = 4
"""Fewer blocks than this are not worth handing to other threads."""
FALL = 1e-5
"""The relative loss of density at which a stretched step is taken back (rounding is less)."""


Thin = Callable[["Ascent", Integers], Integers]
"""Called after every step with the moving trajectories; returns those that go on by themselves."""


def shift(
    cloud: Cloud,
    kernel: Kernel,
    x: Floats,
    own: Floats | None = None,
    pool: Executor | None = None,
) -> tuple[Floats, Floats]:
    """The mean shift vectors (9) and the densities (7) at ``x`` [m, ...].

    Works through ``x`` in blocks that fit the cache. The density is that of (7) without the
    constant c_{k,h}: the mean of k(d^2 / h^2) over the points. With ``own`` [m, ...], each place
    has one more point of its own in the sums (not in their number). A ``pool`` of threads shares
    the blocks, which do not depend on it: the same bytes come out with any number of threads.
    """
    step = np.empty(x.shape)
    density = np.empty(len(x))

    def fill(block: slice) -> None:
        mine = None if own is None else own[block]
        step[block], density[block] = _shift_block(cloud, kernel, x[block], mine)

    blocks = [slice(start, start + cloud.rows) for start in range(0, len(x), cloud.rows)]
    if pool is None or len(blocks) < FEWEST_BLOCKS:
        for block in blocks:
            fill(block)
    else:
        list(pool.map(fill, blocks))
    return step, density


def _shift_block(
    cloud: Cloud, kernel: Kernel, x: Floats, own: Floats | None
) -> tuple[Floats, Floats]:
    """``shift`` for places that fit the cache."""
    view = cloud.seen_from(x)
    weights, profile_sums = kernel.weigh(view.z)
    summed, total = view.weighted_sum(weights)
    profile = total if profile_sums is None else profile_sums
    if own is not None:
        z = (cloud.manifold.dist(x, own) / cloud.bandwidth)[:, None] ** 2
        profile = profile + kernel.profile(z)[:, 0]
        weight = kernel.weigh(z)[0][:, 0].astype(np.float64)
        summed = summed + _scaled(weight, cloud.manifold.attraction(x, own))
        total = total + weight
    return _scaled(1.0 / np.where(total > 0, total, 1.0), summed), profile / cloud.size


@dataclass
class Ascent:
    """Trajectories on their way up.

    ``x`` [n, ...] is where each one is, ``origin`` where its last step began, ``density`` and
    ``step`` the density and the mean shift vector there, ``stretch`` how many times that vector
    was gone; ``leader`` [n] is the trajectory that each one follows (itself, while on its own
    way); ``converged`` [n] where the mode is as near as was asked.
    """

    x: Floats
    origin: Floats
    density: Floats
    step: Floats
    stretch: Floats
    leader: Integers
    converged: npt.NDArray[np.bool_]
    iterations: int = 0
    history: list[tuple[Integers, Floats]] | None = None

    @classmethod
    def from_starts(cls, starts: Floats, record: bool = False) -> Ascent:
        """Trajectories that stand at ``starts``."""
        x = np.array(starts, dtype=np.float64)
        n = len(x)
        history = [(np.arange(n), x.copy())] if record else None
        still = np.zeros(n, dtype=bool)
        nothing = np.zeros_like(x)
        return cls(x, x.copy(), np.zeros(n), nothing, np.zeros(n), np.arange(n), still, 0, history)

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
    starts: Floats,
    tolerance: float,
    max_iterations: int,
    thin: Thin | None = None,
    until: int = 0,
    record: bool = False,
    own: bool = False,
    pool: Executor | None = None,
) -> Ascent:
    """Move ``starts`` [n, ...] by (10) until the mode is within ``tolerance`` bandwidths.

    ``thin`` says which trajectories go on by themselves. Ends early when at most ``until`` of them
    still move. With ``own`` each start counts as one of the points on its own way.
    """
    ascent = Ascent.from_starts(starts, record)
    moving = np.arange(len(starts))
    while moving.size > until and ascent.iterations < max_iterations:
        ascent.iterations += 1
        mine = starts[moving] if own else None
        step, density = shift(cloud, kernel, ascent.x[moving], mine, pool)
        length = manifold.norm(ascent.x[moving], step) / cloud.bandwidth
        back = _go(manifold, ascent, moving, step, density, length < NEAR)
        arrived = ascent.stretch[moving] * length <= tolerance
        ascent.converged[moving] = arrived & ~back
        if ascent.history is not None:
            ascent.history.append((moving, ascent.x[moving]))
        moving = moving[~ascent.converged[moving]]
        if thin is not None and moving.size:
            moving = thin(ascent, moving)
    return ascent


def _go(
    manifold: Manifold,
    ascent: Ascent,
    moving: Integers,
    step: Floats,
    density: Floats,
    near: npt.NDArray[np.bool_],
) -> npt.NDArray[np.bool_]:
    """One step of the ``moving``, stretched where ``near``; or back, and the plain step instead.

    A stretched step is taken back where the density fell; where the gradient is not exact, where
    the shift doubled. Returns which were.

    Near a mode the shift is about -(I - J)(x - mode). From the last step s and the change -y of
    the shift that it made, s's / s'y estimates (I - J)^-1 along the way: the stretch that would
    arrive, and with it the distance that is left. Where the shift still grows it is doubled.
    """
    last, stretch = ascent.step[moving], ascent.stretch[moving]
    axes = tuple(range(1, step.ndim))
    last2, bend = np.sum(last * last, axis=axes), np.sum(last * (last - step), axis=axes)
    if manifold.exact_gradient:
        worse = density < (1 - FALL) * ascent.density[moving]
    else:
        worse = np.sum(step * step, axis=axes) > 4.0 * last2
    back = worse & (stretch > 1)
    onward = near & ~back & (stretch > 0)
    new = np.where(onward, 2.0 * stretch, 1.0)
    np.divide(stretch * last2, bend, out=new, where=onward & (bend > 0))
    on = moving[~back]
    ascent.origin[on], ascent.step[on] = ascent.x[on], step[~back]
    ascent.density[on] = density[~back]
    ascent.stretch[moving] = np.clip(new, 1.0, MOST_STRETCH)
    go = _scaled(ascent.stretch[moving], ascent.step[moving])
    ascent.x[moving] = manifold.exp(ascent.origin[moving], go)
    return np.asarray(back)


def follow(manifold: Manifold, within: float, ascent: Ascent, moving: Integers) -> Integers:
    """Let the ``moving`` follow denser trajectories within ``within``; the others are returned."""
    alone = ascent.leader == np.arange(len(ascent.leader))
    followed = np.zeros(len(alone), dtype=bool)
    followed[ascent.leader[~alone]] = True
    followed[moving[::EVERY]] = True
    ahead = np.flatnonzero(followed & alone)
    ahead = ahead[np.argsort(-ascent.density[ahead], kind="stable")]
    rank = np.full(len(alone), len(ahead))
    rank[ahead] = np.arange(len(ahead))
    cloud = manifold.cloud(ascent.x[ahead], within, precise=False, reach=1.0)
    for start in range(0, len(moving), cloud.rows):
        block = moving[start : start + cloud.rows]
        near = cloud.seen_from(ascent.x[block]).z < 1.0
        near &= ascent.density[ahead] >= ascent.density[block, None]
        first = np.argmax(near, axis=1)
        joins = near[np.arange(len(block)), first] & (first < rank[block])
        ascent.leader[block[joins]] = ahead[first[joins]]
    return np.asarray(moving[ascent.leader[moving] == moving])


def _scaled(numbers: Floats, tangents: Floats) -> Floats:
    """Each of the ``tangents`` [m, ...] times its number [m]."""
    return np.asarray(numbers.reshape(len(tangents), *(1,) * (tangents.ndim - 1)) * tangents)
