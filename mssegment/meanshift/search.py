"""The search for modes: ascend from all points, merge the ends, drop saddle points, refine."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mssegment.manifolds import Manifold, PreparedPoints
from mssegment.meanshift.ascent import OnStep, Prune, ascend, follow
from mssegment.meanshift.density import PointWeights
from mssegment.meanshift.kernels import Kernel
from mssegment.meanshift.modes import merge
from mssegment.meanshift.trajectories import Ascent, Mask, scaled
from mssegment.records import Floats, Integers, Record, State

if TYPE_CHECKING:
    from concurrent.futures import Executor

FOLLOW_WITHIN = 0.15
"""A trajectory follows a denser one that is nearer than this many bandwidths."""
FOLLOW_COMPACT = 1e-3
"""The same for kernels of compact support, whose densities have modes near each other."""
STRAGGLERS = 30
"""When only one trajectory in this many is active, the pass ends; the rest is refined together
with the modes."""
TRAJECTORY_TOLERANCE, MODE_TOLERANCE = 1e-2, 3e-4
"""The distance from the mode, in bandwidths, at which a trajectory, or a refined mode, ends."""
COMPACT_TOLERANCE = 1e-6
"""Both for kernels of compact support: a short step may still change which points are inside, and
then be followed by long ones; where it does not, the plain steps end after finitely many."""
PERTURBATION = 0.1
"""The perturbation of a possible saddle point, in bandwidths; a mode attracts it again."""
NOT_VERY_NEAR = 0.5
"""The perturbation is towards the nearest point that is further than this many bandwidths."""
ISOLATED = 1e-2
"""A point is isolated where the kernel sum without its own term is less than this.

