"""SE(2): rotations and translations of the plane (named in section 5.5 of the paper)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.affine import affine_logarithm
from mssegment.manifolds.base import Array
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.records import Floats


class SE2(MatrixGroup):
    """SE(2): the rigid motions of the plane, dimension 3, a subgroup of A(2).

    Points are 3 x 3 matrices [R t; 0 1] with R a rotation. The distance (20) weighs rotation (in
    radians, times sqrt 2) against translation (in the unit of t). Half a turn has no unique
    logarithm, so its distance is infinite.

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).

    Examples
    --------
    >>> import numpy as np
    >>> group = SE2()
    >>> turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> group.log(np.eye(3), turn).round(3).tolist()
    [[0.0, -1.571, 0.0], [1.571, 0.0, 0.0], [0.0, 0.0, 0.0]]
    """

    examples = ("special_euclidean(2)", "special_euclidean(2,exact)")
    family = "special_euclidean"
    order = 2
    free_rows = 2
    size = 3

    @property
    def dim(self) -> int:
        """The dimension, 3."""
        return 3

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm, as in A(2); NaN for half a turn, where it is not unique."""
        return self.onto_algebra(affine_logarithm(m))

    def onto_algebra(self, v: Array) -> Array:
        """``v`` with the antisymmetric part of its left 2 x 2 block."""
        out = np.array(v)
        out[0, 1] = 0.5 * (v[0, 1] - v[1, 0])
        out[1, 0] = -out[0, 1]
        out[0, 0] = out[1, 1] = np.where(np.isnan(v[0, 0]), np.nan, 0.0)
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest rotation as its 2 x 2 block, and the last row 0 0 1."""
        return nearest_rigid(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry of R'R or of the last row; infinite for reflections."""
        return rigid_violation(x)


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
