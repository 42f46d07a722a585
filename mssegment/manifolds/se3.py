"""SE(3): rotations and translations of space (named in section 5.5 of the paper)."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.rotations import rotation
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import Array
from mssegment.manifolds.rotations import cross_matrices, rotation_vectors
from mssegment.manifolds.se2 import nearest_rigid, rigid_ratio, rigid_violation
from mssegment.records import Floats

SMALL_ANGLE = 0.1
"""The angle in radians below which a series replaces a quotient of small numbers."""


class SE3(MatrixGroup):
    """SE(3): the rigid motions of space, dimension 6.

    Points are 4 x 4 matrices [R t; 0 1] with R a rotation. The distance (20) weighs rotation (in
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
    >>> group = SE3()
    >>> screw = np.array([[0.0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 2], [0, 0, 0, 1]])
    >>> group.log(np.eye(4), screw).round(3).tolist()[2]
    [0.0, 0.0, 0.0, 2.0]
    """

    examples = (
        "special_euclidean(3)",
        "special_euclidean(3,exact)",
        "special_euclidean(3,exact,length_scale=2.0)",
    )
    family = "special_euclidean"
    order = 3
    free_rows = 3
    size = 4

    @property
    def dim(self) -> int:
        """The dimension, 6."""
        return 6

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm [W u; 0 0], W = [w]x with the rotation vector w.

        u = t - w x t / 2 + f w x (w x t) and f = (1 - a cot(a/2) / 2) / a^2, a = |w| <= pi.
        """
        w = rotation_vectors(m[:, :3])
        square = np.asarray(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
        f = _cotangent_factor(square)
        out = np.empty_like(m)
        out[:, :3] = cross_matrices(w)
        across = _cross(w, m[:, 3])
        out[:, 3] = m[:, 3] - 0.5 * across + f * _cross(w, across)
        return out

    def algebra_exp(self, v: Floats) -> Floats:
        """The exponential: Rodrigues' formula, and its integral applied to the translation.

        With a = |w|, the integral is I + (1 - cos a) / a^2 W + (a - sin a) / a^3 W^2.
        """
        w = np.stack([v[..., 2, 1], v[..., 0, 2], v[..., 1, 0]], axis=-1)
        square = np.sum(w * w, axis=-1)[..., None]
        u = v[..., :3, 3]
        across = np.cross(w, u)
        moved = u + _versine_factor(square) * across + _sine_factor(square) * np.cross(w, across)
        out = np.zeros(v.shape)
        out[..., :3, :3] = rotation(w)
        out[..., :3, 3] = moved
        out[..., 3, 3] = 1.0
        return out

    def generators(self) -> Floats:
        """Rotations about x, y and z by a radian, then translations along x, y and z by 1."""
        out = np.zeros((6, 4, 4))
        out[:3, :3, :3] = np.moveaxis(cross_matrices(np.eye(3)), 2, 0)
        out[3:, :3, 3] = np.eye(3)
        return out

    def divide(self, x: Floats, y: Floats) -> Floats:
        """x^-1 y by the transposed rotation."""
        return rigid_ratio(x, y)

    def onto_algebra(self, v: Array) -> Array:
        """``v`` with the antisymmetric part of its left 3 x 3 block."""
        out = np.array(v)
        out[:, :3] = 0.5 * (v[:, :3] - np.swapaxes(v[:, :3], 0, 1))
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest rotation as its 3 x 3 block, and the last row 0 0 0 1."""
        self.check_finite(x)
        return nearest_rigid(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry of R'R or of the last row; infinite for reflections."""
        return rigid_violation(x)


def _cross(w: Array, u: Array) -> Array:
    """The cross products of vectors (3, ...)."""
    return np.stack(
        [w[1] * u[2] - w[2] * u[1], w[2] * u[0] - w[0] * u[2], w[0] * u[1] - w[1] * u[0]]
    )


def _cotangent_factor(square: Array) -> Array:
    """(1 - a cot(a/2) / 2) / a^2 at ``square`` = a^2, for a <= pi."""
    series = 1 / 12 + square * (1 / 720 + square * (1 / 30240 + square / 1209600))
    with np.errstate(divide="ignore", invalid="ignore"):
        half = 0.5 * np.sqrt(square)
        exact = (1.0 - half / np.tan(half)) / square
    return np.asarray(np.where(square < SMALL_ANGLE**2, series, exact), dtype=square.dtype)


def _versine_factor(square: Floats) -> Floats:
    """(1 - cos a) / a^2 at ``square`` = a^2."""
    return np.asarray(0.5 * np.sinc(np.sqrt(square) / (2 * np.pi)) ** 2)


def _sine_factor(square: Floats) -> Floats:
    """(a - sin a) / a^3 at ``square`` = a^2."""
    series = 1 / 6 - square * (1 / 120 - square * (1 / 5040 - square / 362880))
    a = np.sqrt(square)
    small = square < SMALL_ANGLE**2
    exact = np.divide(a - np.sin(a), a * square, out=np.ones_like(a), where=~small)
    return np.where(small, series, exact)
