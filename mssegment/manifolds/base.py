"""The interface of a manifold, and defaults that need only ``log``.

A new manifold is one file with a subclass of :class:`Manifold` and one line in
``MANIFOLDS`` of ``registry.py``; the law tests then run on it.

Points and tangents are arrays with any leading batch axes; a tangent has the shape of a point.
Methods broadcast over the batch axes unless they state shapes.

Mean shift uses a manifold only through :class:`PreparedPoints`: the data points, prepared once for
all iterations, of which a :class:`KernelBlock` gives the distances and gradients from a block of
trajectories. The default is made from ``log``; a manifold with something faster (a matrix product,
a closed form of the logarithm) overrides :meth:`Manifold.prepare`.
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
"""Numbers of an intermediate array that fits the cache of a core (1 MB in single precision)."""


MIN_BLOCK_ROWS = 8
"""Rows of a block below which a matrix product is no faster than one row at a time."""


class KernelBlock(ABC):
    """Distances and gradients between m query points and the n prepared points.

    Attributes
    ----------
    scaled_sq_dist
        d^2 / h^2 [m, n], the argument z of the kernel profile k(z) in (7); infinite where there is
        no logarithm. The caller may overwrite it.
    """

    scaled_sq_dist: Array

    @abstractmethod
    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        """Numerator and denominator of the mean shift vector (9).

        Parameters
        ----------
        weights
            The weights g(d^2 / h^2) [m, n].

        Returns
        -------
        summed
            The sums over the n points of the weights times -1/2 grad d^2, tangents [m, ...].
        total
            The sums of the weights [m].
        """


class PreparedPoints(ABC):
    """n fixed points of a manifold, prepared for many queries.

    Attributes
    ----------
    manifold
        The manifold.
    size
        The number n of points.
    bandwidth
        h, by which distances are divided.
    block_rows
        The number of query points per block with which the work stays in the cache.
    """

    manifold: Manifold
    size: int
    bandwidth: float
    block_rows: int

    @abstractmethod
    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from the query points ``x`` [m, ...]."""

    def nearest(self, x: Floats, count: int) -> Array:
        """Scaled squared distances of the ``count`` + 1 points nearest to each of ``x`` [m, ...].

        Returns [m, count + 1]: the largest last, the others in no particular order.
        """
        z = self.block(x).scaled_sq_dist
        z.partition(count, axis=1)
        return z[:, : count + 1]


