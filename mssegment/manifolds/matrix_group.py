"""Matrix Lie groups with a left-invariant metric (section 4.2 of the paper)."""

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
MAX_CUTOFF = 3.0
"""For a larger cutoff (in the distance of the group) finding the pairs beyond it saves nothing."""
SLACK = 1.001
"""The factor on the cutoff that keeps rounding from leaving out pairs just within it."""
SPARE = 8
"""``nearest`` computes the distances of this many pairs more than twice as many as are wanted."""
DENSE = 0.5
"""The share of pairs within the cutoff above which computing all logarithms is faster."""


class MatrixGroup(Manifold):
    """A group of s x s matrices with the distance (20), |log x^-1 y|_F.

    The inner product at x is tr((x^-1 u)' x^-1 v). The distance is left-invariant but breaks the
    triangle inequality, and is infinite where x^-1 y has no real logarithm.
    ``neg_half_grad_sq_dist`` is the logarithm (21), a first-order approximation of -1/2 grad d^2
    (10 % off at |log| = 0.3), or with ``exact`` that gradient.

    A subclass has the class attributes ``family``, ``order``, ``free_rows`` and ``size``, and the
    methods ``dim``, ``algebra_log``, ``onto_algebra``, ``project`` and ``constraint_violation``.

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient.

    Notes
    -----
    Algebra elements are arrays with the *matrix axes first*, (free_rows, size, ...): every entry is
    one contiguous array over all pairs of points. Constant last rows are left out.
    """

    is_metric = False
    left_invariant = True
    family: ClassVar[str]
    """The name without arguments."""
    order: ClassVar[int]
    """The number in the name: 2 of A(2), 3 of SL(3)."""
    free_rows: ClassVar[int]
    """The number of rows that are not constant."""
    size: ClassVar[int]
    """The number s of rows and columns."""

    def __init__(self, *, exact: bool = False) -> None:
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
    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The principal matrix logarithms (17).

        Parameters
        ----------
        m
            Matrices of the group (free_rows, size, ...).
        max_norm
            Logarithms of a larger norm may be NaN.

        Returns
        -------
        array
            The logarithms (free_rows, size, ...), NaN where there is no real one.
        """

    @abstractmethod
    def onto_algebra(self, v: Array) -> Array:
        """The orthogonal projection of ``v`` (free_rows, size, ...) onto the Lie algebra."""

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(size, size)``."""
        return (self.size, self.size)

    def _axes_first(self, x: Floats) -> Floats:
        """Matrices (..., size, size) as (free_rows, size, ...)."""
        return np.ascontiguousarray(np.moveaxis(x, (-2, -1), (0, 1))[: self.free_rows])

    def axes_last(self, v: Array) -> Floats:
        """Elements of the algebra (free_rows, size, ...) as (..., size, size), with zero rows."""
        whole = np.zeros((self.size, self.size, *v.shape[2:]))
        whole[: self.free_rows] = v
        return np.ascontiguousarray(np.moveaxis(whole, (0, 1), (-2, -1)))

    def exp(self, x: Floats, v: Floats) -> Floats:
        """Equation (18), x exp(x^-1 v)."""
        return np.asarray(x @ exponential(solve(x, v)))

    def log(self, x: Floats, y: Floats) -> Floats:
        """Equation (19), x log(x^-1 y); NaN where there is no real logarithm."""
        return np.asarray(x @ self.axes_last(self.algebra_log(self._axes_first(solve(x, y)))))

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """tr((x^-1 u)' x^-1 v), the left-invariant inner product that belongs to (20)."""
        return np.asarray(np.sum(solve(x, u) * solve(x, v), axis=(-2, -1)))

    def norm(self, x: Floats, v: Floats) -> Floats:
        """The norm |x^-1 v|_F."""
        return np.asarray(np.linalg.norm(solve(x, v), axis=(-2, -1)))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (20), |log x^-1 y|_F; infinite where there is no real logarithm."""
        return np.sqrt(length2(self.algebra_log(self._axes_first(solve(x, y))))).astype(np.float64)

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (21), log_x(y), or the exact -1/2 grad d^2; zero where d is infinite."""
        gradient = self.gradient_from_log(self.algebra_log(self._axes_first(solve(x, y))))
        return np.asarray(x @ self.axes_last(np.nan_to_num(gradient, nan=0.0)))

    def gradient_from_log(self, log: Array) -> Array:
        """-1/2 grad d^2 in the Lie algebra, that is x^-1 times the tangent at x.

        Parameters
        ----------
        log
            The logarithms of x^-1 y (free_rows, size, ...).

        Returns
        -------
        array
            ``log`` itself (21), or the exact gradient, of the same shape.

        Notes
        -----
        d log(exp(-tE) exp X) / dt = -B(ad_X) E with B(z) = z / (e^z - 1), so the exact gradient is
        the adjoint series B(ad_X)* X, with ad_X* Z the part of [X', Z] in the algebra. The series
        converges while eigenvalues of X differ by less than 2 pi, and diverges beyond.
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
        """[x', z] projected onto the algebra, for ``x`` and ``z`` (free_rows, size, ...)."""
        whole = np.zeros((self.size, self.size, *x.shape[2:]), dtype=x.dtype)
        for i in range(self.size):
            for j in range(self.size):
                whole[i, j] = sum(x[r, i] * z[r, j] for r in range(self.free_rows))
                if max(i, j) < self.free_rows:
                    whole[i, j] -= sum(z[i, r] * x[j, r] for r in range(self.size))
        return self.onto_algebra(whole[: self.free_rows])

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """x times the projection of x^-1 v onto the Lie algebra."""
        return np.asarray(x @ self.axes_last(self.onto_algebra(self._axes_first(solve(x, v)))))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Exponentials of random algebra elements of norm 0.1 to 1.5, [size, s, s]."""
        e = np.broadcast_to(np.eye(self.size), (size, self.size, self.size))
        lengths = rng.uniform(0.1, 1.5, (size, 1, 1))
        return self.exp(e, lengths * self.random_tangent(e, rng))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, s, s]; pairs beyond the cutoff need no logarithm."""
        return _GroupPoints(self, y, bandwidth, precise, cutoff)


class _GroupPoints(PreparedPoints):
    """All a = x^-1 y of a block are one matrix product, all a^-1 another one.

    Since sinh |log a|_F >= |a - a^-1|_F / 2, pairs beyond the cutoff need no logarithm.
    """

    def __init__(
        self, group: MatrixGroup, y: Floats, bandwidth: float, precise: bool, cutoff: float
    ) -> None:
        self.manifold, self.group, self.bandwidth = group, group, bandwidth
        self.size = len(y)
        self.block_rows = max(1, CACHE_NUMBERS // max(1, 8 * self.size))
        magnitude = float(np.max(np.abs(y), initial=1.0)) ** 2
        self.dtype = precision(precise, magnitude * bandwidth, bandwidth) or np.dtype(np.float64)
        self.cutoff = cutoff * bandwidth
        self.columns = self._columns(y.transpose(1, 2, 0))
        self._points = y

    @cached_property
    def inverses(self) -> Array:
        """The inverses of the points, as columns (size, free_rows n)."""
        return self._columns(inverse(self._points).transpose(2, 1, 0)[:, : self.group.free_rows])

    def _columns(self, entries: Array) -> Array:
        """Matrices (r, s, n) as one (r, s n)."""
        whole = np.ascontiguousarray(entries, dtype=self.dtype)
        return whole.reshape(len(whole), -1)

    def ratios(self, x: Floats) -> Array:
        """x^-1 y for ``x`` [m, s, s] and all points, (free_rows, m, size, n)."""
        inverses = np.moveaxis(inverse(x), 0, 1)[: self.group.free_rows].astype(self.dtype)
        ratio = inverses.reshape(-1, self.group.size) @ self.columns
        return ratio.reshape(self.group.free_rows, len(x), self.group.size, self.size)

    def sinh2(self, x: Floats, ratio: Array) -> Array:
        """The squared norms [m, n] of the hyperbolic sines of the logarithms of ``ratio``."""
        entries = x.transpose(2, 0, 1).astype(self.dtype)
        reverse = entries.reshape(-1, self.group.size) @ self.inverses
        reverse = reverse.reshape(self.group.size, len(x), self.group.free_rows, self.size)
        twice = ratio - reverse.transpose(2, 1, 0, 3)
        total: Array = np.einsum("imjn,imjn->mn", twice, twice)
        total *= 0.25
        return total

    def logs_at(self, ratio: Array, pairs: Integers) -> Array:
        """The logarithms (free_rows, size, k) of the ``pairs`` [k], flat indices into [m, n]."""
        place = pairs + pairs // self.size * ((self.group.size - 1) * self.size)
        chosen = np.empty((self.group.free_rows, self.group.size, len(pairs)), dtype=self.dtype)
        for j in range(self.group.size):
            for i, row in enumerate(ratio):
                row.ravel().take(place, out=chosen[i, j], mode="clip")
            place += self.size
        return self.group.algebra_log(chosen, self.cutoff)

    def block(self, x: Floats) -> KernelBlock:
        return _GroupBlock(self, x)

    def nearest(self, x: Floats, count: int) -> Array:
        """As ``PreparedPoints.nearest``, with few logarithms.

        The candidates are the first pairs in the order of the lower bound of the distance; all
        pairs are computed where a further one may still be nearer.
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
        bound = np.arcsinh(np.sqrt(sinh2.ravel()[pairs[:, -1]]))
        z /= self.bandwidth**2
        unsure = np.flatnonzero(~(z[:, -1] <= (bound / self.bandwidth) ** 2))
        if unsure.size:
            z[unsure] = super().nearest(x[unsure], count)
        return z


class _GroupBlock(KernelBlock):
    def __init__(self, prepared: _GroupPoints, x: Floats) -> None:
        self._prepared, self._x = prepared, x
        ratio = prepared.ratios(x)
        self._pairs = self._within_cutoff(ratio)
        if self._pairs is None:
            whole = np.ascontiguousarray(np.moveaxis(ratio, 2, 1))
            self._log = prepared.group.algebra_log(whole, prepared.cutoff)
            self.scaled_sq_dist = self._squares() / prepared.bandwidth**2
        else:
            self._log = prepared.logs_at(ratio, self._pairs)
            self.scaled_sq_dist = np.full((len(x), prepared.size), np.inf, dtype=prepared.dtype)
            self.scaled_sq_dist.ravel()[self._pairs] = self._squares() / prepared.bandwidth**2

    def _within_cutoff(self, ratio: Array) -> Integers | None:
        """The pairs that may be within the cutoff, or None where they are too many to save time."""
        if self._prepared.cutoff > MAX_CUTOFF:
            return None
        sinh2 = self._prepared.sinh2(self._x, ratio)
        near = np.flatnonzero(sinh2 <= np.sinh(SLACK * self._prepared.cutoff) ** 2)
        return near if near.size < DENSE * sinh2.size else None

    def _squares(self) -> Array:
        """The squared norms of the logarithms; sets logarithms that do not exist to zero."""
        squares = length2(self._log)
        missing = np.isinf(squares)
        if missing.any():
            self._log[:, :, missing] = 0.0
        return squares

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        group = self._prepared.group
        gradients = group.gradient_from_log(self._log)
        if self._pairs is None:
            sums = np.einsum("mn,ijmn->ijm", weights, gradients)
        else:
            own, (m, n) = weights.ravel()[self._pairs], weights.shape
            starts = np.searchsorted(self._pairs, np.arange(0, m * n, n))
            filled = np.flatnonzero(np.diff(starts, append=len(own)))
            sums = np.zeros((*gradients.shape[:2], m))
            if filled.size:
                sums[:, :, filled] = np.add.reduceat(own * gradients, starts[filled], axis=2)
        total = weights.sum(axis=1, dtype=np.float64)
        return self._x @ group.axes_last(sums), total
