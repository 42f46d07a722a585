"""Unit vectors, or lines through the origin, prepared for mean shift with the angle as distance."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.prepared import CACHE_NUMBERS, MIN_BLOCK_ROWS, Array, Precision
from mssegment.records import Floats


class DirectionPoints:
    """n unit vectors, with the distance ``arc`` times the angle between two of them.

    The angle is that of the scalar product, and the logarithm is a / sin a (y - cos a x): all
    distances of a block are one matrix product, the sums of the logarithms a second one.

    Parameters
    ----------
    y
        The unit vectors [n, D].
    bandwidth
        h, in the distance.
    dtype
        The precision of the products.
    antipodal
        Whether y and -y are the same point.
    arc
        The distance per radian.
    """

    def __init__(
        self,
        y: Floats,
        bandwidth: float,
        dtype: Precision,
        antipodal: bool = False,
        arc: float = 1.0,
    ) -> None:
        self.points = np.ascontiguousarray(y, dtype=dtype)
        self.columns = np.ascontiguousarray(self.points.T)
        self.scale = (arc / bandwidth) ** 2
        self.antipodal = antipodal
        self.block_rows = max(MIN_BLOCK_ROWS, CACHE_NUMBERS // max(1, 2 * len(y)))

    def block(self, x: Floats) -> DirectionBlock:
        """Distances and pulls from the unit vectors ``x`` [m, D]."""
        return DirectionBlock(self, x)


class DirectionBlock:
    """Distances and pulls between m query vectors and the n points; as a ``KernelBlock``.

    Attributes
    ----------
    scaled_sq_dist
        d^2 / h^2 [m, n].
    """

    def __init__(self, prepared: DirectionPoints, x: Floats) -> None:
        self._prepared, self._x = prepared, x
        cosine = x.astype(prepared.points.dtype) @ prepared.columns
        np.clip(cosine, -1.0, 1.0, out=cosine)
        self._cosine = cosine
        self._angle = np.arccos(np.abs(cosine) if prepared.antipodal else cosine)
        self.scaled_sq_dist = self._angle * self._angle
        self.scaled_sq_dist *= prepared.scale

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        """The sums of weights times -1/2 grad angle^2, vectors [m, D], and of the weights [m]."""
        cosine = self._cosine
        sine = np.sqrt(1.0 - cosine * cosine)
        factor = np.divide(self._angle, sine, out=np.ones_like(sine), where=sine > 0)
        if not self._prepared.antipodal:
            factor[(sine == 0) & (cosine < 0)] = 0.0  # opposite: no direction is nearer
        total = weights.sum(axis=1, dtype=np.float64)
        factor *= weights
        if self._prepared.antipodal:
            factor = np.copysign(factor, cosine)
        along = np.einsum("mn,mn->m", factor, cosine).astype(np.float64)
        sums = (factor @ self._prepared.points).astype(np.float64)
        return sums - along[:, None] * self._x, total
