"""The Stiefel manifold: orthonormal frames of k vectors in R^N."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold, parse_integers
from mssegment.manifolds.euclidean import Euclidean
from mssegment.manifolds.matrices import exponential
from mssegment.manifolds.prepared import Array, KernelBlock, PreparedPoints
from mssegment.records import Floats

MAX_SHOTS = 200
"""The largest number of corrections of the logarithm; each divides the miss by about 2 at distance
1, and by more at smaller ones."""
REACHED, HIT = 1e-15, 1e-9
"""Misses, per entry, at which the corrections end, and above which there is no logarithm."""


class Stiefel(Manifold):
    """St(N, k), the N x k matrices x with x'x = I, in the metric of the space of matrices.

    Unlike on G(N, k) the vectors themselves matter, not only what they span. The distance is the
    chordal one, |x - y|_F: a metric, and shorter than the geodesic. ``neg_half_grad_sq_dist`` is
    the exact gradient of its square, so that mean shift needs no logarithm.

    Parameters
    ----------
    n
        N, the dimension of the space.
    k
        The number of vectors, 1 <= k < N.

    Raises
    ------
    ConfigurationError
        For other numbers.

    References
    ----------
    A. Edelman, T. Arias and S. Smith, "The geometry of algorithms with orthogonality constraints",
    SIAM J. Matrix Anal. Appl. 20, 1998, section 2.2. D. Bryner, "Endpoint geodesics on the Stiefel
    manifold embedded in Euclidean space", SIAM J. Matrix Anal. Appl. 38, 2017.

    Examples
    --------
    >>> import numpy as np
    >>> frames = Stiefel(3, 2)
    >>> x = np.eye(3)[:, :2]
    >>> frames.dist(x, -x).round(3).item()
    2.828
    """

    examples = ("stiefel(3,1)", "stiefel(4,2)", "stiefel(6,3)")
    dist_is_geodesic = False
    is_compact = True

    def __init__(self, n: int, k: int) -> None:
        if not 1 <= k < n:
            raise ConfigurationError(f"stiefel({n},{k}) is no manifold: use 1 <= k < N")
        self.n, self.k = n, k

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Stiefel:
        """St(N, k) from ``(N, k)``."""
        return cls(*parse_integers("stiefel", arguments, "N,k"))

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Stiefel:
        """St(N, k) for matrices of this shape."""
        return cls(*cls.expect_axes("stiefel", shape, 2))

    @property
    def name(self) -> str:
        """``stiefel(N,k)``."""
        return f"stiefel({self.n},{self.k})"

    @property
    def dim(self) -> int:
        """The dimension, N k - k (k + 1) / 2."""
        return self.n * self.k - self.k * (self.k + 1) // 2

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(N, k)``."""
        return (self.n, self.k)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """[x v] exp([A -S; I A]) [I; 0] exp(-A) with A = x'v and S = v'v."""
        a, s = _t(x) @ v, _t(v) @ v
        k, shape = self.k, np.broadcast_shapes(x.shape, v.shape)[:-2]
        block = np.zeros((*shape, 2 * k, 2 * k))
        block[..., :k, :k] = block[..., k:, k:] = a
        block[..., :k, k:], block[..., k:, :k] = -s, np.eye(k)
        moved = exponential(block)[..., :k]
        return np.asarray((x @ moved[..., :k, :] + v @ moved[..., k:, :]) @ exponential(-a))

    def log(self, x: Floats, y: Floats) -> Floats:
        """The tangent whose geodesic ends in ``y``, by shooting; NaN where that does not converge.

        The miss is projected onto the tangent space at ``x``, with its length, and added.
        """
        x, y = np.broadcast_arrays(x, y)
        v = self.project_tangent(x, y - x)
        for _ in range(MAX_SHOTS):
            end = self.exp(x, v)
            miss = y - end
            if not np.abs(miss).max(initial=0.0) > REACHED:
                break
            there, here = self.project_tangent(end, miss), self.project_tangent(x, miss)
            length = np.linalg.norm(there, axis=(-2, -1), keepdims=True)
            own = np.linalg.norm(here, axis=(-2, -1), keepdims=True)
            v = v + here * np.divide(length, own, out=np.ones_like(own), where=own > 0)
        miss = np.abs(y - self.exp(x, v)).max(axis=(-2, -1), keepdims=True, initial=0.0)
        return np.where(miss < HIT, v, np.nan)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The inner product tr(u'v)."""
        return np.asarray(np.sum(u * v, axis=(-2, -1)))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The chordal distance |x - y|_F."""
        return np.asarray(np.linalg.norm(x - y, axis=(-2, -1)))

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """The projection of y - x onto the tangent space."""
        return self.project_tangent(x, y - x)

    def project(self, x: Floats) -> Floats:
        """The orthonormal frame nearest to ``x``."""
        self.check_finite(x)
        u, _, v = np.linalg.svd(x, full_matrices=False)
        return np.asarray(u @ v)

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """v minus x times the symmetric part of x'v."""
        product = _t(x) @ v
        return np.asarray(v - x @ (0.5 * (product + _t(product))))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Uniformly distributed frames [size, N, k]."""
        q, r = np.linalg.qr(rng.standard_normal((size, self.n, self.k)))
        return np.asarray(q * np.sign(np.diagonal(r, axis1=-2, axis2=-1))[:, None, :])

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest entry of |x'x - I|."""
        return np.asarray(np.max(np.abs(_t(x) @ x - np.eye(self.k)), axis=(-2, -1)))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, N, k] as points of a Euclidean space; no cutoff."""
        return _FramePoints(self, y, bandwidth, precise)


class _FramePoints(PreparedPoints):
    def __init__(self, manifold: Stiefel, y: Floats, bandwidth: float, precise: bool) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        self.numbers = manifold.n * manifold.k
        flat = np.reshape(y, (len(y), self.numbers))
        self.space = Euclidean(self.numbers).prepare(flat, bandwidth, precise)
        self.block_rows = self.space.block_rows

    def block(self, x: Floats) -> KernelBlock:
        return _FrameBlock(self, x)


class _FrameBlock(KernelBlock):
    def __init__(self, prepared: _FramePoints, x: Floats) -> None:
        self._manifold, self._x = prepared.manifold, x
        self._block = prepared.space.block(x.reshape(len(x), prepared.numbers))
        self.scaled_sq_dist = self._block.scaled_sq_dist

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        summed, total = self._block.weighted_sum(weights)
        return self._manifold.project_tangent(self._x, summed.reshape(self._x.shape)), total


def _t(x: Floats) -> Floats:
    return np.swapaxes(x, -1, -2)
