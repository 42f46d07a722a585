"""SE(2): rotations and translations of the plane (named in section 5.5 of the paper)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import Array
from mssegment.records import Floats


class SE2(MatrixGroup):
    """SE(2): the rigid motions of the plane, dimension 3, a subgroup of A(2).

    Points are 3 x 3 matrices [R t; 0 1] with R a rotation. The distance (20) weighs rotation (in
    radians, times sqrt 2) against translation (in units of ``length_scale``).

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).
    length_scale
        The length that weighs as much as one radian.

    Examples
    --------
    >>> import numpy as np
    >>> group = SE2()
    >>> turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> group.log(np.eye(3), turn).round(3).tolist()
    [[0.0, -1.571, 0.0], [1.571, 0.0, 0.0], [0.0, 0.0, 0.0]]
    """

    examples = (
        "special_euclidean(2)",
        "special_euclidean(2,exact)",
        "special_euclidean(2,exact,length_scale=0.5)",
    )
    family = "special_euclidean"
    order = 2
    free_rows = 2
    size = 3

    @property
    def dim(self) -> int:
        """The dimension, 3."""
        return 3

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm [W u; 0 0], W the angle a in (-pi, pi] times J = [0 -1; 1 0].

        u = (a/2 cot(a/2) I - a/2 J) t, which is smooth up to half a turn.
        """
        half = 0.5 * np.arctan2(m[1, 0] - m[0, 1], m[0, 0] + m[1, 1])
        cotangent = np.divide(half, np.tan(half), out=np.ones_like(half), where=half != 0)
        out = np.empty_like(m)
        out[0, 0] = out[1, 1] = np.where(np.isnan(half), np.nan, 0.0)
        out[1, 0], out[0, 1] = 2.0 * half, -2.0 * half
        out[0, 2] = cotangent * m[0, 2] + half * m[1, 2]
        out[1, 2] = cotangent * m[1, 2] - half * m[0, 2]
        return out

    def algebra_exp(self, v: Floats) -> Floats:
        """The exponential: the turn by a, and sinc(a/2) times the translation turned by a/2."""
        angle = v[..., 1, 0]
        half = 0.5 * angle
        chord = np.sinc(half / np.pi)
        out = np.zeros(v.shape)
        out[..., 0, 0] = out[..., 1, 1] = np.cos(angle)
        out[..., 1, 0], out[..., 0, 1] = np.sin(angle), -np.sin(angle)
        cosine, sine = chord * np.cos(half), chord * np.sin(half)
        out[..., 0, 2] = cosine * v[..., 0, 2] - sine * v[..., 1, 2]
        out[..., 1, 2] = sine * v[..., 0, 2] + cosine * v[..., 1, 2]
        out[..., 2, 2] = 1.0
        return out

    def generators(self) -> Floats:
        """The rotation by a radian, then translations along x and y by 1."""
        out = np.zeros((3, 3, 3))
        out[0, :2, :2] = [[0.0, -1.0], [1.0, 0.0]]
        out[1, 0, 2] = out[2, 1, 2] = 1.0
        return out

    def divide(self, x: Floats, y: Floats) -> Floats:
        """x^-1 y by the transposed rotation."""
        return rigid_ratio(x, y)

    def onto_algebra(self, v: Array) -> Array:
        """``v`` with the antisymmetric part of its left 2 x 2 block."""
        out = np.array(v)
        out[0, 1] = 0.5 * (v[0, 1] - v[1, 0])
        out[1, 0] = -out[0, 1]
        out[0, 0] = out[1, 1] = np.where(np.isnan(v[0, 0]), np.nan, 0.0)
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest rotation as its 2 x 2 block, and the last row 0 0 1."""
        self.check_finite(x)
        return nearest_rigid(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry of R'R or of the last row; infinite for reflections."""
        return rigid_violation(x)


def rigid_ratio(x: Floats, y: Floats) -> Floats:
    """x^-1 y for rigid motions ``x`` and matrices ``y`` with the last row 0 .. 0 c.

    The translation is R'(t_y - c t_x): where both are large and near each other, nothing is lost.

    Parameters
    ----------
    x, y
        Matrices of any size [..., s, s].

    Returns
    -------
    array
        The products [..., s, s].
    """
    shape = np.broadcast_shapes(x.shape, y.shape)
    size = shape[-1] - 1
    difference = np.array(np.broadcast_to(y, shape))
    difference[..., :size, size] -= x[..., :size, size] * y[..., size, size, None]
    difference[..., :size, :] = (
        np.swapaxes(x[..., :size, :size], -1, -2) @ difference[..., :size, :]
    )
    return difference


def nearest_rigid(x: Floats) -> Floats:
    """The rigid motion nearest to a matrix, in the Frobenius norm.

    Parameters
    ----------
    x
        Matrices [A b; c d] of any size [..., s, s].

    Returns
    -------
    array
        The matrices [R b; 0 1], R the rotation nearest to A.
    """
    size = x.shape[-1] - 1
    u, _, v = np.linalg.svd(x[..., :size, :size])
    determinant = np.linalg.det(u @ v)
    u[..., :, -1] *= np.where(determinant < 0, -1.0, 1.0)[..., None]
    out = np.zeros(x.shape)
    out[..., :size, :size] = u @ v
    out[..., :size, size] = x[..., :size, size]
    out[..., size, size] = 1.0
    return out


def rigid_violation(x: Floats) -> Floats:
    """How far matrices are from rigid motions [R t; 0 1].

    Parameters
    ----------
    x
        Matrices of any size [..., s, s].

    Returns
    -------
    array
        The largest entry of |R'R - I| and |last row - (0 .. 0 1)| [...]; infinite where det R <= 0.
    """
    size = x.shape[-1] - 1
    r = x[..., :size, :size]
    rotation = np.max(np.abs(np.swapaxes(r, -1, -2) @ r - np.eye(size)), axis=(-2, -1))
    last = np.max(np.abs(x[..., size, :] - np.eye(size + 1)[size]), axis=-1)
    return np.where(np.linalg.det(r) > 0, np.maximum(rotation, last), np.inf)
