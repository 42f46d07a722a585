"""The mean shift iteration (9)-(10) of the paper, for any manifold and all starts at once.

:func:`shift` computes the mean shift vectors; :func:`ascend` is the only loop that repeats them.
With ``accelerated=False`` it takes the plain steps of (10). By default it saves work in four ways:

- only the trajectories that have not converged are iterated;
- the caller may stop further ones through ``prune``, see :func:`follow`;
- a step is longer than the shift: the density rises along it up to twice the shift;
- near a mode, where plain steps converge linearly, the step length is extrapolated (Barzilai and
  Borwein, 1988), and a step after which the density is lower is rejected.

Notes
-----
How far this changes the result is measured by ``python -m benchmarks.plain``, on nine data sets at
four bandwidths, against an implementation that shares no code: with the Gaussian and the truncated
Gaussian kernel at most about 1 % of the points reach another mode. The density of a kernel of
compact support (``Kernel.compact``) has flat regions and many modes near each other, between which
longer steps would jump: there only plain steps are taken, to the end, and trajectories follow each
other only where they meet; at most about 2 % of the points reach another mode.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from mssegment.manifolds import Manifold, PreparedPoints
from mssegment.meanshift.density import PointWeights
from mssegment.meanshift.kernels import Kernel
from mssegment.meanshift.trajectories import ActiveTrajectories, Ascent, Mask, scaled
from mssegment.records import Floats, Integers

if TYPE_CHECKING:
    from concurrent.futures import Executor  # loads logging

LEADER_STRIDE = 4
"""Every fourth active trajectory, in the order of density, may be followed, besides those that are
followed already."""
MIN_PAIRS_TO_FOLLOW = 1 << 13
"""Below this many pairs of active trajectories and points, :func:`follow` costs more than it
saves."""
MIN_BLOCKS_FOR_THREADS = 4
"""With fewer blocks than this, handing them to threads costs more than it saves."""


Prune = Callable[[Ascent, Integers], Mask]
"""Called after every step with the state and the active trajectories [m]; returns a mask [m] of
those that stay active."""

OnStep = Callable[[int, int], None]
"""Called with the number of steps so far and the number of active trajectories."""


def shift(
    prepared: PreparedPoints,
    kernel: Kernel,
    x: Floats,
    extra: Floats | None = None,
    pool: Executor | None = None,
    point_weights: PointWeights | None = None,
) -> tuple[Floats, Floats]:
    """Mean shift vectors (9) and kernel densities (7).

    Parameters
    ----------
    prepared
        The n data points, with the bandwidth h.
    kernel
        The kernel profile k.
    x
        Where to evaluate, points of the manifold [m, ...].
    extra
        One further data point for each row of ``x`` [m, ...]: it enters the sums of that row, but
        not n.
    pool
        Threads that share the blocks of rows. The result does not depend on it.
    point_weights
        Weights or bandwidths of the single points; without them all are equal.

    Returns
    -------
    step
        The mean shift vectors, tangents at ``x`` [m, ...].
    density
        The mean of k(d^2 / h^2) over the data points [m]: (7) without the constant c_{k,h}.

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.manifolds import Euclidean
    >>> from mssegment.meanshift import KERNELS
    >>> prepared = Euclidean(1).prepare(np.array([[0.0], [1.0]]), bandwidth=2.0)
    >>> step, density = shift(prepared, KERNELS["epanechnikov"], np.array([[0.0]]))
    >>> step.tolist(), density.tolist()
    ([[0.5]], [0.875])
    """
    if len(x) <= prepared.block_rows:
        return _shift_block(prepared, kernel, x, extra, point_weights)
    step = np.empty(x.shape)
    density = np.empty(len(x))

    def fill(rows: slice) -> None:
        own = None if extra is None else extra[rows]
        step[rows], density[rows] = _shift_block(prepared, kernel, x[rows], own, point_weights)

    starts = range(0, len(x), prepared.block_rows)
    blocks = [slice(start, start + prepared.block_rows) for start in starts]
    if pool is None or len(blocks) < MIN_BLOCKS_FOR_THREADS:
        for rows in blocks:
            fill(rows)
    else:
        list(pool.map(fill, blocks))
    return step, density


def _shift_block(
    prepared: PreparedPoints,
    kernel: Kernel,
    x: Floats,
    extra: Floats | None,
    point_weights: PointWeights | None,
) -> tuple[Floats, Floats]:
    """``shift`` for so few rows that they fit the cache."""
    block = prepared.block(x)
    if point_weights is not None:
        z = point_weights.scaled(block.scaled_sq_dist)
        sums = np.asarray(kernel.profile(z) @ point_weights.profile, dtype=np.float64)
        weights, _ = kernel.weights(z)
        summed, total = block.weighted_sum(weights * point_weights.gradient.astype(z.dtype))
        step = scaled(1.0 / np.where(total > 0, total, 1.0), summed)
        return step, sums / point_weights.total
    weights, profile_sums = kernel.weights(block.scaled_sq_dist)
    summed, total = block.weighted_sum(weights)
    profile = total if profile_sums is None else profile_sums
    if extra is not None:
        z = (prepared.manifold.dist(x, extra) / prepared.bandwidth)[:, None] ** 2
        profile = profile + kernel.profile(z)[:, 0]
        weight = kernel.weights(z)[0][:, 0].astype(np.float64)
        summed = summed + scaled(weight, prepared.manifold.neg_half_grad_sq_dist(x, extra))
        total = total + weight
    return scaled(1.0 / np.where(total > 0, total, 1.0), summed), profile / prepared.size


def ascend(
    prepared: PreparedPoints,
    kernel: Kernel,
    starts: Floats,
    *,
    tolerance: float,
    max_iterations: int,
    accelerated: bool = True,
    prune: Prune | None = None,
    max_unfinished: int = 0,
    include_start: bool = False,
    record: bool = False,
    pool: Executor | None = None,
    point_weights: PointWeights | None = None,
    on_step: OnStep | None = None,
) -> Ascent:
    """Iterate (10) from all starts at once: the mean shift loop.

    Parameters
    ----------
    prepared
        The data points, with the bandwidth.
    kernel
        The kernel profile.
    starts
        Where the trajectories start, points of the manifold [n, ...].
    tolerance
        A trajectory has converged when its next step is no longer than this many bandwidths. With
        ``accelerated`` that step is an estimate of the distance to the mode.
    max_iterations
        The largest number of steps.
    accelerated
        Whether steps may be longer than the shift. Without it, they are those of (10).
    prune
        Called after every step, see :data:`Prune`; for instance :func:`follow`.
    max_unfinished
        Stop when no more than this many trajectories are active.
    include_start
        Count each start as one more data point for its own trajectory.
    record
        Keep all points in ``history``.
    pool
        Threads that share the work. The result does not depend on it.
    point_weights
        Weights or bandwidths of the single points; without them all are equal.
    on_step
        Called after every step, see :data:`OnStep`.

    Returns
    -------
    Ascent
        The final state. The last step of a converged trajectory has been taken; its density is the
        one before that step.

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.manifolds import Euclidean
    >>> from mssegment.meanshift import KERNELS
    >>> points = np.array([[2.0, 2.0], [2.0, 3.0], [9.0, 9.0]])
    >>> prepared = Euclidean(2).prepare(points, bandwidth=1.0)
    >>> found = ascend(prepared, KERNELS["gaussian"], points, tolerance=1e-6, max_iterations=500)
    >>> found.x.round(3).tolist()
    [[2.0, 2.5], [2.0, 2.5], [9.0, 9.0]]
    """
    manifold = prepared.manifold
    ascent = Ascent.from_starts(starts, prepared.size, record)
    active = ActiveTrajectories.from_starts(starts)
    while active.index.size > max_unfinished and ascent.iterations < max_iterations:
        extra = starts[active.index] if include_start else None
        step, density = shift(prepared, kernel, active.x, extra, pool, point_weights)
        length = manifold.norm(active.x, step) / prepared.bandwidth
        converged = active.take_step(manifold, step, density, length, tolerance, accelerated)
        ascent.update(active, converged)
        active.keep(~converged)
        if on_step is not None:
            on_step(ascent.iterations, active.index.size)
        if prune is not None and active.index.size:
            active.keep(prune(ascent, active.index))
    return ascent


def follow(manifold: Manifold, within: float, ascent: Ascent, active: Integers) -> Mask:
    """Let ``active`` trajectories [m] follow denser ones that are nearer than ``within``.

    Sets their ``leader``; returns the mask [m] of those that follow none.
    """
    if len(active) * ascent.size < MIN_PAIRS_TO_FOLLOW:
        return np.ones(len(active), dtype=bool)
    independent = ascent.leader == np.arange(len(ascent.leader))
    candidate = np.zeros(len(independent), dtype=bool)
    candidate[ascent.leader[~independent]] = True
    by_density = active[np.argsort(-ascent.density[active], kind="stable")]
    candidate[by_density[::LEADER_STRIDE]] = True
    leaders = np.flatnonzero(candidate & independent)
    leaders = leaders[np.argsort(-ascent.density[leaders], kind="stable")]
    rank = np.full(len(independent), len(leaders))
    rank[leaders] = np.arange(len(leaders))
    prepared = manifold.prepare(ascent.x[leaders], within, precise=False, cutoff=1.0)
    for start in range(0, len(active), prepared.block_rows):
        block = active[start : start + prepared.block_rows]
        near = prepared.block(ascent.x[block]).scaled_sq_dist < 1.0
        near &= ascent.density[leaders] >= ascent.density[block, None]
        first = np.argmax(near, axis=1)
        joins = near[np.arange(len(block)), first] & (first < rank[block])
        ascent.leader[block[joins]] = leaders[first[joins]]
    return np.asarray(ascent.leader[active] == active)
