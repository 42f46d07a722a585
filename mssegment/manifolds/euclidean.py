"""Euclidean space R^n: the special case in which (9)-(10) is the classical mean shift (5)-(6)."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold, parse_integers
from mssegment.manifolds.prepared import (
    CACHE_NUMBERS,
    MAX_ERROR,
    MAX_ERROR_SINGLE,
    MIN_BLOCK_ROWS,
    Array,
    KernelBlock,
    LogPreparedPoints,
    Precision,
    PreparedPoints,
)
from mssegment.records import Floats, Integers


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

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Euclidean:
        """R^n for vectors of n numbers."""
        return cls(*cls.expect_axes("euclidean", shape, 1))

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
        """``x`` itself: every finite array is a point."""
        self.check_finite(x)
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
        y = np.asarray(y, dtype=np.float64)
        centre = np.sort(y, axis=0)[len(y) // 2] if len(y) else np.zeros(self.n)
        square = np.sum(((y - centre) / bandwidth) ** 2, axis=1)
        for dtype, error in ((np.float32, MAX_ERROR_SINGLE), (np.float64, MAX_ERROR)):
            if dtype == np.float32 and precise:
                continue
            remote = np.flatnonzero(~(square * float(np.finfo(dtype).eps) < error))
            if len(remote) <= MAX_REMOTE * len(y):
                return _EuclideanPoints(self, y, bandwidth, np.dtype(dtype), centre, remote)
        return LogPreparedPoints(self, y, bandwidth)


MAX_REMOTE = 0.1
"""The share of remote points up to which computing their distances apart is faster than computing
all distances in double precision, or one by one."""


class _EuclideanPoints(PreparedPoints):
    """|x - y|^2 = |x|^2 + |y|^2 - 2 x'y as one matrix product with two more columns.

    The points are seen from their median first, to lose little to cancellation. What is lost
    between two points grows with their distance from it: between a near and a ``remote`` one that
    is little compared with their distance, between two remote ones it is not, so the distances of
    remote points are computed from the differences.
    """

    def __init__(
        self,
        manifold: Euclidean,
        y: Floats,
        bandwidth: float,
        dtype: Precision,
        centre: Floats,
        remote: Integers,
    ) -> None:
        self.manifold, self.bandwidth, self.dtype = manifold, bandwidth, dtype
        self.centre, self.remote, self.size = centre, remote, len(y)
        self.block_rows = max(MIN_BLOCK_ROWS, CACHE_NUMBERS // max(1, self.size))
        scaled = self.scale(y)
        self.remote_points = scaled[remote]
        ones = np.ones((self.size, 1))
        self.points = np.concatenate([scaled, ones], axis=1).astype(self.dtype)
        norms = np.sum(scaled * scaled, axis=1, keepdims=True)
        columns = [-2.0 * scaled, ones, norms]
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
        if len(prepared.remote):
            difference = scaled[:, None] - prepared.remote_points
            squares = np.einsum("mnd,mnd->mn", difference, difference)
            self.scaled_sq_dist[:, prepared.remote] = squares

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        prepared = self._prepared
        sums = (weights.astype(prepared.dtype, copy=False) @ prepared.points).astype(float)
        total = sums[:, -1]
        return prepared.bandwidth * (sums[:, :-1] - self._scaled * total[:, None]), total
