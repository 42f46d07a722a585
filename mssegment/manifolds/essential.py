"""The essential manifold: relative motions of two calibrated cameras, without the scale."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.geometry.rotations import rotation
from mssegment.manifolds.base import Manifold
from mssegment.manifolds.grassmann import Grassmann
from mssegment.manifolds.prepared import Array, KernelBlock, PreparedPoints
from mssegment.manifolds.rotations import nearest_rotation, rotation_vectors
from mssegment.records import Floats

GRID, BISECTIONS = 24, 50
"""The angle of the fibre is first one of so many, then found by so many bisections around it."""


class Essential(Manifold):
    """The essential matrices E = [t]x R with |t| = 1, up to their sign, dimension 5.

    Points are 3 x 3 matrices with singular values 1, 1, 0; E and -E are the same point. With
    E = U diag(1, 1, 0) V', geodesics turn U and V, and the inner product is twice that of their
    rotation vectors w and z with the least |w|^2 + |z|^2. The distance is the chordal one of the
    lines that the matrices are in R^9, the sine of the angle between them: a metric, and shorter
    than the geodesic. ``neg_half_grad_sq_dist`` is the exact gradient of its square.

    References
    ----------
    R. Tron and K. Daniilidis, "The space of essential matrices as a Riemannian quotient manifold",
    SIAM J. Imaging Sci. 10, 2017.

    Examples
    --------
    >>> import numpy as np
    >>> manifold = Essential()
    >>> sideways = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    >>> forwards = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 0]])
    >>> manifold.dist([sideways, sideways], [-sideways, forwards]).round(6).tolist()
    [0.0, 1.0]
    """

    examples = ("essential",)
    dist_is_geodesic = False
    is_compact = True

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Essential:
        """From no arguments."""
        if arguments not in ((), ("",)):
            raise ConfigurationError(
                f"no manifold is called essential({','.join(arguments)}): use essential"
            )
        return cls()

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Essential:
        """From ``(3, 3)``."""
        cls.expect_axes("essential", cls.as_square(shape), 2)
        return cls()

    @property
    def name(self) -> str:
        """``essential``."""
        return "essential"

    @property
    def dim(self) -> int:
        """The dimension, 5."""
        return 5

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(3, 3)``."""
        return (3, 3)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """U exp([w]x) diag(1, 1, 0) exp(-[z]x) V', with the horizontal w and z of the tangent."""
        u, q = _factors(x)
        m = _t(u) @ v @ q
        turn = 0.5 * m[..., 1, 0]
        w = np.stack([m[..., 2, 1], -m[..., 2, 0], turn], axis=-1)
        z = np.stack([m[..., 1, 2], -m[..., 0, 2], -turn], axis=-1)
        left, right = u @ rotation(w), q @ rotation(z)
        return np.asarray(left[..., :2] @ _t(right[..., :2]))

    def log(self, x: Floats, y: Floats) -> Floats:
        """The shortest tangent to ``y`` or -``y``: the angle of the fibre with least length."""
        x, y = np.broadcast_arrays(x, y)
        shape = x.shape
        x, y = x.reshape(-1, 3, 3), y.reshape(-1, 3, 3)
        u, q = _factors(x)
        u2, q2 = _factors(y)
        best, shortest = np.zeros((len(x), 2, 3)), np.full(len(x), np.inf)
        for flip in (np.eye(3), np.diag([1.0, -1.0, -1.0])):
            for sign in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
                pair = np.stack([_t(u) @ u2 @ flip @ sign, _t(q) @ q2 @ flip], axis=1)
                vectors = _along_fibre(pair)
                length = np.sum(vectors**2, axis=(1, 2))
                shorter = length < shortest
                best[shorter], shortest[shorter] = vectors[shorter], length[shorter]
        w, z = best[:, 0], best[:, 1]
        m = np.zeros((len(x), 3, 3))
        m[:, 1, 0] = w[:, 2] - z[:, 2]
        m[:, 0, 1] = -m[:, 1, 0]
        m[:, 2, 1], m[:, 2, 0], m[:, 1, 2], m[:, 0, 2] = w[:, 0], -w[:, 1], z[:, 0], -z[:, 1]
        return np.asarray(u @ m @ _t(q)).reshape(shape)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """2 (w_u'w_v + z_u'z_v), from the entries of the tangents in the frames of E."""
        left, right = _factors(x)
        a, b = _t(left) @ u @ right, _t(left) @ v @ right
        across = sum(a[..., i, j] * b[..., i, j] for i, j in ((0, 2), (1, 2), (2, 0), (2, 1)))
        return np.asarray(2.0 * across + a[..., 1, 0] * b[..., 1, 0])

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The sine of the angle between the lines in R^9."""
        return self._lines.dist(_line(x), _line(y))

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """The gradient in R^9, projected, in the inner product of this manifold."""
        return self.gradient_of_line(x, self._lines.neg_half_grad_sq_dist(_line(x), _line(y)))

    @property
    def _lines(self) -> Grassmann:
        return Grassmann(9, 1)

    def gradient_of_line(self, x: Floats, ambient: Floats) -> Floats:
        """The tangent that represents the derivative ``ambient`` [..., 9, 1] at the line of x."""
        u, q = _factors(x)
        m = _horizontal(
            _t(u) @ (ambient[..., 0] / np.sqrt(2.0)).reshape(*ambient.shape[:-2], 3, 3) @ q
        )
        m *= 0.5
        m[..., :2, :2] *= 4.0
        return np.asarray(u @ m @ _t(q))

    def project(self, x: Floats) -> Floats:
        """The essential matrix nearest to ``x``; there is none near where the rank is below 2."""
        self.check_finite(x)
        largest = np.abs(x).max(axis=(-2, -1), initial=0.0)
        scaled = x / np.where(largest > 0, largest, 1.0)[..., None, None]
        u, s, q = np.linalg.svd(scaled)
        self._refuse(~(s[..., 1] > 1e-12), "its rank is below 2")
        return np.asarray(u[..., :2] @ q[..., :2, :])

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The nearest matrix U M V' with M of the form of a tangent."""
        u, q = _factors(x)
        return np.asarray(u @ _horizontal(_t(u) @ v @ q) @ _t(q))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Uniformly distributed directions and rotations, [size, 3, 3]."""
        u, q = nearest_rotation(rng.standard_normal((2, size, 3, 3)))
        return np.asarray(u[..., :2] @ _t(q[..., :2]))

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of a singular value."""
        values = np.linalg.svd(x, compute_uv=False)
        return np.asarray(np.abs(values - np.array([1.0, 1.0, 0.0])).max(axis=-1))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, 3, 3] as lines of R^9; no cutoff."""
        return _LinePoints(self, np.asarray(y, dtype=np.float64), bandwidth, precise)


class _LinePoints(PreparedPoints):
    def __init__(self, manifold: Essential, y: Floats, bandwidth: float, precise: bool) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        self.gradient = manifold.gradient_of_line
        self.lines = Grassmann(9, 1).prepare(_line(y), bandwidth, precise)
        self.block_rows = self.lines.block_rows

    def block(self, x: Floats) -> KernelBlock:
        return _LineBlock(self, x)


class _LineBlock(KernelBlock):
    def __init__(self, prepared: _LinePoints, x: Floats) -> None:
        self._gradient, self._x = prepared.gradient, x
        self._block = prepared.lines.block(_line(x))
        self.scaled_sq_dist = self._block.scaled_sq_dist

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        summed, total = self._block.weighted_sum(weights)
        return self._gradient(self._x, summed), total


def _t(x: Floats) -> Floats:
    return np.swapaxes(x, -1, -2)


def _line(x: Floats) -> Floats:
    """The unit vectors [..., 9, 1] of essential matrices."""
    return np.asarray(x.reshape(*x.shape[:-2], 9, 1) / np.sqrt(2.0))


def _factors(x: Floats) -> tuple[Floats, Floats]:
    """Rotations U and V with x = U diag(1, 1, 0) V'."""
    u, _, q = np.linalg.svd(x)
    v = np.array(_t(q))
    u[..., 2] *= np.sign(np.linalg.det(u))[..., None]
    v[..., 2] *= np.sign(np.linalg.det(v))[..., None]
    return u, v


