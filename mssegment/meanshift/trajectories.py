"""The state of the mean shift trajectories, and the step that each of them takes."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Manifold
from mssegment.progress import report
from mssegment.records import Floats, Integers, State

Mask = npt.NDArray[np.bool_]

OVERRELAXATION = 1.6
"""The usual step, in shifts.

The shift maximises a quadratic lower bound of the density that touches it at the start of the step.
Below twice the shift that bound, and with it the density, is higher than at the start."""
EXTRAPOLATE_BELOW = 0.05
"""Steps are extrapolated where the shift is shorter than this many bandwidths. Where it is longer,
some trajectories would change their mode."""
MAX_STEP_FACTOR = 100.0
"""The longest extrapolated step, in shifts."""
MAX_LEAP = 0.25
"""The longest extrapolated step, in bandwidths: beside a ridge of the density, where shifts are
short too, longer ones reach another mode."""
MAX_DENSITY_LOSS = 1e-5
"""The relative loss of density from which a step is rejected (rounding errors are smaller)."""


class Ascent(State):
    """The state of n trajectories.

    Attributes
    ----------
    x
        The current points [n, ...].
    density
        The density where the last step began [n].
    leader
        The index of the trajectory that each one follows [n], its own while it follows none.
    converged
        Whether the mode is within the tolerance [n].
    size
        The number of data points.
    iterations
        The number of steps so far.
    history
        The indices and points of the active trajectories after every step, the starts first; None
        unless they are recorded.
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
        """The state before the first step: trajectories at ``starts`` [n, ...]."""
        x = np.array(starts, dtype=np.float64)
        n = len(x)
        history = [(np.arange(n), x.copy())] if record else None
        return cls(x, np.zeros(n), np.arange(n), np.zeros(n, dtype=bool), size, 0, history)

    def final_leader(self) -> Integers:
        """The last leader of the chain that each trajectory follows [n]."""
        last = self.leader
        while True:
            following = last[last]
            if np.array_equal(following, last):
                return last
            last = following

    def update(self, active: ActiveTrajectories, converged: Mask) -> None:
        """Take over points, densities and convergence of the ``active`` trajectories."""
        self.iterations += 1
        self.x[active.index], self.density[active.index] = active.x, active.density
        self.converged[active.index] = converged
        report(int(self.converged.sum()), len(self.converged), "trajectories")
        if self.history is not None:
            self.history.append((active.index, active.x))

    def paths(self) -> list[list[Floats]]:
        """The recorded points of each trajectory, the start first; empty without ``history``."""
        paths: list[list[Floats]] = [[] for _ in self.x]
        for index, x in self.history or []:
            for i, point in zip(index, x, strict=True):
                paths[i].append(point)
        return paths


class ActiveTrajectories(State):
    """The trajectories that have not converged, packed: one row each.

    Attributes
    ----------
    index
        Their indices among all trajectories [m].
    x
        The current points [m, ...].
    origin
        Where the last step began [m, ...].
    step, step2
        The mean shift vector there [m, ...], and the sum of its squared entries [m].
    density
        The density there [m].
    factor
        The length of the last step in shifts [m], 0 before the first step.
    length
        The norm of the shift at the origin of the last step, in bandwidths [m].
    """

    index: Integers
    x: Floats
    origin: Floats
    step: Floats
    step2: Floats
    density: Floats
    factor: Floats
    length: Floats

    @classmethod
    def from_starts(cls, starts: Floats) -> ActiveTrajectories:
        """All trajectories, at ``starts`` [n, ...]."""
        n = len(starts)
        x = np.asarray(starts, dtype=np.float64)
        numbers = [np.zeros(n) for _ in range(4)]
        return cls(np.arange(n), x, x, np.zeros_like(x), *numbers)

    def keep(self, mask: Mask) -> None:
        """Drop the rows outside of ``mask`` [m]."""
        rows = mask.nonzero()[0]
        if len(rows) == len(mask):
            return
        for name in self.__struct_fields__:
            setattr(self, name, getattr(self, name).take(rows, axis=0))

    def take_step(
        self,
        manifold: Manifold,
        step: Floats,
        density: Floats,
        length: Floats,
        tolerance: float,
        accelerated: bool = True,
    ) -> Mask:
        """One step from ``x`` along the shift ``step`` [m, ...]; returns which have converged [m].

        ``density`` [m] is that at ``x``, ``length`` [m] the norm of the shift in bandwidths. A
        trajectory has converged where the estimated distance to the mode is within ``tolerance``.
        A last step of more than one shift is rejected, and one of a single shift taken instead,
        where the density fell; or, where the gradient is not exact, where the shift doubled. Where
        the density falls along a single shift, which the curvature of a group can bring about at
        distances of several units, the step is halved.
        """
        step2 = _dot(step, step)
        if manifold.exact_gradient:
            rejected = ~(density >= (1 - MAX_DENSITY_LOSS) * self.density)
            rejected &= np.isnan(density) | (self.factor > (0.0 if accelerated else 1.0))
        else:
            rejected = (step2 > 4.0 * self.step2) & (self.factor > 1)
        longest: Floats | float = 1.0
        if accelerated:
            far = np.minimum(MAX_STEP_FACTOR, MAX_LEAP / np.maximum(length, 1e-12))
            longest = np.where(length < EXTRAPOLATE_BELOW, far, OVERRELAXATION)
        factor = self._step_factors(step, longest)
        converged = factor * length <= tolerance
        origin = self.x
        if rejected.any():
            origin = origin.copy()
            for new, old in (
                (origin, self.origin),
                (step, self.step),
                (step2, self.step2),
                (density, self.density),
                (length, self.length),
            ):
                new[rejected] = old[rejected]
            last = self.factor[rejected]
            factor[rejected] = np.where(last > 1, 1.0, 0.5 * last)
            converged[rejected] = (last <= 1) & (factor * length <= tolerance)[rejected]
        self.origin, self.step, self.step2, self.density = origin, step, step2, density
        self.factor, self.length = factor, length
        self.x = manifold.exp(origin, scaled(factor, step))
        return np.asarray(converged)

    def _step_factors(self, step: Floats, longest: Floats | float) -> Floats:
        """How many shifts ``step`` to go [m]: from 1, for the first step, to ``longest``.

        Near a mode the shift is about -(I - J)(x - mode). From the last step s and the change -y of
        the shift along it, s's / s'y estimates (I - J)^-1 in that direction: the factor with which
        a step would reach the mode. Where the shift still grows, the factor is doubled.
        """
        decrease = self.step2 - _dot(self.step, step)
        factor = 2.0 * self.factor
        np.divide(self.factor * self.step2, decrease, out=factor, where=decrease > 0)
        return np.minimum(np.maximum(factor, 1.0), longest)


def scaled(numbers: Floats, tangents: Floats) -> Floats:
    """Each of the ``tangents`` [m, ...] times its number [m]."""
    return np.asarray(_per_row(numbers, tangents) * tangents)


def _dot(u: Floats, v: Floats) -> Floats:
    """The sums [m] of the products of the entries of ``u`` and ``v`` [m, ...]."""
    m = len(u)
    return np.asarray(np.einsum("mi,mi->m", u.reshape(m, -1), v.reshape(m, -1)))


def _per_row(numbers: npt.NDArray[Any], like: Floats) -> npt.NDArray[Any]:
    """``numbers`` [m] shaped to multiply ``like`` [m, ...] row by row."""
    return numbers.reshape(len(like), *(1,) * (like.ndim - 1))
