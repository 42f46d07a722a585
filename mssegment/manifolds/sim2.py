"""Sim(2): rotations, translations and uniform scalings of the plane."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.affine import affine_logarithm
from mssegment.manifolds.base import Array
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.records import Floats


class Sim2(MatrixGroup):
    """Sim(2): the similarities of the plane, dimension 4, a subgroup of A(2).

    Points are 3 x 3 matrices [s R t; 0 1] with a scale s > 0 and a rotation R. The distance (20)
    weighs rotation (in radians) and the logarithm of s, both times sqrt 2, against translation (in
    the unit of t). Half a turn has no unique logarithm, so its distance is infinite.

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).

    Examples
    --------
    >>> import numpy as np
    >>> group = Sim2()
    >>> double = np.diag([2.0, 2.0, 1.0])
    >>> group.log(np.eye(3), double).round(3).tolist()
    [[0.693, 0.0, 0.0], [0.0, 0.693, 0.0], [0.0, 0.0, 0.0]]
    """

    examples = ("similarity(2)", "similarity(2,exact)")
    family = "similarity"
    order = 2
    free_rows = 2
    size = 3

    @property
    def dim(self) -> int:
        """The dimension, 4."""
        return 4

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm, as in A(2); NaN for half a turn, where it is not unique."""
        return self.onto_algebra(affine_logarithm(m))

    def onto_algebra(self, v: Array) -> Array:
        """``v`` with the conformal part of its left 2 x 2 block."""
        out = np.array(v)
        out[0, 0] = out[1, 1] = 0.5 * (v[0, 0] + v[1, 1])
        out[1, 0] = 0.5 * (v[1, 0] - v[0, 1])
        out[0, 1] = -out[1, 0]
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest conformal matrix as its 2 x 2 block, and the last row 0 0 1."""
        out = np.zeros(x.shape)
        out[..., 0, 0] = out[..., 1, 1] = 0.5 * (x[..., 0, 0] + x[..., 1, 1])
        out[..., 1, 0] = 0.5 * (x[..., 1, 0] - x[..., 0, 1])
        out[..., 0, 1] = -out[..., 1, 0]
        out[..., :2, 2] = x[..., :2, 2]
        out[..., 2, 2] = 1.0
        return out

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry that the others determine; infinite for reflections."""
        conformal = np.maximum(
            np.abs(x[..., 0, 0] - x[..., 1, 1]), np.abs(x[..., 0, 1] + x[..., 1, 0])
        )
        last = np.max(np.abs(x[..., 2, :] - np.array([0.0, 0.0, 1.0])), axis=-1)
        determinant = x[..., 0, 0] * x[..., 1, 1] - x[..., 0, 1] * x[..., 1, 0]
        return np.where(determinant > 0, np.maximum(conformal, last), np.inf)
