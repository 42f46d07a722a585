"""Sim(2): rotations, translations and uniform scalings of the plane."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import Array
from mssegment.records import Floats


class Sim2(MatrixGroup):
    """Sim(2): the similarities of the plane, dimension 4, a subgroup of A(2).

    Points are 3 x 3 matrices [s R t; 0 1] with a scale s > 0 and a rotation R. The distance (20)
    weighs rotation (in radians) and the logarithm of s, both times sqrt 2, against translation (in
    units of ``length_scale``).

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).
    length_scale
        The length that weighs as much as one radian.

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
        """The logarithm by complex numbers: ln z for z = s e^(ia), and t ln z / (z - 1)."""
        real, imaginary = 0.5 * (m[0, 0] + m[1, 1]), 0.5 * (m[1, 0] - m[0, 1])
        excess = real - 1.0
        square = excess * excess + imaginary * imaginary
        with np.errstate(divide="ignore", invalid="ignore"):
            # |z|^2 - 1 = |z - 1|^2 + 2 Re(z - 1), without cancellation for z near 1
            near = 0.5 * np.log1p(2.0 * excess + square)
            size = np.where(square < 0.25, near, np.log(np.hypot(real, imaginary)))
        size = np.where(np.isinf(size), np.nan, size)
        angle = np.arctan2(imaginary, real)
        apart = square >= np.finfo(square.dtype).tiny  # the inverse of a smaller one overflows
        over = np.divide(1.0, square, out=np.zeros_like(square), where=apart)
        p = np.where(apart, (size * excess + angle * imaginary) * over, 1.0)
        q = (angle * excess - size * imaginary) * over
        out = np.empty_like(m)
        out[0, 0] = out[1, 1] = size
        out[1, 0], out[0, 1] = angle, -angle
        out[0, 2] = p * m[0, 2] - q * m[1, 2]
        out[1, 2] = q * m[0, 2] + p * m[1, 2]
        return out

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
        self.check_finite(x)
        self._refuse((out[..., :2, :2] == 0).all(axis=(-2, -1)), "its scale is 0")
        return out

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry that the others determine, in the 2 x 2 block relative to
        its largest one; infinite for reflections and where the scale is 0.
        """
        a = x[..., :2, :2]
        largest = np.abs(a).max(axis=(-2, -1), initial=0.0)
        conformal = np.maximum(
            np.abs(a[..., 0, 0] - a[..., 1, 1]), np.abs(a[..., 0, 1] + a[..., 1, 0])
        ) / np.where(largest > 0, largest, 1.0)
        last = np.max(np.abs(x[..., 2, :] - np.array([0.0, 0.0, 1.0])), axis=-1)
        proper = (largest > 0) & (conformal < 1.0)
        return np.where(proper, np.maximum(conformal, last), np.inf)
