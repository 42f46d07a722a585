"""Symmetric positive definite matrices, with the affine-invariant or the log-Euclidean metric."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold, parse_integers
from mssegment.manifolds.prepared import PreparedPoints
from mssegment.manifolds.spd_points import AffinePoints, LogPoints, SmallAffinePoints
from mssegment.manifolds.symmetric import (
    around,
    eigenvalues,
    exp_derivative,
    log_derivative,
    square_roots,
    symmetric_function,
    symmetric_part,
    transposed,
)
from mssegment.records import Floats

METRICS = ("affine_invariant", "log_euclidean")


class SPD(Manifold):
    """The symmetric positive definite n x n matrices, dimension n (n + 1) / 2.

    With the affine-invariant metric the distance is |log x^-1/2 y x^-1/2|_F, the same for a x a'
    and a y a' with any invertible a. With the log-Euclidean metric it is |log x - log y|_F, whose
    mean shift is two matrix products. Both are geodesic distances without cut points.

    Parameters
    ----------
    n
        The number of rows and columns.
    metric
        ``affine_invariant`` or ``log_euclidean``.

    Raises
    ------
    ConfigurationError
        For a size below 1 or another metric.

    References
    ----------
    X. Pennec, P. Fillard and N. Ayache, "A Riemannian framework for tensor computing", IJCV 66,
    2006. V. Arsigny, P. Fillard, X. Pennec and N. Ayache, "Geometric means in a novel vector space
    structure on symmetric positive-definite matrices", SIAM J. Matrix Anal. Appl. 29, 2007.

    Examples
    --------
    >>> import numpy as np
    >>> SPD(2).dist(np.eye(2), np.diag([np.e, 1.0])).round(6).item()
    1.0
    """

    examples = ("spd(2)", "spd(3)", "spd(2,log_euclidean)", "spd(3,log_euclidean)")

    def __init__(self, n: int, metric: str = "affine_invariant") -> None:
        if n < 1 or metric not in METRICS:
            raise ConfigurationError(
                f"spd({n},{metric}) is no manifold: use n >= 1 and one of {', '.join(METRICS)}"
            )
        self.n, self.metric = n, metric

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> SPD:
        """From ``(n,)`` or ``(n, metric)``."""
        (n,) = parse_integers("spd", arguments[:1], "n")
        if arguments[1:] and arguments[1:] not in [(metric,) for metric in METRICS]:
            raise ConfigurationError(
                f"no manifold is called spd({','.join(arguments)}): the metrics are "
                f"{' and '.join(METRICS)}"
            )
        return cls(n, arguments[1] if arguments[1:] else METRICS[0])

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> SPD:
        """The affine-invariant metric on matrices of this shape."""
        return cls(cls.expect_axes("spd", cls.as_square(shape), 2)[0])

    @property
    def name(self) -> str:
        """``spd(n)`` or ``spd(n,log_euclidean)``."""
        return f"spd({self.n})" if self.is_affine else f"spd({self.n},{self.metric})"

    @property
    def is_affine(self) -> bool:
        """Whether the metric is affine-invariant."""
        return self.metric == "affine_invariant"

    @property
    def dim(self) -> int:
        """The dimension, n (n + 1) / 2."""
        return self.n * (self.n + 1) // 2

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(n, n)``."""
        return (self.n, self.n)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """r exp(r^-1 v r^-1) r with r = x^1/2; or exp(log x + D log(x)[v])."""
        if self.is_affine:
            root, inverse = square_roots(x)
            return symmetric_part(root @ symmetric_function(np.exp, around(inverse, v)) @ root)
        return symmetric_function(np.exp, symmetric_function(np.log, x) + log_derivative(x, v))

    def log(self, x: Floats, y: Floats) -> Floats:
        """The inverse of ``exp``; it exists and is unique everywhere."""
        if self.is_affine:
            root, inverse = square_roots(x)
            return symmetric_part(root @ symmetric_function(np.log, around(inverse, y)) @ root)
        difference = symmetric_function(np.log, y) - symmetric_function(np.log, x)
        return exp_derivative(x, difference)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """tr(x^-1 u x^-1 v); or that of the derivatives of the logarithm."""
        if self.is_affine:
            _, inverse = square_roots(x)
            u, v = around(inverse, u), around(inverse, v)
        else:
            u, v = log_derivative(x, u), log_derivative(x, v)
        return np.asarray(np.sum(u * v, axis=(-2, -1)))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The length of the logarithm, from generalized eigenvalues or from matrix logarithms."""
        if self.is_affine:
            values = eigenvalues(around(square_roots(x)[1], y))
            return np.asarray(np.linalg.norm(np.log(values), axis=-1))
        difference = symmetric_function(np.log, y) - symmetric_function(np.log, x)
        return np.asarray(np.linalg.norm(difference, axis=(-2, -1)))

    def project(self, x: Floats) -> Floats:
        """The symmetric part of ``x``; there is no point near where that is not positive."""
        self.check_finite(x)
        symmetric = symmetric_part(x)
        values = np.linalg.eigvalsh(symmetric)
        largest = np.abs(values).max(axis=-1, initial=0.0)
        self._refuse(~(values[..., 0] > DEFINITE * largest), "it is not positive definite")
        return symmetric

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The symmetric part of ``v``."""
        return symmetric_part(np.broadcast_to(v, np.broadcast_shapes(x.shape, v.shape)))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Exponentials of random symmetric matrices of norm 0.1 to 1.5, [size, n, n]."""
        v = symmetric_part(rng.standard_normal((size, self.n, self.n)))
        v *= (rng.uniform(0.1, 1.5, size) / np.linalg.norm(v, axis=(1, 2)))[:, None, None]
        return symmetric_function(np.exp, v)

    def constraint_violation(self, x: Floats) -> Floats:
        """The relative asymmetry; infinite where x is not positive definite."""
        largest = np.abs(x).max(axis=(-2, -1), initial=0.0)
        error = np.abs(x - transposed(x)).max(axis=(-2, -1), initial=0.0)
        relative = np.divide(error, largest, out=np.zeros_like(largest), where=largest > 0)
        smallest = np.linalg.eigvalsh(symmetric_part(x))[..., 0]
        return np.where(smallest > DEFINITE * largest, relative, np.inf)

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, ...]."""
        if self.is_affine:
            small = SmallAffinePoints if self.n in (2, 3) else AffinePoints
            return small(self, np.asarray(y, dtype=np.float64), bandwidth, cutoff)
        return LogPoints(self, y, bandwidth, precise)


DEFINITE = 1e-15
"""A matrix is positive definite where its smallest eigenvalue is more than rounding errors."""
