"""Symmetric positive definite matrices, with the affine-invariant or the log-Euclidean metric."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold, parse_integers
from mssegment.manifolds.euclidean import Euclidean
from mssegment.manifolds.prepared import CACHE_NUMBERS, Array, KernelBlock, PreparedPoints
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
            return _symmetric(root @ symmetric_function(np.exp, _around(inverse, v)) @ root)
        return symmetric_function(np.exp, symmetric_function(np.log, x) + self._from_tangent(x, v))

    def log(self, x: Floats, y: Floats) -> Floats:
        """The inverse of ``exp``; it exists and is unique everywhere."""
        if self.is_affine:
            root, inverse = square_roots(x)
            return _symmetric(root @ symmetric_function(np.log, _around(inverse, y)) @ root)
        difference = symmetric_function(np.log, y) - symmetric_function(np.log, x)
        return self._to_tangent(x, difference)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """tr(x^-1 u x^-1 v); or that of the derivatives of the logarithm."""
        if self.is_affine:
            _, inverse = square_roots(x)
            u, v = _around(inverse, u), _around(inverse, v)
        else:
            u, v = self._from_tangent(x, u), self._from_tangent(x, v)
        return np.asarray(np.sum(u * v, axis=(-2, -1)))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The length of the logarithm, from generalized eigenvalues or from matrix logarithms."""
        if self.is_affine:
            values = symmetric_eigen(_around(square_roots(x)[1], y))[0]
            return np.asarray(np.linalg.norm(np.log(values), axis=-1))
        difference = symmetric_function(np.log, y) - symmetric_function(np.log, x)
        return np.asarray(np.linalg.norm(difference, axis=(-2, -1)))

    def project(self, x: Floats) -> Floats:
        """The symmetric part of ``x``; there is no point near where that is not positive."""
        self.check_finite(x)
        symmetric = _symmetric(x)
        values = np.linalg.eigvalsh(symmetric)
        largest = np.abs(values).max(axis=-1, initial=0.0)
        self._refuse(~(values[..., 0] > DEFINITE * largest), "it is not positive definite")
        return symmetric

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The symmetric part of ``v``."""
        return _symmetric(np.broadcast_to(v, np.broadcast_shapes(x.shape, v.shape)))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Exponentials of random symmetric matrices of norm 0.1 to 1.5, [size, n, n]."""
        v = _symmetric(rng.standard_normal((size, self.n, self.n)))
        v *= (rng.uniform(0.1, 1.5, size) / np.linalg.norm(v, axis=(1, 2)))[:, None, None]
        return symmetric_function(np.exp, v)

    def constraint_violation(self, x: Floats) -> Floats:
        """The relative asymmetry; infinite where x is not positive definite."""
        largest = np.abs(x).max(axis=(-2, -1), initial=0.0)
        error = np.abs(x - _t(x)).max(axis=(-2, -1), initial=0.0)
        relative = np.divide(error, largest, out=np.zeros_like(largest), where=largest > 0)
        smallest = np.linalg.eigvalsh(_symmetric(x))[..., 0]
        return np.where(smallest > DEFINITE * largest, relative, np.inf)

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, ...]."""
        if self.is_affine:
            return _AffinePoints(self, np.asarray(y, dtype=np.float64), bandwidth, cutoff)
        return _LogPoints(self, y, bandwidth, precise)

    def _from_tangent(self, x: Floats, v: Floats) -> Floats:
        """D log(x)[v], by divided differences of the logarithm (Daleckii and Krein)."""
        q, differences = _divided(x)
        return np.asarray(q @ ((_t(q) @ v @ q) * differences) @ _t(q))

    def _to_tangent(self, x: Floats, v: Floats) -> Floats:
        """D exp(log x)[v], the inverse of ``_from_tangent``."""
        q, differences = _divided(x)
        return np.asarray(q @ ((_t(q) @ v @ q) / differences) @ _t(q))


DEFINITE = 1e-15
"""A matrix is positive definite where its smallest eigenvalue is more than rounding errors."""


class _AffinePoints(PreparedPoints):
    """All x^-1/2 y x^-1/2 of a block: their eigenvalues, and the vectors of those that matter."""

    def __init__(self, manifold: SPD, y: Floats, bandwidth: float, cutoff: float) -> None:
        self.manifold, self.y, self.size, self.bandwidth = manifold, y, len(y), bandwidth
        self.cutoff = cutoff
        self.block_rows = max(1, CACHE_NUMBERS // max(1, self.size * manifold.n**2))

    def block(self, x: Floats) -> KernelBlock:
        return _AffineBlock(self, x)


class _AffineBlock(KernelBlock):
    def __init__(self, prepared: _AffinePoints, x: Floats) -> None:
        self._root, inverse = square_roots(x)
        self._ratio = _around(inverse[:, None], prepared.y[None])
        values = np.log(symmetric_eigenvalues(self._ratio))
        self.scaled_sq_dist = np.einsum("mni,mni->mn", values, values) / prepared.bandwidth**2
        self._near = self.scaled_sq_dist <= prepared.cutoff**2

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        row, column = np.nonzero(self._near)
        values, vectors = symmetric_eigen(self._ratio[row, column])
        scaled = vectors * (np.log(values) * weights[row, column, None])[:, None, :]
        logs = scaled @ _t(vectors)
        sums = np.zeros(self._root.shape)
        starts = np.searchsorted(row, np.arange(len(weights)))
        filled = np.flatnonzero(np.diff(starts, append=len(row)))
        if filled.size:
            sums[filled] = np.add.reduceat(logs, starts[filled], axis=0)
        total = weights.sum(axis=1, dtype=np.float64)
        return self._root @ sums @ self._root, total


class _LogPoints(PreparedPoints):
    """The logarithms of the points, in the coordinates of a Euclidean space."""

    def __init__(self, manifold: SPD, y: Floats, bandwidth: float, precise: bool) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        self.space = Euclidean(manifold.n**2).prepare(self.embed(y), bandwidth, precise)
        self.block_rows = self.space.block_rows

    def embed(self, x: Floats) -> Floats:
        """The entries of the matrix logarithms [m, n^2]."""
        return symmetric_function(np.log, np.asarray(x)).reshape(
            len(x), self.manifold.point_shape[0] ** 2
        )

    def block(self, x: Floats) -> KernelBlock:
        return _LogBlock(self, x)


class _LogBlock(KernelBlock):
    def __init__(self, prepared: _LogPoints, x: Floats) -> None:
        self._manifold, self._x = prepared.manifold, x
        self._block = prepared.space.block(prepared.embed(x))
        self.scaled_sq_dist = self._block.scaled_sq_dist

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        summed, total = self._block.weighted_sum(weights)
        assert isinstance(self._manifold, SPD)
        return self._manifold._to_tangent(self._x, summed.reshape(self._x.shape)), total


def symmetric_function(function: Callable[[Floats], Floats], x: Floats) -> Floats:
    """A function of symmetric matrices [..., n, n], applied to their eigenvalues."""
    values, q = eigh(x)
    return np.asarray((q * function(values)[..., None, :]) @ _t(q))


def eigh(x: Floats) -> tuple[Floats, Floats]:
    """``np.linalg.eigh``, with NaN where a matrix is not finite instead of an error for all."""
    finite = np.asarray(np.isfinite(x).all(axis=(-2, -1), keepdims=True))
    if finite.all():
        return np.linalg.eigh(x)
    values, vectors = np.linalg.eigh(np.where(finite, x, np.eye(x.shape[-1])))
    return np.where(finite[..., 0], values, np.nan), np.where(finite, vectors, np.nan)


def symmetric_eigenvalues(x: Floats) -> Floats:
    """The eigenvalues of ``symmetric_eigen`` alone."""
    if x.shape[-1] == 2:
        return symmetric_eigen(x)[0]
    finite = np.asarray(np.isfinite(x).all(axis=(-2, -1), keepdims=True))
    values = np.linalg.eigvalsh(np.where(finite, x, np.eye(x.shape[-1])))
    return np.where(finite[..., 0], values, np.nan)


def symmetric_eigen(x: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues [..., n] and orthonormal eigenvectors of symmetric matrices [..., n, n].

    2 x 2 matrices by one Jacobi rotation, which is 5 times as fast as LAPACK.
    """
    if x.shape[-1] != 2:
        return eigh(x)
    a, b, d = x[..., 0, 0], x[..., 1, 0], x[..., 1, 1]
    angle = 0.5 * np.arctan2(2.0 * b, a - d)
    cosine, sine = np.cos(angle), np.sin(angle)
    half = 0.5 * np.hypot(a - d, 2.0 * b)
    larger = 0.5 * (a + d) + half
    smaller = (a * d - b * b) / larger
    vectors = np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(x.shape)
    return np.stack([larger, smaller], axis=-1), vectors


