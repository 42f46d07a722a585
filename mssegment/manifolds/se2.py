"""SE(2): the rigid motions of the plane, rotation and translation (named in section 5.5)."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.affine import AffineGroup
from mssegment.manifolds.base import Array
from mssegment.records import Floats


class SE2(AffineGroup):
    """SE(2), 3 x 3 matrices [R t; 0 1], dimension 3: a subgroup of A(2)."""

    examples = ("special_euclidean(2)", "special_euclidean(2,exact)")
    family = "special_euclidean"
    order = 2

    @property
    def dim(self) -> int:
        """3."""
        return 3

    def algebra_log(self, m: Array, within: float = np.inf) -> Array:
        """The logarithm of A(2); NaN for half a turn, where it is not unique."""
        return self.onto_algebra(super().algebra_log(m))

    def onto_algebra(self, v: Array) -> Array:
        """The antisymmetric part of the left 2 x 2 block."""
        out = np.array(v)
        out[0, 1] = 0.5 * (v[0, 1] - v[1, 0])
        out[1, 0] = -out[0, 1]
        out[0, 0] = out[1, 1] = np.where(np.isnan(v[0, 0]), np.nan, 0.0)
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` with the nearest rotation as its 2 x 2 block."""
        return nearest_rotation(x)

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest entry of R'R - I and of the last row less 0 0 1; infinite for reflections."""
        return distance_from_rotation(x)


def nearest_rotation(x: Floats) -> Floats:
    """Matrices [A b; c d] as [R b; 0 1], R the rotation nearest to A."""
    size = x.shape[-1] - 1
    u, _, v = np.linalg.svd(x[..., :size, :size])
    turn = np.linalg.det(u @ v)
    u[..., :, -1] *= np.where(turn < 0, -1.0, 1.0)[..., None]
    out = np.zeros(x.shape)
    out[..., :size, :size] = u @ v
    out[..., :size, size] = x[..., :size, size]
    out[..., size, size] = 1.0
    return out


def distance_from_rotation(x: Floats) -> Floats:
    """The largest entry of |R'R - I| and |last row - (0 .. 0 1)|; infinite where det R <= 0."""
    size = x.shape[-1] - 1
    r = x[..., :size, :size]
    off = np.max(np.abs(np.swapaxes(r, -1, -2) @ r - np.eye(size)), axis=(-2, -1))
    last = np.max(np.abs(x[..., size, :] - np.eye(size + 1)[size]), axis=-1)
    return np.where(np.linalg.det(r) > 0, np.maximum(off, last), np.inf)
