"""Matrix Lie groups with a left-invariant metric (section 4.2 of the paper)."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold
from mssegment.manifolds.group_points import GroupPoints
from mssegment.manifolds.log_gradient import gradient_from_log
from mssegment.manifolds.matrices import exponential, length2, solve
from mssegment.manifolds.prepared import (
    Array,
    LogPreparedPoints,
    PreparedPoints,
    precision,
)
from mssegment.records import Floats


class MatrixGroup(Manifold):
    """A group of s x s matrices with the distance (20), |log x^-1 y|_F.

    The inner product at x is tr((x^-1 u)' x^-1 v). The distance is left-invariant. In general it
    breaks the triangle inequality and is no geodesic distance, and it is infinite where x^-1 y has
    no real logarithm. ``neg_half_grad_sq_dist`` is the logarithm (21), a first-order approximation
    of -1/2 grad d^2 (10 % off at |log| = 0.3), or with ``exact`` that gradient.

    A subclass has the class attributes ``family``, ``order``, ``free_rows`` and ``size``, and the
    methods ``dim``, ``algebra_log``, ``onto_algebra``, ``project`` and ``constraint_violation``.

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient.
    length_scale
        Where the last column of a point is a translation: the length that weighs as much as one
        radian (times sqrt 2). Inner products and distances are those of the points with their
        translations divided by it.

    Raises
    ------
    ConfigurationError
        For a length scale that is not positive and finite, or where there is no translation.

    Notes
    -----
    Algebra elements are arrays with the *matrix axes first*, (free_rows, size, ...): every entry is
    one contiguous array over all pairs of points. Constant last rows are left out.
    """

    is_metric = False
    dist_is_geodesic = False
    left_invariant = True
    family: ClassVar[str]
    """The name without arguments."""
    order: ClassVar[int]
    """The number in the name: 2 of A(2), 3 of SL(3)."""
    free_rows: ClassVar[int]
    """The number of rows that are not constant."""
    size: ClassVar[int]
    """The number s of rows and columns."""

    def __init__(self, *, exact: bool = False, length_scale: float = 1.0) -> None:
        if not 0 < length_scale < np.inf:
            raise ConfigurationError(f"length_scale must be positive, found {length_scale}")
        if length_scale != 1.0 and self.free_rows == self.size:
            raise ConfigurationError(f"{self.family} has no translation that a length_scale scales")
        self.exact_gradient = exact
        self.length_scale = float(length_scale)

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> MatrixGroup:
        """The group from ``(order,)``, then in any order ``exact`` and ``length_scale=NUMBER``."""
        options: dict[str, float | bool] = {}
        for argument in arguments[1:]:
            key, equals, number = (part.strip() for part in argument.partition("="))
            try:
                options[key] = float(number) if equals else True
            except ValueError:
                options[argument] = True
        known = {"exact", "length_scale"} if cls.free_rows < cls.size else {"exact"}
        wrong = arguments[:1] != (str(cls.order),) or not options.keys() <= known
        if wrong or options.get("exact") not in (None, True) or options.get("length_scale") is True:
            found, names = ",".join(arguments), " or ".join(cls.examples)
            raise ConfigurationError(f"no manifold is called {cls.family}({found}): use {names}")
        return cls(
            exact=bool(options.get("exact")), length_scale=float(options.get("length_scale", 1.0))
        )

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> MatrixGroup:
        """The group whose matrices have this shape."""
        shape = cls.as_square(shape)
        if shape != (cls.size, cls.size):
            raise ConfigurationError(
                f"points of {cls.family}({cls.order}) are {cls.size} x {cls.size} matrices, found "
                f"arrays of shape {shape}"
            )
        return cls()

    @property
    def name(self) -> str:
        """``family(order)``, with ``,exact`` and ``,length_scale=NUMBER`` where they apply."""
        scale = "" if self.length_scale == 1.0 else f",length_scale={self.length_scale!r}"
        return f"{self.family}({self.order}{',exact' if self.exact_gradient else ''}{scale})"

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
            The logarithms (free_rows, size, ...), NaN where there is no real one. Half a turn has
            two logarithms of the same norm, of which this is one.
        """

    @abstractmethod
    def onto_algebra(self, v: Array) -> Array:
        """The orthogonal projection of ``v`` (free_rows, size, ...) onto the Lie algebra."""

    def algebra_exp(self, v: Floats) -> Floats:
        """The matrix exponentials (16) of elements of the algebra [..., size, size]."""
        return exponential(v)

    def divide(self, x: Floats, y: Floats) -> Floats:
        """x^-1 y for points ``x`` and points or tangents ``y`` [..., size, size]."""
        return solve(x, y)

    def with_length_scale(self, length_scale: float) -> MatrixGroup:
        """The same group with another length scale."""
        return type(self)(exact=self.exact_gradient, length_scale=length_scale)

    def generators(self) -> Floats | None:
        """The usual basis of the algebra [dim, size, size], None where there is none."""
        return None

    def tangent_basis(self, x: Floats) -> Floats:
        """x times the ``generators``, or an orthonormal basis."""
        generators = self.generators()
        return super().tangent_basis(x) if generators is None else np.asarray(x @ generators)

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(size, size)``."""
        return (self.size, self.size)

    def to_unit(self, x: Floats) -> Floats:
        """Points or tangents with their translations divided by the length scale."""
        return x if self.length_scale == 1.0 else self._scaled(x, 1.0 / self.length_scale)

    def from_unit(self, x: Floats) -> Floats:
        """The inverse of ``to_unit``."""
        return x if self.length_scale == 1.0 else self._scaled(x, self.length_scale)

    def _scaled(self, x: Floats, factor: float) -> Floats:
        scaled = np.array(x, dtype=np.float64)
        scaled[..., : self.free_rows, -1] *= factor
        return scaled

    def _unit_ratio(self, x: Floats, y: Floats) -> Floats:
        """x^-1 y with its translation divided by the length scale, (free_rows, size, ...)."""
        ratio = self.divide(self.to_unit(x), self.to_unit(y))
        return np.ascontiguousarray(np.moveaxis(ratio, (-2, -1), (0, 1))[: self.free_rows])

    def axes_last(self, v: Array) -> Floats:
        """Elements of the algebra (free_rows, size, ...) as (..., size, size), with zero rows."""
        whole = np.zeros((self.size, self.size, *v.shape[2:]))
        whole[: self.free_rows] = v
        return np.ascontiguousarray(np.moveaxis(whole, (0, 1), (-2, -1)))

    def exp(self, x: Floats, v: Floats) -> Floats:
        """Equation (18), x exp(x^-1 v)."""
        x, v = self.to_unit(x), self.to_unit(v)
        return self.from_unit(np.asarray(x @ self.algebra_exp(self.divide(x, v))))

    def log(self, x: Floats, y: Floats) -> Floats:
        """Equation (19), x log(x^-1 y); NaN where there is no real logarithm."""
        log = self.axes_last(self.algebra_log(self._unit_ratio(x, y)))
        return self.from_unit(np.asarray(self.to_unit(x) @ log))

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """tr((x^-1 u)' x^-1 v), the left-invariant inner product that belongs to (20)."""
        x, u, v = self.to_unit(x), self.to_unit(u), self.to_unit(v)
        return np.asarray(np.sum(self.divide(x, u) * self.divide(x, v), axis=(-2, -1)))

    def norm(self, x: Floats, v: Floats) -> Floats:
        """The norm |x^-1 v|_F."""
        ratio = self.divide(self.to_unit(x), self.to_unit(v))
        return np.asarray(np.linalg.norm(ratio, axis=(-2, -1)))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (20), |log x^-1 y|_F; infinite where there is no real logarithm."""
        return np.sqrt(length2(self.algebra_log(self._unit_ratio(x, y)))).astype(np.float64)

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (21), log_x(y), or the exact -1/2 grad d^2; zero where d is infinite."""
        gradient = self.gradient_from_log(self.algebra_log(self._unit_ratio(x, y)))
        whole = self.axes_last(np.nan_to_num(gradient, nan=0.0))
        return self.from_unit(np.asarray(self.to_unit(x) @ whole))

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
        """
        return gradient_from_log(self, log) if self.exact_gradient else log

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """x times the projection of x^-1 v onto the Lie algebra."""
        whole = self.axes_last(self.onto_algebra(self._unit_ratio(x, v)))
        return self.from_unit(np.asarray(self.to_unit(x) @ whole))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Exponentials of random algebra elements of norm 0.1 to 1.5, [size, s, s]."""
        e = np.broadcast_to(np.eye(self.size), (size, self.size, self.size))
        lengths = rng.uniform(0.1, 1.5, (size, 1, 1))
        return self.exp(e, lengths * self.random_tangent(e, rng))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, s, s]; pairs beyond the cutoff need no logarithm."""
        unit = self.to_unit(np.asarray(y, dtype=np.float64))
        largest = np.abs(unit).max(axis=(1, 2), initial=0.0)
        magnitude = float(largest.max(initial=1.0)) ** 2
        dtype = precision(precise, magnitude * bandwidth, bandwidth)
        if dtype is not None or not len(unit):
            return GroupPoints(self, unit, bandwidth, dtype or np.dtype(np.float64), cutoff)
        middle = np.sort(unit, axis=0)[len(unit) // 2]
        origin = unit[np.argmin(_square_sums(unit - middle))]
        centred = self.divide(origin, unit)
        usual = np.sort(np.abs(centred).max(axis=(1, 2)))[int(USUAL * (len(unit) - 1))]
        if float(np.finfo(np.float64).eps) * usual**2 > MAX_USUAL_ERROR * bandwidth:
            return LogPreparedPoints(self, y, bandwidth)
        return GroupPoints(self, centred, bandwidth, np.dtype(np.float64), cutoff, origin)


USUAL, MAX_USUAL_ERROR = 0.9, 1e-3
"""Products of matrices are used where this share of the points, seen from their middle, has errors
of x^-1 y below so many bandwidths; otherwise each pair is divided. What is lost between the others
is little compared with their distances from the rest."""


def _square_sums(x: Floats) -> Floats:
    return np.asarray(np.einsum("nij,nij->n", x, x))
