"""Euclidean space R^n: the special case in which (9)-(10) is the classical mean shift (5)-(6)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.base import (
    CACHE_NUMBERS,
    FEWEST_ROWS,
    Array,
    Cloud,
    LogCloud,
    Manifold,
    Precision,
    View,
    integers,
    precision,
)
from mssegment.records import Floats


class Euclidean(Manifold):
    """R^n with the usual distance."""

    examples = ("euclidean(1)", "euclidean(3)", "euclidean(7)")

    def __init__(self, n: int) -> None:
        self.n = n

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Euclidean:
        """R^n from ``(n,)``."""
        return cls(*integers("euclidean", arguments, "n"))

    @property
    def name(self) -> str:
        """``euclidean(n)``."""
        return f"euclidean({self.n})"

    @property
    def dim(self) -> int:
        """n."""
        return self.n

    @property
    def point_shape(self) -> tuple[int, ...]:
        """``(n,)``."""
        return (self.n,)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """x + v."""
        return np.asarray(x + v)

    def log(self, x: Floats, y: Floats) -> Floats:
        """y - x."""
        return np.asarray(y - x)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """u'v."""
        return np.asarray(np.sum(u * v, axis=-1))

    def project(self, x: Floats) -> Floats:
        """Every array is a point."""
        return np.asarray(x, dtype=np.float64)

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """Every array is a tangent."""
        return np.asarray(v, dtype=np.float64)

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Standard normal points."""
        return rng.standard_normal((size, self.n))

    def deviation(self, x: Floats) -> Floats:
        """Zero: every array is a point."""
        return np.zeros(np.shape(x)[:-1])

    def cloud(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, reach: float = np.inf
    ) -> Cloud:
        """The points ``y``, centred and divided by the bandwidth."""
        spread = float(np.max(np.sum((y - y.mean(axis=0)) ** 2, axis=1))) if len(y) else 0.0
        dtype = precision(precise, spread, bandwidth)
        if dtype is None:
            return LogCloud(self, y, bandwidth)
        return _EuclideanCloud(self, y, bandwidth, dtype)


class _EuclideanCloud(Cloud):
    """|x - y|^2 = |x|^2 + |y|^2 - 2 x'y as one matrix product with two more columns.

    The points are centred first, so that little is lost to cancellation.
    """

    def __init__(self, manifold: Euclidean, y: Floats, bandwidth: float, dtype: Precision) -> None:
        self.manifold = manifold
        self.size, n = y.shape
        self.rows = max(FEWEST_ROWS, CACHE_NUMBERS // max(1, self.size))
        self.bandwidth = bandwidth
        self.dtype = dtype
        self.centre = y.mean(axis=0) if self.size else np.zeros(n)
        unit = self._unit(y)
        self.points = np.concatenate([unit, np.ones((self.size, 1))], axis=1).astype(self.dtype)
        norms = np.sum(unit * unit, axis=1, keepdims=True)
        columns = [-2.0 * unit, np.ones((self.size, 1)), norms]
        self.columns = np.ascontiguousarray(np.concatenate(columns, axis=1).T, dtype=self.dtype)

    def _unit(self, x: Floats) -> Floats:
        return np.asarray((x - self.centre) / self.bandwidth)

    def seen_from(self, x: Floats) -> View:
        return _EuclideanView(self, self._unit(x))


class _EuclideanView(View):
    def __init__(self, cloud: _EuclideanCloud, unit: Floats) -> None:
        self._cloud, self._unit = cloud, unit
        norms = np.sum(unit * unit, axis=1, keepdims=True)
        rows = np.concatenate([unit, norms, np.ones_like(norms)], axis=1).astype(cloud.dtype)
        self.z = np.maximum(rows @ cloud.columns, 0)

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        sums = (weights.astype(self._cloud.dtype, copy=False) @ self._cloud.points).astype(float)
        total = sums[:, -1]
        return self._cloud.bandwidth * (sums[:, :-1] - self._unit * total[:, None]), total
