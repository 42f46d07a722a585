"""The rotation groups SO(2) and SO(3)."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.geometry.rotations import rotation
from mssegment.manifolds.directions import DirectionBlock, DirectionPoints
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import (
    Array,
    KernelBlock,
    LogPreparedPoints,
    Precision,
    PreparedPoints,
    precision,
)
from mssegment.records import Floats

QUATERNION_ARC = float(np.sqrt(8.0))
"""The distance (20) of two rotations is this times the angle between their quaternions."""


class Rotations(MatrixGroup):
    """SO(n), the rotations of the plane or of space, dimension 1 or 3.

    Points are n x n rotation matrices. The distance is (20), sqrt 2 times the angle of the rotation
    from one to the other. The inner product is bi-invariant, so it is the geodesic distance, and
    the logarithm is the exact gradient. Half a turn has two logarithms, of which one is returned.

    Parameters
    ----------
    n
        The dimension of the space, 2 or 3.

    Raises
    ------
    ConfigurationError
        For another dimension.

    Examples
    --------
    >>> import numpy as np
    >>> group = Rotations(2)
    >>> half_turn = -np.eye(2)
    >>> (group.dist(np.eye(2), half_turn) / np.sqrt(2)).round(3).item()
    3.142
    """

    examples = ("special_orthogonal(2)", "special_orthogonal(3)")
    family = "special_orthogonal"
    is_metric = True
    dist_is_geodesic = True
    is_compact = True

    def __init__(self, n: int = 3) -> None:
        if n not in (2, 3):
            raise ConfigurationError(f"special_orthogonal({n}) is not implemented: use 2 or 3")
        self.order = self.free_rows = self.size = n  # type: ignore[misc]
        super().__init__(exact=True)

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Rotations:
        """SO(n) from ``(n,)``."""
        if arguments not in (("2",), ("3",)):
            found, names = ",".join(arguments), " or ".join(cls.examples)
            raise ConfigurationError(f"no manifold is called {cls.family}({found}): use {names}")
        return cls(int(arguments[0]))

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Rotations:
        """SO(n) for n x n matrices."""
        return cls(cls.expect_axes(cls.family, cls.as_square(shape), 2)[0])

    @property
    def name(self) -> str:
        """``special_orthogonal(n)``."""
        return f"{self.family}({self.order})"

    @property
    def dim(self) -> int:
        """The dimension, n (n - 1) / 2."""
        return self.order * (self.order - 1) // 2

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The antisymmetric matrices of the angle (n = 2) or of the rotation vector (n = 3)."""
        if self.order == 3:
            return cross_matrices(rotation_vectors(m))
        out = np.zeros_like(m)
        out[1, 0] = np.arctan2(m[1, 0] - m[0, 1], m[0, 0] + m[1, 1])
        out[0, 1] = -out[1, 0]
        return out

    def algebra_exp(self, v: Floats) -> Floats:
        """The rotations by the angle, or by Rodrigues' formula."""
        if self.order == 3:
            return rotation(np.stack([v[..., 2, 1], v[..., 0, 2], v[..., 1, 0]], axis=-1))
        cosine, sine = np.cos(v[..., 1, 0]), np.sin(v[..., 1, 0])
        return np.stack([cosine, -sine, sine, cosine], axis=-1).reshape(v.shape)

    def generators(self) -> Floats:
        """The rotation by a radian, or those about x, y and z."""
        if self.order == 2:
            return np.array([[[0.0, -1.0], [1.0, 0.0]]])
        return np.asarray(np.moveaxis(cross_matrices(np.eye(3)), 2, 0), dtype=np.float64)

    def divide(self, x: Floats, y: Floats) -> Floats:
        """x'y."""
        return np.asarray(np.swapaxes(x, -1, -2) @ y)

    def gradient_from_log(self, log: Array) -> Array:
        """``log`` itself, which is exact here."""
        return log

    def onto_algebra(self, v: Array) -> Array:
        """The antisymmetric part of ``v``."""
        return np.asarray(0.5 * (v - np.swapaxes(v, 0, 1)))

    def project(self, x: Floats) -> Floats:
        """The rotation nearest to ``x`` in the Frobenius norm."""
        self.check_finite(x)
        return nearest_rotation(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest entry of |x'x - I|; infinite for reflections."""
        error = np.max(np.abs(np.swapaxes(x, -1, -2) @ x - np.eye(self.order)), axis=(-2, -1))
        return np.where(np.linalg.det(x) > 0, error, np.inf)

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Uniformly distributed rotations [size, n, n]."""
        q, r = np.linalg.qr(rng.standard_normal((size, self.order, self.order)))
        q *= np.sign(np.diagonal(r, axis1=-2, axis2=-1))[:, None, :]
        q[..., -1] *= np.where(np.linalg.det(q) < 0, -1.0, 1.0)[:, None]
        return np.asarray(q)

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, s, s] as quaternions, or as unit vectors; no cutoff."""
        dtype = precision(precise, 2 * QUATERNION_ARC**2, bandwidth)
        if dtype is None:
            return LogPreparedPoints(self, y, bandwidth)
        return _RotationPoints(self, y, bandwidth, dtype)


class _RotationPoints(PreparedPoints):
    """Rotations of space as unit quaternions, those of the plane as the unit vectors at a / 2.

    A rotation and its quaternion's negative are the same, so directions up to their sign.
    """

    def __init__(self, manifold: Rotations, y: Floats, bandwidth: float, dtype: Precision) -> None:
        self.manifold, self.order, self.bandwidth = manifold, manifold.order, bandwidth
        self.directions = DirectionPoints(
            self.embed(y), bandwidth, dtype, antipodal=True, arc=QUATERNION_ARC
        )
        self.size, self.block_rows = len(y), self.directions.block_rows

    def embed(self, x: Floats) -> Floats:
        """The quaternions [n, 4] (w, x, y, z), or the half-angle vectors [n, 2]."""
        if self.order == 3:
            return np.ascontiguousarray(quaternions(np.moveaxis(x, 0, 2)).T)
        half = 0.5 * np.arctan2(x[:, 1, 0] - x[:, 0, 1], x[:, 0, 0] + x[:, 1, 1])
        return np.stack([np.cos(half), np.sin(half)], axis=1)

    def block(self, x: Floats) -> KernelBlock:
        q = self.embed(x)
        return _RotationBlock(x, q, self.directions.block(q))


class _RotationBlock(KernelBlock):
    def __init__(self, x: Floats, q: Floats, block: DirectionBlock) -> None:
        self._x, self._q, self._block = x, q, block
        self.scaled_sq_dist = block.scaled_sq_dist

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        pull, total = self._block.weighted_sum(weights)
        w, vector = self._q[:, :1], self._q[:, 1:]
        if self._x.shape[-1] == 3:
            half = w * pull[:, 1:] - pull[:, :1] * vector - np.cross(vector, pull[:, 1:])
            turn = cross_matrices(2.0 * half.T)
        else:
            half = (w * pull[:, 1:] - pull[:, :1] * vector)[:, 0]
            zero = np.zeros_like(half)
            turn = np.array([[zero, -2.0 * half], [2.0 * half, zero]])
        return self._x @ np.moveaxis(turn, 2, 0), total


def nearest_rotation(a: Floats) -> Floats:
    """The rotations nearest to square matrices [..., n, n] in the Frobenius norm (Kabsch, 1976)."""
    u, _, v = np.linalg.svd(a)
    u[..., :, -1] *= np.where(np.linalg.det(u @ v) < 0, -1.0, 1.0)[..., None]
    return np.asarray(u @ v)


def quaternions(r: Array) -> Array:
    """Unit quaternions of rotations of space, without loss of digits at any angle.

    The row of 4 q q' with the largest diagonal entry, normalised (Shepperd, 1978).

    Parameters
    ----------
    r
        Rotation matrices (3, 3, ...).

    Returns
    -------
    array
        (w, x, y, z) with w >= 0, (4, ...).
    """
    trace = r[0, 0] + r[1, 1] + r[2, 2]
    q = np.stack([1.0 + trace, r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
    flat, entries = q.reshape(4, -1), r.reshape(3, 3, -1)
    far = np.flatnonzero(~(trace.reshape(-1) > 0))
    if far.size:
        m = entries[:, :, far]
        largest = np.argmax([m[0, 0], m[1, 1], m[2, 2]], axis=0)
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            rows = np.flatnonzero(largest == i)
            part = m[:, :, rows]
            row = np.empty((4, len(rows)), dtype=r.dtype)
            row[0] = part[k, j] - part[j, k]
            row[1 + i] = 1.0 + part[i, i] - part[j, j] - part[k, k]
            row[1 + j] = part[j, i] + part[i, j]
            row[1 + k] = part[k, i] + part[i, k]
            flat[:, far[rows]] = np.where(row[0] < 0, -row, row)
    flat /= np.sqrt(np.einsum("ij,ij->j", flat, flat))
    return q


def rotation_vectors(r: Array) -> Array:
    """The rotation vectors (3, ...), of length at most pi, of rotations of space (3, 3, ...)."""
    q = quaternions(r)
    sine = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    ratio = np.full_like(sine, 2.0)
    np.divide(2.0 * np.arctan2(sine, q[0]), sine, out=ratio, where=sine > 0)
    return np.asarray(ratio * q[1:])


def cross_matrices(w: Array) -> Array:
    """The matrices [w]x (3, 3, ...) with [w]x u = w x u, of vectors (3, ...)."""
    out = np.zeros((3, 3, *w.shape[1:]), dtype=w.dtype)
    for axis, (row, column) in enumerate(((2, 1), (0, 2), (1, 0))):
        out[row, column], out[column, row] = w[axis], -w[axis]
    return out
