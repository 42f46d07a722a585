"""The search for modes: every start up, ends merged, saddle points dropped, modes polished."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mssegment.manifolds import Manifold, PreparedPoints
from mssegment.meanshift.ascent import Ascent, Mask, Thin, ascend, follow
from mssegment.meanshift.kernels import Kernel
from mssegment.meanshift.modes import merge
from mssegment.records import Floats, Integers, Record, State

if TYPE_CHECKING:
    from concurrent.futures import Executor

FOLLOW_WITHIN = 0.15
"""A trajectory this near (in bandwidths) to a denser one follows it."""
STRAGGLERS = 30
"""When only one in so many still moves, the modes found so far join them on the last climb."""
WAY_TOLERANCE, MODE_TOLERANCE = 1e-2, 3e-4
"""The distance (in bandwidths) from its mode at which a trajectory, or a mode, stands still."""
PERTURBATION = 0.1
"""A mode is moved by this many bandwidths; a saddle point does not come back."""
ISOLATED = 1e-2
"""Where the kernel sum without the own point is less than this, the point is a mode by itself.

It cannot be a saddle, nothing else can end there, and its trajectory hardly moves."""


class Found(State):
    """Modes [m, ...], their densities [m], the mode of each point [n] (-1: none), and the way."""

    modes: Floats
    densities: Floats
    labels: Integers
    way: Ascent


class Search(Record, frozen=True):
    """What does not change while modes are looked for."""

    manifold: Manifold
    kernel: Kernel
    bandwidth: float
    merge_within: float
    max_iterations: int
    record: bool = False
    pool: Executor | None = None

    def prepare(self, points: Floats, precise: bool = False) -> PreparedPoints:
        """The ``points`` [n, ...] as what the density is made of."""
        return self.manifold.prepare(points, self.bandwidth, precise, self.kernel.reach(precise))

    def climb(
        self,
        prepared: PreparedPoints,
        starts: Floats,
        tolerance: float,
        thin: Thin | None = None,
        record: bool = False,
        own: bool = False,
    ) -> Ascent:
        """Move ``starts`` up the density of ``prepared``; with ``thin``, all but the stragglers."""
        return ascend(
            self.manifold,
            prepared,
            self.kernel,
            starts,
            tolerance,
            self.max_iterations,
            thin,
            until=len(starts) // STRAGGLERS if thin else 0,
            record=record,
            own=own,
            pool=self.pool,
        )

    def merge(self, x: Floats, density: Floats, within: float) -> tuple[Floats, Floats, Integers]:
        """The distinct ones of ``x``, their densities, and which one each became."""
        kept, joined = merge(self.manifold, x, density, within * self.bandwidth)
        return x[kept], density[kept], joined

    def polish(self, points: Floats, x: Floats) -> tuple[Floats, Floats, Integers]:
        """The modes ``x`` in double precision, their densities, and which one each became."""
        polished = self.climb(self.prepare(points, precise=True), x, MODE_TOLERANCE)
        return self.merge(polished.x, polished.density, self.merge_within)

    def leave_saddles(
        self, prepared: PreparedPoints, x: Floats, density: Floats, rng: np.random.Generator
    ) -> tuple[Integers, Floats]:
        """Which of the ends ``x`` may be saddles, and where perturbed copies of those have gone.

        A copy climbs until it has come back to its end (or a few are left).
        """
        push = PERTURBATION * self.bandwidth * self.manifold.random_tangent(x, rng)
        back = _ComeBack(self, x, density)
        way = self.climb(prepared, self.manifold.exp(x, push), WAY_TOLERANCE, thin=back)
        away = np.flatnonzero(~back.returned)
        return away, way.x[away]

    def settle(
        self, points: Floats, x: Floats, copies: Floats, of: Integers
    ) -> tuple[Floats, Floats, Integers]:
        """As ``polish``, from the ends ``x`` and from ``copies`` that left some ``of`` them.

        An end whose copy arrives elsewhere was a saddle: it gives way to that.
        """
        both = np.concatenate([x, copies])
        polished = self.climb(self.prepare(points, precise=True), both, MODE_TOLERANCE)
        last, place = np.arange(len(x)), len(x) + np.arange(len(of))
        apart = self.manifold.dist(polished.x[of], polished.x[place]) > 0.5 * self.bandwidth
        last[of[apart]] = place[apart]
        return self.merge(polished.x[last], polished.density[last], self.merge_within)

    def find(self, points: Floats, rng: np.random.Generator) -> Found:
        """All modes of the density of ``points`` that a trajectory from one of them reaches.

        Isolated ends stay as they are (in single precision, within 0.01 bandwidths). The others
        are merged, freed of saddles and polished in double precision, and merged again.
        """
        within = FOLLOW_WITHIN * self.bandwidth
        nearby, prepared = partial(follow, self.manifold, within), self.prepare(points)
        way = self.climb(prepared, points, WAY_TOLERANCE, thin=nearby, record=self.record)
        ends, place = np.unique(way.last_leader(), return_inverse=True)
        lonely = (way.density[ends] * len(points) < 1.0 + ISOLATED) & way.converged[ends]
        alone, social = ends[lonely], ends[~lonely]
        kept, first = merge(self.manifold, way.x[social], way.density[social], within)
        some = social[kept]
        stood = np.flatnonzero(way.converged[some])
        away, copies = self.leave_saddles(
            prepared, way.x[some[stood]], way.density[some[stood]], rng
        )
        x, density, second = self.settle(points, way.x[some], copies, stood[away])
        mode_of_end = np.empty(len(ends), dtype=np.int64)
        mode_of_end[~lonely] = second[first]
        mode_of_end[lonely] = len(x) + np.arange(len(alone))
        modes = np.concatenate([x, way.x[alone]])
        densities = np.concatenate([density, way.density[alone]])
        return Found(modes, densities, mode_of_end[place], way)


class _ComeBack:
    """Which perturbed copies of the ends ``x`` have returned to them.

    One has when it is half as far as it was and not denser: on its way out of a saddle it would be.
    """

    def __init__(self, search: Search, x: Floats, density: Floats) -> None:
        self.manifold, self.x, self.density = search.manifold, x, density
        self.within = 0.5 * PERTURBATION * search.bandwidth
        self.returned = np.zeros(len(x), dtype=bool)

    def __call__(self, ascent: Ascent, moving: Integers) -> Mask:
        """Take out what has returned; returns what has not."""
        near = self.manifold.dist(ascent.x[moving], self.x[moving]) < self.within
        back = near & (ascent.density[moving] <= self.density[moving])
        self.returned[moving] = back
        return np.asarray(~back)
