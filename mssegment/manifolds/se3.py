"""SE(3): the rigid motions of space (named in section 5.5), by the formulas of Rodrigues."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.base import Array
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.se2 import distance_from_rotation, nearest_rotation
from mssegment.records import Floats

SMALL = 0.1
"""Angles (radians) below which a series takes the place of a quotient."""


class SE3(MatrixGroup):
    """SE(3), 4 x 4 matrices [R t; 0 1], dimension 6."""

    examples = ("special_euclidean(3)", "special_euclidean(3,exact)")
    family = "special_euclidean"
    order = 3
    rows = 3
    size = 4

    @property
    def dim(self) -> int:
        """6."""
        return 6

    def algebra_log(self, m: Array, within: float = np.inf) -> Array:
        """The principal logarithm of [R t; 0 1]; NaN for half a turn, where it is not unique.

        W = (R - R') a / (2 sin a), u = (I - W/2 + f W^2) t with f = (1 - a cot(a/2) / 2) / a^2.
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
            f = np.where(a < SMALL, series, half / (a * a))
        out = np.empty_like(m)
        w = out[:, :3]
        w[...] = ratio * twist
        turned = _apply(w, t)
        out[:, 3] = t - 0.5 * turned + f * _apply(w, turned)
        return out

    def onto_algebra(self, v: Array) -> Array:
        """The antisymmetric part of the left 3 x 3 block."""
        out = np.array(v)
        out[:, :3] = 0.5 * (v[:, :3] - np.swapaxes(v[:, :3], 0, 1))
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest rotation as its 3 x 3 block."""
        return nearest_rotation(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest entry of R'R - I and of the last row off 0 0 0 1; inf for reflections."""
        return distance_from_rotation(x)


def _angle2(w: Array) -> Array:
    return np.asarray(w[2, 1] ** 2 + w[0, 2] ** 2 + w[1, 0] ** 2)


def _apply(a: Array, u: Array) -> Array:
    return np.asarray(np.einsum("ij...,j...->i...", a, u))
