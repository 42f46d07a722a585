"""The iteration (9)-(10) of the paper, for any manifold and all starts at once.

:func:`shift` is the mean shift vector; :func:`ascend` repeats it. Four savings, none of which
changes where a trajectory arrives by more than moving its start by a hundredth of the bandwidth
would: only what still moves is iterated; a trajectory that comes within 0.15 of the bandwidth
of a denser one follows it from there; steps go further than the shift, since anything below
twice climbs as surely as once; near the mode, where that converges linearly, they are stretched
further (Barzilai and Borwein, 1988) and taken back where the density would fall.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Manifold, PreparedPoints
from mssegment.meanshift.kernels import Kernel
from mssegment.records import Floats, Integers, State

if TYPE_CHECKING:
    from concurrent.futures import Executor  # loads logging

Mask = npt.NDArray[np.bool_]

EVERY = 4
"""One trajectory in so many can be followed, besides those that already are."""
FEWEST_PAIRS = 1 << 13
"""Where the moving ones see fewer points than this together, looking for leaders costs more than
it saves."""
RELAXED = 1.6
"""How far a step goes, in shifts.

The shift maximises a quadratic lower bound of the density that touches it where the step begins;
below twice the shift that bound, and with it the density, is higher than at the beginning."""
NEAR = 0.05
"""Shifts shorter than this many bandwidths are stretched; sooner, some would change their mode."""
MOST_STRETCH = 100.0
FEWEST_BLOCKS = 4
"""Fewer blocks than this are not worth handing to other threads."""
FALL = 1e-5
"""The relative loss of density at which a stretched step is taken back (rounding is less)."""


Thin = Callable[["Ascent", Integers], Mask]
"""Called after every step with the moving trajectories; returns which go on by themselves."""


def shift(
    prepared: PreparedPoints,
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
    if len(x) <= prepared.rows:
        return _shift_block(prepared, kernel, x, own)
    step = np.empty(x.shape)
    density = np.empty(len(x))

    def fill(block: slice) -> None:
        mine = None if own is None else own[block]
        step[block], density[block] = _shift_block(prepared, kernel, x[block], mine)

    blocks = [slice(start, start + prepared.rows) for start in range(0, len(x), prepared.rows)]
    if pool is None or len(blocks) < FEWEST_BLOCKS:
        for block in blocks:
            fill(block)
    else:
        list(pool.map(fill, blocks))
    return step, density


def _shift_block(
    prepared: PreparedPoints, kernel: Kernel, x: Floats, own: Floats | None
) -> tuple[Floats, Floats]:
    """``shift`` for places that fit the cache."""
    block = prepared.block(x)
    weights, profile_sums = kernel.weigh(block.scaled_sq_dist)
    summed, total = block.weighted_sum(weights)
    profile = total if profile_sums is None else profile_sums
    if own is not None:
        z = (prepared.manifold.dist(x, own) / prepared.bandwidth)[:, None] ** 2
        profile = profile + kernel.profile(z)[:, 0]
        weight = kernel.weigh(z)[0][:, 0].astype(np.float64)
        summed = summed + _scaled(weight, prepared.manifold.neg_half_grad_sq_dist(x, own))
        total = total + weight
    return _scaled(1.0 / np.where(total > 0, total, 1.0), summed), profile / prepared.size


class Ascent(State):
    """Trajectories on their way up.

    ``x`` [n, ...] is where each one is, ``density`` [n] the density where its last step began,
    ``leader`` [n] the trajectory that it follows (itself, while on its own way), ``converged`` [n]
    where the mode is as near as was asked. Each step looks at ``size`` points.
    """

    x: Floats
    density: Floats
    leader: Integers
    converged: Mask
    size: int
    iterations: int = 0
    history: list[tuple[Integers, Floats]] | None = None

    @classmethod
    def from_starts(cls, starts: Floats, size: int, record: bool = False) -> Ascent:
        """Trajectories that stand at ``starts``."""
        x = np.array(starts, dtype=np.float64)
        n = len(x)
        history = [(np.arange(n), x.copy())] if record else None
        return cls(x, np.zeros(n), np.arange(n), np.zeros(n, dtype=bool), size, 0, history)

    def last_leader(self) -> Integers:
        """For each trajectory the one that it ends with."""
        last = self.leader
        while True:
            further = last[last]
            if np.array_equal(further, last):
                return last
            last = further

    def advance(self, active: ActiveTrajectories, arrived: Mask) -> None:
        """Note where the ``active`` is now, and which of it has ``arrived``."""
        self.iterations += 1
        self.x[active.index], self.density[active.index] = active.x, active.density
        self.converged[active.index] = arrived
        if self.history is not None:
            self.history.append((active.index, active.x))


class ActiveTrajectories(State):
    """The trajectories that still move, packed: one row each.

    ``index`` [m] says which of all they are, ``x`` where they stand, ``origin`` where the last step
    began, ``density``, ``step`` and ``step2`` the density there, the mean shift vector and its
    square, ``stretch`` how many times that vector was gone (0: not yet).
    """

    index: Integers
    x: Floats
    origin: Floats
    step: Floats
    step2: Floats
    density: Floats
    stretch: Floats

    @classmethod
    def from_starts(cls, starts: Floats) -> ActiveTrajectories:
        """All of the ``starts`` move."""
        n = len(starts)
        x = np.asarray(starts, dtype=np.float64)
        return cls(np.arange(n), x, x, np.zeros_like(x), np.zeros(n), np.zeros(n), np.zeros(n))

    def keep(self, on: Mask) -> None:
        """Only those that go ``on`` stay."""
        rows = on.nonzero()[0]
        if len(rows) == len(on):
            return
        for name in ("index", "x", "origin", "step", "step2", "density", "stretch"):
            setattr(self, name, getattr(self, name).take(rows, axis=0))

    def go(
        self, manifold: Manifold, step: Floats, density: Floats, length: Floats, tolerance: float
    ) -> Mask:
        """One step along the shift ``step`` [m, ...] at ``x``, of ``length`` bandwidths [m].

        A step that went too far is taken back, and the plain one gone instead: where the density
        fell; where the gradient is not exact, where the shift doubled. Returns which have arrived.
        """
        step2 = _dot(step, step)
        if manifold.exact_gradient:
            back = density < (1 - FALL) * self.density
        else:
            back = step2 > 4.0 * self.step2
        back &= self.stretch > 1
        stretch = self._stretches(step, np.where(length < NEAR, MOST_STRETCH, RELAXED))
        arrived = stretch * length <= tolerance
        origin = self.x
        if back.any():
            stretch[back], arrived[back] = 1.0, False
            origin = origin.copy()
            for new, old in (
                (origin, self.origin),
                (step, self.step),
                (step2, self.step2),
                (density, self.density),
            ):
                new[back] = old[back]
        self.origin, self.step, self.step2, self.density = origin, step, step2, density
        self.stretch = stretch
        self.x = manifold.exp(origin, _scaled(stretch, step))
        return np.asarray(arrived)

    def _stretches(self, step: Floats, most: Floats) -> Floats:
        """How many times the shift ``step`` to go: 1 at first, then at ``most`` so often.

        Near a mode the shift is about -(I - J)(x - mode). From the last step s and the change -y of
        the shift that it made, s's / s'y estimates (I - J)^-1 along the way: the stretch that would
        arrive, and with it the distance that is left. Where the shift still grows it is doubled.
        """
        bend = self.step2 - _dot(self.step, step)
        stretch = 2.0 * self.stretch
        np.divide(self.stretch * self.step2, bend, out=stretch, where=bend > 0)
        return np.minimum(np.maximum(stretch, 1.0), most)


def ascend(
    manifold: Manifold,
    prepared: PreparedPoints,
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
    ascent, active = (
        Ascent.from_starts(starts, prepared.size, record),
        ActiveTrajectories.from_starts(starts),
    )
    while active.index.size > until and ascent.iterations < max_iterations:
        mine = starts[active.index] if own else None
        step, density = shift(prepared, kernel, active.x, mine, pool)
        length = manifold.norm(active.x, step) / prepared.bandwidth
        arrived = active.go(manifold, step, density, length, tolerance)
        ascent.advance(active, arrived)
        active.keep(~arrived)
        if thin is not None and active.index.size:
            active.keep(thin(ascent, active.index))
    return ascent


def follow(manifold: Manifold, within: float, ascent: Ascent, moving: Integers) -> Mask:
    """Let the ``moving`` follow denser trajectories within ``within``; which do not is returned."""
    if len(moving) * ascent.size < FEWEST_PAIRS:
        return np.ones(len(moving), dtype=bool)
    alone = ascent.leader == np.arange(len(ascent.leader))
    followed = np.zeros(len(alone), dtype=bool)
    followed[ascent.leader[~alone]] = True
    followed[moving[::EVERY]] = True
    ahead = np.flatnonzero(followed & alone)
    ahead = ahead[np.argsort(-ascent.density[ahead], kind="stable")]
    rank = np.full(len(alone), len(ahead))
    rank[ahead] = np.arange(len(ahead))
    prepared = manifold.prepare(ascent.x[ahead], within, precise=False, reach=1.0)
    for start in range(0, len(moving), prepared.rows):
        block = moving[start : start + prepared.rows]
        near = prepared.block(ascent.x[block]).scaled_sq_dist < 1.0
        near &= ascent.density[ahead] >= ascent.density[block, None]
        first = np.argmax(near, axis=1)
        joins = near[np.arange(len(block)), first] & (first < rank[block])
        ascent.leader[block[joins]] = ahead[first[joins]]
    return np.asarray(ascent.leader[moving] == moving)


def _dot(u: Floats, v: Floats) -> Floats:
    """The sums [m] of the products of all entries of each of ``u`` and ``v`` [m, ...]."""
    m = len(u)
    return np.asarray(np.einsum("mi,mi->m", u.reshape(m, -1), v.reshape(m, -1)))


def _numbers(numbers: npt.NDArray[Any], like: Floats) -> npt.NDArray[Any]:
    """One number per row of ``like``, shaped so that it spreads over the row."""
    return numbers.reshape(len(like), *(1,) * (like.ndim - 1))


def _scaled(numbers: Floats, tangents: Floats) -> Floats:
    """Each of the ``tangents`` [m, ...] times its number [m]."""
    return np.asarray(_numbers(numbers, tangents) * tangents)
