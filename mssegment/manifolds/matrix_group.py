"""Matrix Lie groups: what A(2) and SL(3) share (section 4.2 of the paper).

Points are matrices x with the left-invariant inner product g_x(u, v) = tr((x^-1 u)' x^-1 v), so
that (18)-(20) need only the matrix exponential and the logarithm of the group. That one works on
arrays with the *matrix axes first*, shape (r, s, ...), where every entry is one contiguous array
over all pairs of points; r may leave out constant last rows.
"""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from typing import ClassVar

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import (
    CACHE_NUMBERS,
    Array,
    KernelBlock,
    Manifold,
    PreparedPoints,
    precision,
)
from mssegment.manifolds.matrices import bernoulli, exponential, inverse, length2, solve
from mssegment.records import Floats, Integers

BERNOULLI_TERMS = 40
FARTHEST = 3.0
"""Where pairs further apart than this matter, looking for those that do not saves nothing."""
SLACK = 1.001
"""Rounding must not leave out what is just within reach."""
SPARE = 8
"""Pairs more than twice as many as are asked for, among which the nearest ones are looked for."""
DENSE = 0.5
"""The share of pairs within reach above which all logarithms at once are faster."""


class MatrixGroup(Manifold):
    """A group of s x s matrices with the distance (20), |log x^-1 y|_F.

    That is left-invariant but breaks the triangle inequality, and is infinite where x^-1 y has no
    real logarithm. The attraction is log (21), a first-order approximation of -1/2 grad d^2 (10 %
    off at |log| = 0.3); with ``exact`` it is the true gradient.
    """

    is_metric = False
    left_invariant = True
    family: ClassVar[str]
    """The name without arguments."""
    order: ClassVar[int]
    """The n of its name: A(2), SL(3)."""
    rows: int
    """The rows of a matrix that are not constant."""
    size: int
    """Matrices are size x size."""

    def __init__(self, exact: bool = False) -> None:
        self.exact_gradient = exact

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> MatrixGroup:
        """The group from ``(order,)`` or ``(order, "exact")``."""
        if arguments not in ((str(cls.order),), (str(cls.order), "exact")):
            found, names = ",".join(arguments), " or ".join(cls.examples)
            raise ConfigurationError(f"no manifold is called {cls.family}({found}): use {names}")
        return cls(exact=len(arguments) == 2)

    @property
    def name(self) -> str:
        """``family(order)``, with ``,exact`` where the gradient is exact."""
        return f"{self.family}({self.order}{',exact' if self.exact_gradient else ''})"

    @abstractmethod
    def algebra_log(self, m: Array, within: float = np.inf) -> Array:
        """The principal matrix logarithm (17) of ``m`` (rows, size, ...); NaN if not real.

        Those longer than ``within`` may be NaN, too.
        """

    @abstractmethod
    def onto_algebra(self, v: Array) -> Array:
        """The orthogonal projection of ``v`` (rows, size, ...) onto the Lie algebra."""

    @property
    def point_shape(self) -> tuple[int, ...]:
        """``(size, size)``."""
        return (self.size, self.size)

    def _first(self, x: Floats) -> Floats:
        """Matrices (..., size, size) with the matrix axes first, constant rows left out."""
        return np.ascontiguousarray(np.moveaxis(x, (-2, -1), (0, 1))[: self.rows])

    def _last(self, m: Array) -> Floats:
        """The inverse of ``_first`` for elements of the algebra: a constant row is zero."""
        whole = np.zeros((self.size, self.size, *m.shape[2:]))
        whole[: self.rows] = m
        return np.ascontiguousarray(np.moveaxis(whole, (0, 1), (-2, -1)))

    def exp(self, x: Floats, v: Floats) -> Floats:
        """Equation (18), x exp(x^-1 v)."""
        return np.asarray(x @ exponential(solve(x, v)))

    def log(self, x: Floats, y: Floats) -> Floats:
        """Equation (19), x log(x^-1 y); NaN where there is no real logarithm."""
        return np.asarray(x @ self._last(self.algebra_log(self._first(solve(x, y)))))

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """tr((x^-1 u)' x^-1 v), the left-invariant inner product that belongs to (20)."""
        return np.asarray(np.sum(solve(x, u) * solve(x, v), axis=(-2, -1)))

    def norm(self, x: Floats, v: Floats) -> Floats:
        """|x^-1 v|_F."""
        return np.asarray(np.linalg.norm(solve(x, v), axis=(-2, -1)))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (20), |log x^-1 y|_F; infinite where there is no real logarithm."""
        return np.sqrt(length2(self.algebra_log(self._first(solve(x, y))))).astype(np.float64)

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (21), log_x(y), or the exact -1/2 grad d^2; zero where d is infinite."""
        pull = self.pull_of(self.algebra_log(self._first(solve(x, y))))
        return np.asarray(x @ self._last(np.nan_to_num(pull, nan=0.0)))

    def pull_of(self, log: Array) -> Array:
        """x^-1 times -1/2 grad d^2 from ``log`` = log(x^-1 y) (rows, size, ...).

        Exact: d log(exp(-tE) exp X) / dt = -B(ad_X) E with B(z) = z / (e^z - 1), so the gradient
        is the adjoint series B(ad_X)* X, with ad_X* Z the part of [X', Z] in the algebra. It
        converges while eigenvalues of X differ by less than 2 pi.
        """
        if not self.exact_gradient:
            return log
        term = log
        total = log.copy()
        for i, coefficient in enumerate(bernoulli(2 * BERNOULLI_TERMS), start=1):
            term = self._adjoint(log, term)
            total += coefficient * term
            if i % 2 == 0 and not np.nanmax(np.abs(term), initial=0.0) * abs(coefficient) > 1e-15:
                break
        return total

    def _adjoint(self, x: Array, z: Array) -> Array:
        """[x', z], projected onto the algebra; both are (rows, size, ...) with zero other rows."""
        whole = np.zeros((self.size, self.size, *x.shape[2:]), dtype=x.dtype)
        for i in range(self.size):
            for j in range(self.size):
                left = sum(x[r, i] * z[r, j] for r in range(self.rows))
                right = sum(z[i, r] * x[j, r] for r in range(self.size)) if self._both(i, j) else 0
                whole[i, j] = left - right
        return self.onto_algebra(whole[: self.rows])

    def _both(self, i: int, j: int) -> bool:
        return i < self.rows and j < self.rows

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """x times the part of x^-1 v in the Lie algebra."""
        return np.asarray(x @ self._last(self.onto_algebra(self._first(solve(x, v)))))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Exponentials of random elements of the algebra, about 1 from the identity."""
        e = np.broadcast_to(np.eye(self.size), (size, self.size, self.size))
        lengths = rng.uniform(0.1, 1.5, (size, 1, 1))
        return self.exp(e, lengths * self.random_tangent(e, rng))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, reach: float = np.inf
    ) -> PreparedPoints:
        """The points ``y``, entry by entry; logarithms only for pairs that can be within reach."""
        return _GroupPoints(self, y, bandwidth, precise, reach)


class _GroupPoints(PreparedPoints):
    """All a = x^-1 y of a block are one matrix product, all a^-1 another; then few logarithms.

    sinh |log a|_F >= |a - a^-1|_F / 2, so that pairs out of reach need none.
    """

    def __init__(
        self, group: MatrixGroup, y: Floats, bandwidth: float, precise: bool, reach: float
    ) -> None:
        self.manifold, self.group, self.bandwidth = group, group, bandwidth
        self.size = len(y)
        self.rows = max(1, CACHE_NUMBERS // max(1, 8 * self.size))
        magnitude = float(np.max(np.abs(y), initial=1.0)) ** 2
        self.dtype = precision(precise, magnitude * bandwidth, bandwidth) or np.dtype(np.float64)
        self.reach = reach * bandwidth
        self.columns = self._columns(y.transpose(1, 2, 0))
        self._points = y

    @cached_property
    def inverses(self) -> Array:
        """The inverses of the points, as columns (size, rows n)."""
        return self._columns(inverse(self._points).transpose(2, 1, 0)[:, : self.group.rows])

    def _columns(self, entries: Array) -> Array:
        """Matrices (r, s, n) as one (r, s n)."""
        whole = np.ascontiguousarray(entries, dtype=self.dtype)
        return whole.reshape(len(whole), -1)

    def ratios(self, x: Floats) -> Array:
        """x^-1 y for the places ``x`` [m, ...] and all points, (rows, m, size, n)."""
        back = np.moveaxis(inverse(x), 0, 1)[: self.group.rows].astype(self.dtype)
        ratio = back.reshape(-1, self.group.size) @ self.columns
        return ratio.reshape(self.group.rows, len(x), self.group.size, self.size)

    def sinh2(self, x: Floats, ratio: Array) -> Array:
        """The squared norms [m, n] of the hyperbolic sines of the logarithms of ``ratio``."""
        forward = x.transpose(2, 0, 1).astype(self.dtype)
        back = forward.reshape(-1, self.group.size) @ self.inverses
        back = back.reshape(self.group.size, len(x), self.group.rows, self.size)
        twice = ratio - back.transpose(2, 1, 0, 3)
        total: Array = np.einsum("imjn,imjn->mn", twice, twice)
        total *= 0.25
        return total

    def logs_at(self, ratio: Array, pairs: Integers) -> Array:
        """The logarithms (rows, size, k) of some of the ``pairs`` [k], indices into [m, n]."""
        start = pairs + pairs // self.size * ((self.group.size - 1) * self.size)
        some = np.empty((self.group.rows, self.group.size, len(pairs)), dtype=self.dtype)
        for j in range(self.group.size):
            for i, row in enumerate(ratio):
                row.ravel().take(start, out=some[i, j], mode="clip")
            start += self.size
        return self.group.algebra_log(some, self.reach)

    def block(self, x: Floats) -> KernelBlock:
        return _GroupBlock(self, x)

    def nearest(self, x: Floats, count: int) -> Array:
        """As ``PreparedPoints.nearest``: logarithms only of pairs that can be so near.

        Those are the first when all pairs are ordered by their hyperbolic sine, with some to spare;
        the next one must be beyond what was found.
        """
        spare = 2 * count + SPARE
        if spare >= self.size:
            return super().nearest(x, count)
        ratio = self.ratios(x)
        sinh2 = self.sinh2(x, ratio)
        order = np.argpartition(sinh2, spare, axis=1)[:, : spare + 1]
        pairs = order + np.arange(len(x))[:, None] * self.size
        z = length2(self.logs_at(ratio, pairs.ravel())).reshape(order.shape)
        z = np.sort(z, axis=1)[:, : count + 1]
        beyond = np.arcsinh(np.sqrt(sinh2.ravel()[pairs[:, -1]]))
        z /= self.bandwidth**2
        short = np.flatnonzero(~(z[:, -1] <= (beyond / self.bandwidth) ** 2))
        if short.size:
            z[short] = super().nearest(x[short], count)
        return z


class _GroupBlock(KernelBlock):
    def __init__(self, prepared: _GroupPoints, x: Floats) -> None:
        self._prepared, self._x = prepared, x
        ratio = prepared.ratios(x)
        self._pairs = self._within_reach(ratio)
        if self._pairs is None:
            whole = np.ascontiguousarray(np.moveaxis(ratio, 2, 1))
            self._log = prepared.group.algebra_log(whole, prepared.reach)
            self.scaled_sq_dist = self._squares() / prepared.bandwidth**2
        else:
            self._log = prepared.logs_at(ratio, self._pairs)
            self.scaled_sq_dist = np.full((len(x), prepared.size), np.inf, dtype=prepared.dtype)
            self.scaled_sq_dist.ravel()[self._pairs] = self._squares() / prepared.bandwidth**2

    def _within_reach(self, ratio: Array) -> Integers | None:
        """The pairs that may be within reach, or None where leaving out the others saves little."""
        if self._prepared.reach > FARTHEST:
            return None
        sinh2 = self._prepared.sinh2(self._x, ratio)
        near = np.flatnonzero(sinh2 <= np.sinh(SLACK * self._prepared.reach) ** 2)
        return near if near.size < DENSE * sinh2.size else None

    def _squares(self) -> Array:
        """The squared lengths of the logarithms; where there is none, it becomes zero."""
        squares = length2(self._log)
        none = np.isinf(squares)
        if none.any():
            self._log[:, :, none] = 0.0
        return squares

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        group = self._prepared.group
        pull = group.pull_of(self._log)
        if self._pairs is None:
            sums = np.einsum("mn,ijmn->ijm", weights, pull)
        else:
            near, (m, n) = weights.ravel()[self._pairs], weights.shape
            starts = np.searchsorted(self._pairs, np.arange(0, m * n, n))
            filled = np.flatnonzero(np.diff(starts, append=len(near)))
            sums = np.zeros((*pull.shape[:2], m))
            if filled.size:
                sums[:, :, filled] = np.add.reduceat(near * pull, starts[filled], axis=2)
        total = weights.sum(axis=1, dtype=np.float64)
        return self._x @ group._last(sums), total
