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

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import wraps
from typing import Any, ClassVar, TypeVar

import numpy as np

from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds.prepared import LogPreparedPoints, PreparedPoints
from mssegment.records import Floats

ARRAY_METHODS = (
    "exp",
    "log",
    "inner",
    "norm",
    "dist",
    "neg_half_grad_sq_dist",
    "project",
    "project_tangent",
    "constraint_violation",
    "pairwise_dist2",
    "mean_tangent",
)
"""Methods whose arguments are all arrays: lists and integers are converted to float64."""


Method = TypeVar("Method", bound=Callable[..., Any])


def _on_arrays(method: Method) -> Method:
    """``method`` with every argument converted to an array of float64."""

    @wraps(method)
    def converted(self: Manifold, *arrays: Any, **named: Any) -> Any:
        arrays = tuple(np.asarray(array, dtype=np.float64) for array in arrays)
        named = {name: np.asarray(array, dtype=np.float64) for name, array in named.items()}
        return method(self, *arrays, **named)

    return converted  # type: ignore[return-value]


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
    """The distance is that of (2), the length of the shortest geodesic; -1/2 times the gradient of
    its square is the logarithm."""
    exact_gradient: bool = True
    """``neg_half_grad_sq_dist`` is exact, so that a mean shift step raises the density."""
    left_invariant: bool = False
    """Points are matrices of a group, and d(g x, g y) = d(x, y)."""
    basis_free: bool = False
    """x and x q are the same point for any orthogonal q."""
    is_compact: bool = False
    """Distances are bounded, and ``random_point`` is uniform."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        for name in ARRAY_METHODS:
            if name in vars(cls):
                setattr(cls, name, _on_arrays(vars(cls)[name]))

    @classmethod
    @abstractmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Manifold:
        """The member of the family whose name has these ``arguments``.

        Raises
        ------
        ConfigurationError
            Where there is none.
        """

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Manifold:
        """The member of the family whose points are arrays of this shape.

        Raises
        ------
        ConfigurationError
            Where there is none, or the shape does not say which.
        """
        raise ConfigurationError(
            f"the shape {shape} of the points does not say which manifold of the family "
            f"{cls.__name__} is meant: name one, for instance {cls.examples[0]}"
        )

    @staticmethod
    def as_square(shape: tuple[int, ...]) -> tuple[int, ...]:
        """The shape of a square matrix of which all entries are in one row; others as they are."""
        size = math.isqrt(shape[0]) if len(shape) == 1 else 0
        return (size, size) if size > 1 and size * size == shape[0] else shape

    @staticmethod
    def expect_axes(family: str, shape: tuple[int, ...], axes: int) -> tuple[int, ...]:
        """``shape``, or a ConfigurationError where it has not so many axes."""
        if len(shape) != axes:
            kind = "vectors" if axes == 1 else "matrices"
            raise ConfigurationError(
                f"points of {family} are {kind}, found arrays of shape {shape}"
            )
        return shape

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
        """A point of the manifold near the array ``x``; ``x`` itself where it is a point.

        Raises
        ------
        DataError
            Where there is none near, naming the first such array.
        """

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

    @_on_arrays
    def norm(self, x: Floats, v: Floats) -> Floats:
        """The norm of the tangent ``v`` at ``x``."""
        return np.sqrt(np.maximum(self.inner(x, v, v), 0.0))

    @_on_arrays
    def dist(self, x: Floats, y: Floats) -> Floats:
        """The distance d(x, y); infinite where ``y`` has no logarithm at ``x``."""
        length = self.norm(x, self.log(x, y))
        return np.where(np.isnan(length), np.inf, length)

    @_on_arrays
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

    @_on_arrays
    def pairwise_dist2(self, x: Floats, y: Floats) -> Floats:
        """Squared distances [m, n] between the points ``x`` [m, ...] and ``y`` [n, ...]."""
        z = self.prepare(y).block(x).scaled_sq_dist
        return np.maximum(z, 0.0).astype(np.float64)

    @_on_arrays
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
        self.check_finite(x)
        violation = np.ravel(self.constraint_violation(np.asarray(x, dtype=np.float64)))
        wrong = ~(violation <= tolerance)
        if wrong.any():
            i = int(np.argmax(wrong))
            raise DataError(
                f"point {i} is not on {self.name}: it is {violation[i]:.3g} away from it"
            )

    def tangent_basis(self, x: Floats) -> Floats:
        """A basis [dim, *point_shape] of the tangent space at one point ``x``.

        Orthonormal, unless a manifold has coordinates that everybody knows, as rigid motions have.
        """
        size = int(np.prod(self.point_shape))
        units = np.eye(size).reshape(size, *self.point_shape)
        tangents = self.project_tangent(np.broadcast_to(x, units.shape), units)
        u, _, _ = np.linalg.svd(tangents.reshape(size, -1).T)
        spanning = u[:, : self.dim].T.reshape(self.dim, *self.point_shape)
        pairs = np.broadcast_to(x, spanning.shape)
        gram = self.inner(pairs[None], spanning[:, None], spanning[None])
        values, q = np.linalg.eigh(gram)
        return np.asarray(np.tensordot(q / np.sqrt(values), spanning, axes=(0, 0)))

    def coordinates(self, x: Floats, v: Floats) -> Floats:
        """The coordinates [n, dim] of tangents ``v`` [n, ...] at one point ``x``."""
        basis = self.tangent_basis(x)
        at = np.broadcast_to(x, basis.shape)
        gram = self.inner(at[None], basis[:, None], basis[None])
        products = self.inner(at[None], np.asarray(v)[:, None], basis[None])
        return np.asarray(np.linalg.solve(gram, products.T).T)

    def check_finite(self, x: Floats) -> None:
        """Check that ``x`` [..., *point_shape] are finite arrays of the shape of points.

        Raises
        ------
        DataError
            For a wrong shape, or naming the first array that is not finite.
        """
        shape = self.point_shape
        if np.shape(x)[max(np.ndim(x) - len(shape), 0) :] != shape:
            raise DataError(f"points of {self.name} have shape {shape}, found {np.shape(x)}")
        finite = np.isfinite(x).reshape(-1, int(np.prod(shape))).all(axis=1)
        if not finite.all():
            raise DataError(f"point {int(np.argmin(finite))} of {self.name} is not finite")

    def _refuse(self, impossible: Any, why: str) -> None:
        """Raise a DataError that names the first array for which ``impossible`` is true."""
        if np.any(impossible):
            i = int(np.argmax(np.ravel(impossible)))
            raise DataError(f"array {i} has no point of {self.name} near it: {why}")

    def __repr__(self) -> str:
        return f"<manifold {self.name}>"


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
