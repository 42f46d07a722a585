"""The sphere S^n: unit vectors, with the angle between them as distance."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold, parse_integers
from mssegment.manifolds.directions import DirectionPoints
from mssegment.manifolds.prepared import (
    Array,
    KernelBlock,
    LogPreparedPoints,
    Precision,
    PreparedPoints,
    precision,
)
from mssegment.records import Floats


class Sphere(Manifold):
    """S^n, the unit vectors of R^(n+1), with the great-circle distance.

    Opposite points have many logarithms of the same length, of which one is returned.

    Parameters
    ----------
    n
        The dimension of the sphere, at least 1.

    Raises
    ------
    ConfigurationError
        For a smaller dimension.

    Examples
    --------
    >>> import numpy as np
    >>> earth = Sphere(2)
    >>> earth.dist([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]).round(3).item()
    1.571
    """

    examples = ("sphere(1)", "sphere(2)", "sphere(5)")
    is_compact = True

    def __init__(self, n: int) -> None:
        if n < 1:
            raise ConfigurationError(f"sphere({n}) is no manifold: use n >= 1")
        self.n = n

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Sphere:
        """S^n from ``(n,)``."""
        return cls(*parse_integers("sphere", arguments, "n"))

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Sphere:
        """S^n for vectors of n + 1 numbers."""
        return cls(cls.expect_axes("sphere", shape, 1)[0] - 1)

    @property
    def name(self) -> str:
        """``sphere(n)``."""
        return f"sphere({self.n})"

    @property
    def dim(self) -> int:
        """The dimension, n."""
        return self.n

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(n + 1,)``."""
        return (self.n + 1,)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """The exponential map, cos(a) x + sin(a) / a v with a = |v|, divided by its norm.

        Without the division, rounding errors would grow: where x'x is 1 + e, a shift at x is not
        orthogonal to x, and a step of c shifts leaves (1 - 2 c) e.
        """
        angle = np.linalg.norm(v, axis=-1, keepdims=True)
        moved = np.cos(angle) * x + np.sinc(angle / np.pi) * v
        return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))

    def log(self, x: Floats, y: Floats) -> Floats:
        """The logarithm, a / sin(a) (y - cos(a) x)."""
        across = self.project_tangent(x, y)
        sine = np.linalg.norm(across, axis=-1, keepdims=True)
        angle = np.arctan2(sine, np.sum(x * y, axis=-1, keepdims=True))
        ratio = np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0)
        return np.where((sine == 0) & (angle > 0), np.pi * self._any_direction(x), ratio * across)

    def _any_direction(self, x: Floats) -> Floats:
        """A unit tangent: the axis in which x is smallest, made orthogonal to x."""
        axis = np.eye(self.n + 1)[np.argmin(np.abs(x), axis=-1)]
        across = self.project_tangent(x, axis)
        return np.asarray(across / np.linalg.norm(across, axis=-1, keepdims=True))

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The inner product u'v."""
        return np.asarray(np.sum(u * v, axis=-1))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The angle, 2 atan2(|x - y|, |x + y|), accurate for small and for large ones."""
        apart, together = np.linalg.norm(x - y, axis=-1), np.linalg.norm(x + y, axis=-1)
        return np.asarray(2.0 * np.arctan2(apart, together))

    def project(self, x: Floats) -> Floats:
        """``x`` divided by its norm; 0 has no point near it."""
        self.check_finite(x)
        largest = np.abs(x).max(axis=-1, keepdims=True, initial=0.0)
        self._refuse(largest[..., 0] == 0, "it is 0")
        scaled = x / largest
        return np.asarray(scaled / np.linalg.norm(scaled, axis=-1, keepdims=True))

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The part of ``v`` orthogonal to ``x``."""
        return np.asarray(v - np.sum(x * v, axis=-1, keepdims=True) * x)

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Uniformly distributed unit vectors [size, n + 1]."""
        x = rng.standard_normal((size, self.n + 1))
        return np.asarray(x / np.linalg.norm(x, axis=-1, keepdims=True))

    def constraint_violation(self, x: Floats) -> Floats:
        """| |x| - 1 |."""
        return np.asarray(np.abs(np.linalg.norm(x, axis=-1) - 1.0))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, ...], with two matrix products a block; no cutoff."""
        dtype = precision(precise, 2.0, bandwidth)
        if dtype is None:
            return LogPreparedPoints(self, y, bandwidth)
        return UnitVectorPoints(self, y, bandwidth, dtype)


class UnitVectorPoints(PreparedPoints):
    """Points that are unit vectors, up to their sign with ``antipodal``."""

    def __init__(
        self,
        manifold: Manifold,
        y: Floats,
        bandwidth: float,
        dtype: Precision,
        antipodal: bool = False,
    ) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        flat = np.reshape(y, (len(y), int(np.prod(manifold.point_shape))))
        self.directions = DirectionPoints(flat, bandwidth, dtype, antipodal)
        self.block_rows = self.directions.block_rows

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, ...]."""
        return _UnitVectorBlock(self, x)


class _UnitVectorBlock(KernelBlock):
    def __init__(self, prepared: UnitVectorPoints, x: Floats) -> None:
        self._shape = x.shape
        self._block = prepared.directions.block(
            x.reshape(len(x), prepared.directions.points.shape[1])
        )
        self.scaled_sq_dist = self._block.scaled_sq_dist

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        summed, total = self._block.weighted_sum(weights)
        return summed.reshape(self._shape), total
