"""SE(3): rotations and translations of space (named in section 5.5 of the paper)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.base import Array
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.se2 import nearest_rigid, rigid_violation
from mssegment.records import Floats

SMALL_ANGLE = 0.1
"""The angle in radians below which a series replaces a quotient of small numbers."""


class SE3(MatrixGroup):
    """SE(3): the rigid motions of space, dimension 6.

    Points are 4 x 4 matrices [R t; 0 1] with R a rotation. The distance (20) weighs rotation (in
    radians, times sqrt 2) against translation (in the unit of t). Half a turn has no unique
    logarithm, so its distance is infinite.

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).

    Examples
    --------
    >>> import numpy as np
    >>> group = SE3()
    >>> screw = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]])
    >>> group.log(np.eye(4), screw).round(3).tolist()[2]
    [0.0, 0.0, 0.0, 2.0]
    """

    examples = ("special_euclidean(3)", "special_euclidean(3,exact)")
    family = "special_euclidean"
    order = 3
    free_rows = 3
    size = 4

    @property
    def dim(self) -> int:
        """The dimension, 6."""
        return 6

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm by Rodrigues' formula; NaN for half a turn, where it is not unique.

        It is [W u; 0 0] with W = (R - R') a / (2 sin a), u = (I - W/2 + f W^2) t and
        f = (1 - a cot(a/2) / 2) / a^2, a the angle of R.
        """
        r, t = m[:, :3], m[:, 3]
        twist = 0.5 * (r - np.swapaxes(r, 0, 1))
        sine = np.sqrt(_angle2(twist))
        cosine = 0.5 * (r[0, 0] + r[1, 1] + r[2, 2] - 1.0)
        a = np.arctan2(sine, cosine)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(sine < 1e-8, np.where(cosine > 0, 1.0, np.nan), a / sine)
            half = 1.0 - 0.5 * a / np.tan(0.5 * a)
            series = 1 / 12 + a**2 / 720 + a**4 / 30240 + a**6 / 1209600
            f = np.where(a < SMALL_ANGLE, series, half / (a * a))
        out = np.empty_like(m)
        w = out[:, :3]
        w[...] = ratio * twist
        wt = _apply(w, t)
        out[:, 3] = t - 0.5 * wt + f * _apply(w, wt)
        return out

    def onto_algebra(self, v: Array) -> Array:
        """``v`` with the antisymmetric part of its left 3 x 3 block."""
        out = np.array(v)
        out[:, :3] = 0.5 * (v[:, :3] - np.swapaxes(v[:, :3], 0, 1))
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest rotation as its 3 x 3 block, and the last row 0 0 0 1."""
        return nearest_rigid(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry of R'R or of the last row; infinite for reflections."""
        return rigid_violation(x)


def _angle2(w: Array) -> Array:
    """The squared angle of an antisymmetric matrix (3, 3, ...)."""
    return np.asarray(w[2, 1] ** 2 + w[0, 2] ** 2 + w[1, 0] ** 2)


def _apply(a: Array, u: Array) -> Array:
    """The products of matrices (3, 3, ...) and vectors (3, ...)."""
    return np.asarray(np.einsum("ij...,j...->i...", a, u))
