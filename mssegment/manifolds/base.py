"""What mean shift asks of a manifold, with defaults from ``log``.

A new manifold is one file with one subclass of :class:`Manifold` and one line in
``manifolds.REGISTRY``. Points and tangents are numpy arrays with any leading batch axes; tangents
have the shape of points. Mean shift itself looks only at
:class:`PreparedPoints`: the hypotheses, which stay where they are, prepared once for all
iterations, and a :class:`KernelBlock` of them for a block of trajectories. The default is made
from ``log``; a manifold that knows better (one matrix product, a closed-form logarithm) brings its
own.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from mssegment.errors import ConfigurationError, DataError
from mssegment.records import Floats

Array = npt.NDArray[np.floating[Any]]
"""Floating point numbers of either precision."""

Precision = np.dtype[np.floating[Any]]

CACHE_NUMBERS = 1 << 18
"""Numbers of one intermediate array that stay in a core's cache (1 MB in single precision)."""


FEWEST_ROWS = 8
"""Rows of a block below which a matrix product is no faster than one row at a time."""


class KernelBlock(ABC):
    """Distances and pulls between a block of m places and the n prepared points.

    ``scaled_sq_dist`` [m, n] are the squared distances over the squared bandwidth, the argument z
    of the kernel profile k(z) in (7); infinite where there is no logarithm. The caller may
    overwrite them.
    """

    scaled_sq_dist: Array

    @abstractmethod
    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        """Sum over the n points of ``weights`` [m, n] times -1/2 grad d^2, and of the weights.

        Tangents [m, ...] and numbers [m]: numerator and denominator of the mean shift vector (9).
        """


class PreparedPoints(ABC):
    """n fixed points of a manifold, prepared once for being seen from many places.

    ``rows`` is how many places to look from at a time so that the work stays in the cache.
    """

    manifold: Manifold
    size: int
    bandwidth: float
    rows: int

    @abstractmethod
    def block(self, x: Floats) -> KernelBlock:
        """Distances and pulls from the places ``x`` [m, ...]."""

    def nearest(self, x: Floats, count: int) -> Array:
        """The z of the ``count`` + 1 points nearest to each of ``x``, the last one last, [m, k]."""
        z = self.block(x).scaled_sq_dist
        z.partition(count, axis=1)
        return z[:, : count + 1]