def _horizontal(m: Floats) -> Floats:
    """The part of ``m`` [..., 3, 3] of the form [0 -a *; a 0 *; * * 0]."""
    out = np.array(m)
    turn = 0.5 * (m[..., 1, 0] - m[..., 0, 1])
    out[..., 0, 0] = out[..., 1, 1] = out[..., 2, 2] = 0.0
    out[..., 1, 0], out[..., 0, 1] = turn, -turn
    return out


def _along_fibre(pair: Floats) -> Floats:
    """The shortest rotation vectors [k, 2, 3] of A Z(t) and B Z(t) over the angle t about z.

    The derivative of half the squared length is the sum of the third components.
    """

    def vectors(angle: Floats) -> Floats:
        axis = angle[..., None] * np.array([0.0, 0.0, 1.0])
        turned = pair @ rotation(axis)[:, None]
        found = rotation_vectors(np.moveaxis(turned, (-2, -1), (0, 1)))
        return np.asarray(np.moveaxis(found, 0, -1), dtype=np.float64)

    step = 2.0 * np.pi / GRID
    grid = step * np.arange(GRID)
    lengths = [np.sum(vectors(np.full(len(pair), t)) ** 2, axis=(1, 2)) for t in grid]
    low = grid[np.argmin(lengths, axis=0)] - step
    high = low + 2.0 * step
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        rising = vectors(middle)[..., 2].sum(axis=1) > 0
        low, high = np.where(rising, low, middle), np.where(rising, middle, high)
    return vectors(0.5 * (low + high))
