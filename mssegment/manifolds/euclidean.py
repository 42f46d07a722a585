"""Euclidean space R^n: the special case in which (9)-(10) is the classical mean shift (5)-(6)."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import (
    CACHE_NUMBERS,
    MIN_BLOCK_ROWS,
    Array,
    KernelBlock,
    LogPreparedPoints,
    Manifold,
    Precision,
    PreparedPoints,
    parse_integers,
    precision,
)
from mssegment.records import Floats


class Euclidean(Manifold):
    """R^n with the usual distance.

    Parameters
    ----------
    n
        The dimension, at least 1.

    Raises
    ------
    ConfigurationError
        For a smaller dimension.

    Examples
    --------
    >>> import numpy as np
    >>> plane = Euclidean(2)
    >>> plane.dist(np.zeros(2), np.array([3.0, 4.0])).item()
    5.0
    """

    examples = ("euclidean(1)", "euclidean(3)", "euclidean(7)")

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ConfigurationError(f"euclidean({n}) is no manifold: use n >= 1")
        self.n = n

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Euclidean:
        """R^n from ``(n,)``."""
        return cls(*parse_integers("euclidean", arguments, "n"))

    @property
    def name(self) -> str:
        """``euclidean(n)``."""
        return f"euclidean({self.n})"

    @property
    def dim(self) -> int:
        """The dimension, n."""
        return self.n

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(n,)``."""
        return (self.n,)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """The exponential map x + v."""
        return np.asarray(x + v)

    def log(self, x: Floats, y: Floats) -> Floats:
        """The logarithm y - x."""
        return np.asarray(y - x)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The inner product u'v."""
        return np.asarray(np.sum(u * v, axis=-1))

    def project(self, x: Floats) -> Floats:
        """``x`` itself: every array is a point."""
        return np.asarray(x, dtype=np.float64)

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """``v`` itself: every array is a tangent."""
        return np.asarray(v, dtype=np.float64)

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Standard normal points [size, n]."""
        return rng.standard_normal((size, self.n))

    def constraint_violation(self, x: Floats) -> Floats:
        """Zero: every array is a point."""
        return np.zeros(np.shape(x)[:-1])

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, ...], centred and divided by the bandwidth; no cutoff."""
        spread = float(np.max(np.sum((y - y.mean(axis=0)) ** 2, axis=1))) if len(y) else 0.0
        dtype = precision(precise, spread, bandwidth)
        if dtype is None:
            return LogPreparedPoints(self, y, bandwidth)
        return _EuclideanPoints(self, y, bandwidth, dtype)


class _EuclideanPoints(PreparedPoints):
    """|x - y|^2 = |x|^2 + |y|^2 - 2 x'y as one matrix product with two more columns.

    The points are centred first, to lose little to cancellation.
    """

    def __init__(self, manifold: Euclidean, y: Floats, bandwidth: float, dtype: Precision) -> None:
        self.manifold = manifold
        self.size, n = y.shape
        self.block_rows = max(MIN_BLOCK_ROWS, CACHE_NUMBERS // max(1, self.size))
        self.bandwidth = bandwidth
        self.dtype = dtype
        self.centre = y.mean(axis=0) if self.size else np.zeros(n)
        scaled = self.scale(y)
        self.points = np.concatenate([scaled, np.ones((self.size, 1))], axis=1).astype(self.dtype)
        norms = np.sum(scaled * scaled, axis=1, keepdims=True)
        columns = [-2.0 * scaled, np.ones((self.size, 1)), norms]
        self.columns = np.ascontiguousarray(np.concatenate(columns, axis=1).T, dtype=self.dtype)

    def scale(self, x: Floats) -> Floats:
        """``x`` from the centre, in bandwidths."""
        return np.asarray((x - self.centre) / self.bandwidth)

    def block(self, x: Floats) -> KernelBlock:
        return _EuclideanBlock(self, self.scale(x))


class _EuclideanBlock(KernelBlock):
    def __init__(self, prepared: _EuclideanPoints, scaled: Floats) -> None:
        self._prepared, self._scaled = prepared, scaled
        norms = np.sum(scaled * scaled, axis=1, keepdims=True)
        rows = np.concatenate([scaled, norms, np.ones_like(norms)], axis=1).astype(prepared.dtype)
        self.scaled_sq_dist = np.maximum(rows @ prepared.columns, 0)

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        sums = (weights.astype(self._prepared.dtype, copy=False) @ self._prepared.points).astype(
            float
        )
        total = sums[:, -1]
        return self._prepared.bandwidth * (sums[:, :-1] - self._scaled * total[:, None]), total