class Manifold(ABC):
    """A Riemannian manifold with a distance, an exponential map and a logarithm.

    Subclasses have a plain constructor (``Grassmann(10, 3)``), which raises ConfigurationError for
    arguments without a manifold. The traits say which laws hold; the law tests check each of them,
    over the ``examples`` of every registered class.
    """

    examples: ClassVar[tuple[str, ...]] = ()
    """Names of typical members of the family, for the law tests and error messages."""

    is_metric: bool = True
    """The distance satisfies the triangle inequality."""
    dist_is_geodesic: bool = True
    """The distance is the length of the logarithm, (2)."""
    exact_gradient: bool = True
    """``neg_half_grad_sq_dist`` is exact, so that a mean shift step raises the density."""
    left_invariant: bool = False
    """Points are matrices of a group, and d(g x, g y) = d(x, y)."""
    basis_free: bool = False
    """x and x q are the same point for any orthogonal q."""

    @classmethod
    @abstractmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Manifold:
        """The member of the family whose name has these ``arguments``.

        Raises
        ------
        ConfigurationError
            Where there is none.
        """

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
    def floats_per_prepared_point(self) -> int:
        """The approximate number of floats that ``prepare`` keeps for each point."""
        return 2 * int(np.prod(self.point_shape)) + 2

    @abstractmethod
    def exp(self, x: Floats, v: Floats) -> Floats:
        """The exponential map: the geodesic from ``x`` with velocity ``v``, after unit time."""

    @abstractmethod
    def log(self, x: Floats, y: Floats) -> Floats:
        """The logarithm: the shortest tangent v at ``x`` with exp(x, v) = ``y``; NaN if none."""

    @abstractmethod
    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The inner product g_x(u, v) of two tangents at ``x``."""

    @abstractmethod
    def project(self, x: Floats) -> Floats:
        """A point of the manifold near the array ``x``; ``x`` itself where it is a point."""

    @abstractmethod
    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The orthogonal projection of the array ``v`` onto the tangent space at ``x``."""

    @abstractmethod
    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """``size`` random points: uniform if the manifold is compact, else near the origin."""

    @abstractmethod
    def constraint_violation(self, x: Floats) -> Floats:
        """How far each array ``x`` is from being a point: 0 for a point, infinite beyond repair."""

    def random_tangent(self, x: Floats, rng: np.random.Generator) -> Floats:
        """A random tangent of unit norm at each ``x``."""
        v = self.project_tangent(x, rng.standard_normal(np.shape(x)))
        length = self.norm(x, v)
        return np.asarray(v / _per_point(length, self), dtype=np.float64)

    def norm(self, x: Floats, v: Floats) -> Floats:
        """The norm of the tangent ``v`` at ``x``."""
        return np.sqrt(np.maximum(self.inner(x, v, v), 0.0))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The distance d(x, y); infinite where ``y`` has no logarithm at ``x``."""
        length = self.norm(x, self.log(x, y))
        return np.where(np.isnan(length), np.inf, length)

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """-1/2 times the gradient of d^2(x, y) with respect to ``x``, as in (9); 0 where d is inf.

        Where the distance is geodesic, that is the logarithm.
        """
        return np.nan_to_num(self.log(x, y), nan=0.0)

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """Prepare data points for mean shift.

        Parameters
        ----------
        y
            The points [n, ...].
        bandwidth
            h, in the distance of the manifold.
        precise
            Whether double precision is needed; without it, single precision is allowed.
        cutoff
            Points that are further than this many bandwidths may be left out: their
            ``scaled_sq_dist`` may be infinite, and their weight must then be 0.

        Returns
        -------
        PreparedPoints
            The points, with the methods that mean shift needs.
        """
        return LogPreparedPoints(self, y, bandwidth)

    def pairwise_dist2(self, x: Floats, y: Floats) -> Floats:
        """Squared distances [m, n] between the points ``x`` [m, ...] and ``y`` [n, ...]."""
        z = self.prepare(y).block(x).scaled_sq_dist
        return np.maximum(z, 0.0).astype(np.float64)

    def mean_tangent(self, x: Floats, y: Floats, w: Floats) -> Floats:
        """The weighted mean of -1/2 grad d^2: the mean shift vector (9).

        Parameters
        ----------
        x
            Where to evaluate, points [m, ...].
        y
            Data points [n, ...].
        w
            The weights g(d^2 / h^2) [m, n]; a row of zeros gives the zero tangent.

        Returns
        -------
        array
            Tangents at ``x`` [m, ...].
        """
        summed, total = self.prepare(y).block(x).weighted_sum(np.asarray(w, dtype=np.float64))
        return _per_point(1.0 / np.where(total > 0, total, 1.0), self) * summed

    def check_point(self, x: Floats, tolerance: float = 1e-6) -> None:
        """Check that all arrays ``x`` [..., *point_shape] are points.

        Parameters
        ----------
        x
            The arrays.
        tolerance
            The largest allowed ``constraint_violation``.

        Raises
        ------
        DataError
            For a wrong shape, or naming the first array that is not finite or not a point.
        """
        shape = self.point_shape
        if np.shape(x)[max(np.ndim(x) - len(shape), 0) :] != shape:
            raise DataError(f"points of {self.name} have shape {shape}, found {np.shape(x)}")
        finite = np.isfinite(x).reshape(-1, int(np.prod(shape))).all(axis=1)
        if not finite.all():
            raise DataError(f"point {int(np.argmin(finite))} of {self.name} is not finite")
        violation = np.ravel(self.constraint_violation(np.asarray(x, dtype=np.float64)))
        wrong = ~(violation <= tolerance)
        if wrong.any():
            i = int(np.argmax(wrong))
            raise DataError(
                f"point {i} is not on {self.name}: it is {violation[i]:.3g} away from it"
            )

    def __repr__(self) -> str:
        return f"<manifold {self.name}>"


class LogPreparedPoints(PreparedPoints):
    """The default, made from the manifold's ``dist`` and ``neg_half_grad_sq_dist``.

    Parameters
    ----------
    manifold
        The manifold.
    y
        The points [n, ...].
    bandwidth
        h.
    """

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float) -> None:
        self.manifold, self.y, self.bandwidth = manifold, y, bandwidth
        self.size = len(y)
        numbers = max(1, self.size * int(np.prod(manifold.point_shape)))
        self.block_rows = max(1, CACHE_NUMBERS // numbers)

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, ...], pair by pair."""
        return _LogBlock(self, x)


class _LogBlock(KernelBlock):
    def __init__(self, prepared: LogPreparedPoints, x: Floats) -> None:
        at, to = x[:, None], prepared.y[None]
        self.scaled_sq_dist = (prepared.manifold.dist(at, to) / prepared.bandwidth) ** 2
        self._gradients = prepared.manifold.neg_half_grad_sq_dist(at, to)

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        double = weights.astype(np.float64)
        return np.einsum("mn,mn...->m...", double, self._gradients), double.sum(axis=1)


def precision(precise: bool, magnitude: float, bandwidth: float) -> Precision | None:
    """The precision in which to compute d^2 / h^2 as a difference of larger terms.

    Parameters
    ----------
    precise
        Whether single precision is not allowed.
    magnitude
        The size of the terms.
    bandwidth
        h.

    Returns
    -------
    dtype or None
        Single precision if it is allowed and d^2 / h^2 is good to about 0.01, else double; None
        where the bandwidth is so small that cancellation leaves nothing in double precision either.
    """
    for kind in (np.float64,) if precise else (np.float32, np.float64):
        if magnitude * float(np.finfo(kind).eps) < 1e-2 * bandwidth**2:
            return np.dtype(kind)
    return None


def parse_integers(family: str, arguments: tuple[str, ...], expected: str) -> tuple[int, ...]:
    """The ``arguments`` of a manifold's name as integers >= 1.

    Parameters
    ----------
    family
        The name without arguments.
    arguments
        The arguments as text.
    expected
        Their names, for instance ``N,k``: as many are required.

    Raises
    ------
    ConfigurationError
        For another number of arguments, or one that is no positive integer.
    """
    count = expected.count(",") + 1
    if len(arguments) != count or not all(a.isdecimal() and int(a) >= 1 for a in arguments):
        found = ",".join(arguments)
        raise ConfigurationError(
            f"no manifold is called {family}({found}): use {family}({expected})"
        )
    return tuple(int(a) for a in arguments)


def _per_point(numbers: Floats, manifold: Manifold) -> Floats:
    """``numbers`` [...], shaped to multiply points [..., *point_shape]."""
    return np.reshape(numbers, np.shape(numbers) + (1,) * len(manifold.point_shape))