It is a mode and no saddle point, no other trajectory can end there, and its own hardly moves."""


class SearchResult(State):
    """The modes of a density.

    Attributes
    ----------
    modes
        The modes [m, ...].
    densities
        The kernel densities there [m].
    labels
        The mode of each point [n], -1 for none.
    ascent
        The trajectories that led there.
    """

    modes: Floats
    densities: Floats
    labels: Integers
    ascent: Ascent


class ModeSearch(Record, frozen=True):
    """The settings of a search for modes, and its steps.

    Attributes
    ----------
    manifold, kernel, bandwidth
        What defines the density (7).
    merge_within
        Modes that are nearer than this many bandwidths are merged.
    max_iterations
        The largest number of steps of a pass.
    record
        Whether to record the trajectories.
    pool
        Threads that share the work.
    precise
        Whether the trajectories are computed in double precision too, as the modes always are.
    point_weights
        Weights or bandwidths of the single points; without them all are equal.
    on_step
        Called after every step.
    """

    manifold: Manifold
    kernel: Kernel
    bandwidth: float
    merge_within: float = 1.0
    max_iterations: int = 500
    record: bool = False
    pool: Executor | None = None
    precise: bool = False
    point_weights: PointWeights | None = None
    on_step: OnStep | None = None

    def prepare(self, points: Floats, precise: bool = False) -> PreparedPoints:
        """The data points [n, ...] of the density."""
        precise = precise or self.precise
        cutoff = self.kernel.cutoff(precise)
        if self.point_weights is not None:
            cutoff /= float(np.sqrt(self.point_weights.scale.min(initial=1.0)))
        return self.manifold.prepare(points, self.bandwidth, precise, cutoff)

    def ascend(
        self,
        prepared: PreparedPoints,
        starts: Floats,
        tolerance: float,
        prune: Prune | None = None,
        record: bool = False,
        include_start: bool = False,
    ) -> Ascent:
        """Run the mean shift loop from ``starts``; with ``prune``, leave out the stragglers."""
        if self.kernel.compact:
            tolerance = COMPACT_TOLERANCE
        return ascend(
            prepared,
            self.kernel,
            starts,
            tolerance=tolerance,
            max_iterations=self.max_iterations,
            accelerated=not self.kernel.compact,
            prune=prune,
            max_unfinished=len(starts) // STRAGGLERS if prune else 0,
            include_start=include_start,
            record=record,
            pool=self.pool,
            point_weights=self.point_weights,
            on_step=self.on_step,
        )

    def merge(self, x: Floats, density: Floats, within: float) -> tuple[Floats, Floats, Integers]:
        """Merge the points ``x`` [n, ...]: the kept ones, their densities, the assignment [n]."""
        kept, assignment = merge(self.manifold, x, density, within * self.bandwidth)
        return x[kept], density[kept], assignment

    def refine(self, points: Floats, x: Floats) -> tuple[Floats, Floats, Integers]:
        """Refine the modes ``x`` in double precision and merge them, as ``merge``."""
        refined = self.ascend(self.prepare(points, precise=True), x, MODE_TOLERANCE)
        return self.merge(refined.x, refined.density, self.merge_within)

    def escape_saddles(
        self,
        points: Floats,
        prepared: PreparedPoints,
        x: Floats,
        density: Floats,
        rng: np.random.Generator,
    ) -> tuple[Integers, Floats]:
        """Perturb the ends ``x`` and ascend again, until most have returned to their end.

        Returns the indices of those that have not returned, which may be saddle points, and where
        their perturbed copies are.
        """
        directions, reach = self._directions(points, prepared, x, rng)
        # a bandwidth far wider than the data must not push the ends out of them
        push = self.bandwidth * min(PERTURBATION, reach or PERTURBATION)
        check = _ReturnCheck(self, x, density, push)
        perturbed = self.manifold.exp(x, push * directions)
        ascent = self.ascend(prepared, perturbed, TRAJECTORY_TOLERANCE, prune=check)
        escaped = np.flatnonzero(~check.returned)
        return escaped, ascent.x[escaped]

    def _directions(
        self, points: Floats, prepared: PreparedPoints, x: Floats, rng: np.random.Generator
    ) -> tuple[Floats, float]:
        """Unit tangents at ``x`` to the nearest of the points that are not very near.

        With them the distance to the farthest of the points, in bandwidths. Unlike random ones
        they do not depend on coordinates, nor on the order of the points. Random ones replace those
        that do not exist.
        """
        directions = self.manifold.random_tangent(x, rng)
        farthest = 0.0
        for start in range(0, len(x), prepared.block_rows):
            rows = slice(start, start + prepared.block_rows)
            z = prepared.block(x[rows]).scaled_sq_dist
            farthest = max(farthest, float(z.max(initial=0.0, where=np.isfinite(z))))
            z[z < NOT_VERY_NEAR**2] = np.inf
            nearest = np.argmin(z, axis=1)
            pull = self.manifold.neg_half_grad_sq_dist(x[rows], points[nearest])
            length = self.manifold.norm(x[rows], pull)
            usable = np.isfinite(z[np.arange(len(z)), nearest]) & (length > 0)
            directions[rows][usable] = scaled(1.0 / length[usable], pull[usable])
        return directions, float(np.sqrt(farthest))

    def refine_without_saddles(
        self, points: Floats, x: Floats, copies: Floats, of: Integers
    ) -> tuple[Floats, Floats, Integers]:
        """As ``refine``, given ``copies`` that escaped from some ``of`` the ends ``x``.

        An end whose copy converges elsewhere is a saddle point and replaced by that.
        """
        both = np.concatenate([x, copies])
        refined = self.ascend(self.prepare(points, precise=True), both, MODE_TOLERANCE)
        final, place = np.arange(len(x)), len(x) + np.arange(len(of))
        saddle = self.manifold.dist(refined.x[of], refined.x[place]) > 0.5 * self.bandwidth
        final[of[saddle]] = place[saddle]
        return self.merge(refined.x[final], refined.density[final], self.merge_within)

    def find(self, points: Floats, rng: np.random.Generator) -> SearchResult:
        """The modes of the density of ``points`` [n, ...] at which a trajectory from one ends.

        Isolated points stay as they are, in single precision, within 0.01 bandwidths of the mode.
        The other ends are merged, saddle points are dropped, and the modes are refined in double
        precision and merged again.
        """
        within = FOLLOW_WITHIN * self.bandwidth
        if self.kernel.compact:
            within = FOLLOW_COMPACT * self.bandwidth
        prune, prepared = partial(follow, self.manifold, within), self.prepare(points)
        ascent = self.ascend(prepared, points, TRAJECTORY_TOLERANCE, prune, self.record)
        ends, end_of_point = np.unique(ascent.final_leader(), return_inverse=True)
        isolated = (ascent.density[ends] * len(points) < 1.0 + ISOLATED) & ascent.converged[ends]
        # alone in a compact kernel, but a mode may still be nearer than modes are kept apart
        if self.point_weights is not None or self.kernel.compact:
            isolated[:] = False
        single, shared = ends[isolated], ends[~isolated]
        kept, first = merge(self.manifold, ascent.x[shared], ascent.density[shared], within)
        merged = shared[kept]
        # flat regions of compact kernels are no saddle points, and any push may leave them
        at_rest = np.flatnonzero(ascent.converged[merged] & (not self.kernel.compact))
        suspects = merged[at_rest]
        escaped, copies = self.escape_saddles(
            points, prepared, ascent.x[suspects], ascent.density[suspects], rng
        )
        x, density, second = self.refine_without_saddles(
            points, ascent.x[merged], copies, at_rest[escaped]
        )
        mode_of_end = np.empty(len(ends), dtype=np.int64)
        mode_of_end[~isolated] = second[first]
        mode_of_end[isolated] = len(x) + np.arange(len(single))
        modes = np.concatenate([x, ascent.x[single]])
        densities = np.concatenate([density, ascent.density[single]])
        return SearchResult(modes, densities, mode_of_end[end_of_point], ascent)


class _ReturnCheck:
    """Which perturbed copies have returned to their ends ``x``: a ``Prune``.

    One has when its distance is half the perturbation and its density no higher than at the end;
    one that leaves a saddle point gets denser.
    """

    def __init__(self, search: ModeSearch, x: Floats, density: Floats, push: float) -> None:
        self.manifold, self.x, self.density = search.manifold, x, density
        self.within = 0.5 * push
        self.returned = np.zeros(len(x), dtype=bool)

    def __call__(self, ascent: Ascent, active: Integers) -> Mask:
        """Note which copies have returned; the mask of the others."""
        near = self.manifold.dist(ascent.x[active], self.x[active]) < self.within
        returned = near & (ascent.density[active] <= self.density[active])
        self.returned[active] = returned
        return np.asarray(~returned)