def square_roots(x: Floats) -> tuple[Floats, Floats]:
    """x^1/2 and x^-1/2 of symmetric positive definite matrices [..., n, n]."""
    values, q = eigh(x)
    root = np.sqrt(values)[..., None, :]
    return np.asarray((q * root) @ _t(q)), np.asarray((q / root) @ _t(q))


def _around(inverse: Floats, y: Floats) -> Floats:
    """x^-1/2 y x^-1/2, with ``inverse`` = x^-1/2."""
    return _symmetric(inverse @ y @ inverse)


def _divided(x: Floats) -> tuple[Floats, Floats]:
    """Eigenvectors of ``x``, and the divided differences of ln at its eigenvalues [..., n, n].

    With a, b the logarithms: (a - b) / (e^a - e^b) = e^(-(a + b) / 2) h / sinh h, h = (a - b) / 2.
    """
    values, q = eigh(x)
    logs = np.log(values)
    half = 0.5 * (logs[..., :, None] - logs[..., None, :])
    mean = 0.5 * (logs[..., :, None] + logs[..., None, :])
    ratio = np.divide(half, np.sinh(half), out=np.ones_like(half), where=half != 0)
    return q, np.exp(-mean) * ratio


def _t(x: Floats) -> Floats:
    return np.swapaxes(x, -1, -2)


def _symmetric(x: Floats) -> Floats:
    return np.asarray(0.5 * (x + _t(x)))