class Manifold(ABC):
    """A manifold with a distance, an exponential map and a logarithm.

    The traits say which laws hold; the law tests read them.
    """

    examples: ClassVar[tuple[str, ...]] = ()
    """Names of typical members of the family: the law tests run over them."""

    is_metric: bool = True
    """The distance satisfies the triangle inequality."""
    dist_is_geodesic: bool = True
    """The distance is the length of the logarithm, (2)."""
    exact_gradient: bool = True
    """``neg_half_grad_sq_dist`` is exact, so that a mean shift step climbs the density."""
    left_invariant: bool = False
    """Points are matrices of a group, and d(g x, g y) = d(x, y)."""
    basis_free: bool = False
    """x and x q are the same point for any orthogonal q."""

    @classmethod
    @abstractmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Manifold:
        """The member of the family with these ``arguments``; raises ConfigurationError."""

    @property
    @abstractmethod
    def name(self) -> str:
        """The name that ``manifolds.from_name`` understands, for instance ``grassmann(10,3)``."""

    @property
    @abstractmethod
    def dim(self) -> int:
        """The dimension of the manifold."""

    @property
    @abstractmethod
    def point_shape(self) -> tuple[int, ...]:
        """The shape of the array that holds one point."""

    @property
    def numbers_per_prepared_point(self) -> int:
        """How many numbers are kept for each prepared point, roughly."""
        return 2 * int(np.prod(self.point_shape)) + 2

    @abstractmethod
    def exp(self, x: Floats, v: Floats) -> Floats:
        """The point after unit time on the geodesic that leaves ``x`` with velocity ``v``."""

    @abstractmethod
    def log(self, x: Floats, y: Floats) -> Floats:
        """The shortest tangent at ``x`` with exp(x, v) = ``y``; NaN where there is none."""

    @abstractmethod
    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The inner product g_x(u, v) of two tangents at ``x``."""

    @abstractmethod
    def project(self, x: Floats) -> Floats:
        """The point of the manifold near the array ``x``."""

    @abstractmethod
    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The tangent at ``x`` nearest to the array ``v``."""

    @abstractmethod
    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """``size`` random points, spread over the manifold (or over its middle, if unbounded)."""

    @abstractmethod
    def constraint_violation(self, x: Floats) -> Floats:
        """How far each array ``x`` [..., *point_shape] is from being a point (0: it is one)."""

    def random_tangent(self, x: Floats, rng: np.random.Generator) -> Floats:
        """A random tangent of unit norm at each ``x``."""
        v = self.project_tangent(x, rng.standard_normal(np.shape(x)))
        length = self.norm(x, v)
        return np.asarray(v / _per_point(length, self), dtype=np.float64)

    def norm(self, x: Floats, v: Floats) -> Floats:
        """The length of the tangent ``v`` at ``x``."""
        return np.sqrt(np.maximum(self.inner(x, v, v), 0.0))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The distance d(x, y); infinite where ``y`` has no logarithm at ``x``."""
        length = self.norm(x, self.log(x, y))
        return np.where(np.isnan(length), np.inf, length)

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """-1/2 grad d^2(x, y), the pull of ``y`` on ``x`` in (9); zero where d is infinite."""
        return np.nan_to_num(self.log(x, y), nan=0.0)

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, reach: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, ...], prepared for mean shift.

        Unless ``precise``, single precision is good enough. Points further than ``reach``
        bandwidths may be left out: their z may be infinite, and then their weight must be 0.
        """
        return LogPreparedPoints(self, y, bandwidth)

    def pairwise_dist2(self, x: Floats, y: Floats) -> Floats:
        """Squared distances [m, n] between the points ``x`` [m, ...] and ``y`` [n, ...]."""
        z = self.prepare(y).block(x).scaled_sq_dist
        return np.maximum(z, 0.0).astype(np.float64)

    def mean_tangent(self, x: Floats, y: Floats, w: Floats) -> Floats:
        """The weighted mean of -1/2 grad d^2 at ``x`` [m, ...] over ``y`` [n, ...], (9) and (22).

        ``w`` [m, n] are the weights g(d^2 / h^2); a row of zeros gives the zero tangent.
        """
        summed, total = self.prepare(y).block(x).weighted_sum(np.asarray(w, dtype=np.float64))
        return _per_point(1.0 / np.where(total > 0, total, 1.0), self) * summed

    def check_point(self, x: Floats, tolerance: float = 1e-6) -> None:
        """Raise DataError, naming the first offender, unless all ``x`` [...] are points."""
        shape = self.point_shape
        if np.shape(x)[max(np.ndim(x) - len(shape), 0) :] != shape:
            raise DataError(f"points of {self.name} have shape {shape}, found {np.shape(x)}")
        finite = np.isfinite(x).reshape(-1, int(np.prod(shape))).all(axis=1)
        if not finite.all():
            raise DataError(f"point {int(np.argmin(finite))} of {self.name} is not finite")
        off = np.ravel(self.constraint_violation(np.asarray(x, dtype=np.float64)))
        wrong = ~(off <= tolerance)
        if wrong.any():
            i = int(np.argmax(wrong))
            raise DataError(f"point {i} is not on {self.name}: it is {off[i]:.3g} away from it")

    def __repr__(self) -> str:
        return f"<manifold {self.name}>"


class LogPreparedPoints(PreparedPoints):
    """The default for a manifold that knows only its logarithm."""

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float) -> None:
        self.manifold, self.y, self.bandwidth = manifold, y, bandwidth
        self.size = len(y)
        numbers = max(1, self.size * int(np.prod(manifold.point_shape)))
        self.rows = max(1, CACHE_NUMBERS // numbers)

    def block(self, x: Floats) -> KernelBlock:
        """Distances and pulls from ``x`` [m, ...]."""
        return _LogBlock(self, x)


class _LogBlock(KernelBlock):
    def __init__(self, prepared: LogPreparedPoints, x: Floats) -> None:
        at, to = x[:, None], prepared.y[None]
        self.scaled_sq_dist = (prepared.manifold.dist(at, to) / prepared.bandwidth) ** 2
        self._pull = prepared.manifold.neg_half_grad_sq_dist(at, to)

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        double = weights.astype(np.float64)
        return np.einsum("mn,mn...->m...", double, self._pull), double.sum(axis=1)


def precision(precise: bool, magnitude: float, bandwidth: float) -> Precision | None:
    """The precision in which z can be had from a difference of terms of ``magnitude``.

    Single precision if it is allowed and good for z to about 0.01, else double; None where the
    bandwidth is so small that cancellation leaves nothing in double precision either.
    """
    for kind in (np.float64,) if precise else (np.float32, np.float64):
        if magnitude * float(np.finfo(kind).eps) < 1e-2 * bandwidth**2:
            return np.dtype(kind)
    return None


def integers(family: str, arguments: tuple[str, ...], expected: str) -> tuple[int, ...]:
    """The ``arguments`` as whole numbers >= 1, as many as ``expected`` (``N,k``) has."""
    count = expected.count(",") + 1
    if len(arguments) != count or not all(a.isdecimal() and int(a) >= 1 for a in arguments):
        found = ",".join(arguments)
        raise ConfigurationError(
            f"no manifold is called {family}({found}): use {family}({expected})"
        )
    return tuple(int(a) for a in arguments)


def _per_point(numbers: Floats, manifold: Manifold) -> Floats:
    """One number per point, shaped so that it multiplies the points."""
    return np.reshape(numbers, np.shape(numbers) + (1,) * len(manifold.point_shape))
