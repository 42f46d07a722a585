"""Points of a Grassmann manifold prepared for mean shift, as orthogonal projectors.

The chordal distance (12) of subspaces is that of their projectors, so that all distances are one
matrix product.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from mssegment.manifolds.base import Manifold
from mssegment.manifolds.prepared import (
    CACHE_NUMBERS,
    MIN_BLOCK_ROWS,
    Array,
    KernelBlock,
    Precision,
    PreparedPoints,
)
from mssegment.records import Floats, Integers

EMBED_ROWS = 4096
"""Points that are embedded at a time, to bound the memory."""


@lru_cache(maxsize=16)
def _triangle(n: int) -> tuple[Integers, Integers, Integers]:
    """Indices for symmetric n x n matrices.

    The upper triangle in the flat matrix, the diagonal in the triangle, and the entries of the flat
    matrix in the triangle.
    """
    above = np.triu_indices(n)
    place = np.empty((n, n), dtype=np.intp)
    place[above] = place[above[::-1]] = np.arange(len(above[0]))
    return above[0] * n + above[1], np.diag(place), place.ravel()


class ProjectorPoints(PreparedPoints):
    """Every point as the upper triangle of yy'.

    tr(x'yy'x) is a dot product of two triangles, entries off the diagonal counted twice: all
    distances of a block are one matrix product, and the sums of (14) are a second one. The first
    one includes the bandwidth and the k of (12), which is the trace.
    """

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float, dtype: Precision) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        self.block_rows = max(MIN_BLOCK_ROWS, CACHE_NUMBERS // max(1, self.size))
        self.dtype = dtype
        self.n, self.k = manifold.point_shape
        self.upper, diagonal, self.place = _triangle(self.n)
        self.projectors = self.embed(y)
        columns = np.multiply(self.projectors.T, -2.0 / bandwidth**2, order="C")
        columns[diagonal] = 0.5 * columns[diagonal] + 1.0 / bandwidth**2
        self.columns = columns

    def embed(self, x: Floats) -> Array:
        """The upper triangle of xx', [m, N (N + 1) / 2]."""
        if len(x) <= EMBED_ROWS:
            return self._embed_block(x)
        out = np.empty((len(x), len(self.upper)), dtype=self.dtype)
        for start in range(0, len(x), EMBED_ROWS):
            out[start : start + EMBED_ROWS] = self._embed_block(x[start : start + EMBED_ROWS])
        return out

    def _embed_block(self, x: Floats) -> Array:
        # the copy of the transpose makes NumPy call gemm: syrk is slower for small matrices
        x = x.astype(self.dtype, copy=False)
        square = (x @ np.swapaxes(x, -1, -2).copy()).reshape(len(x), self.n**2)
        embedded: Array = square.take(self.upper, axis=1)
        return embedded

    def unfold(self, flat: Array) -> Floats:
        """The symmetric matrices [m, N, N] whose embedding ``flat`` is."""
        square = flat.astype(np.float64).take(self.place, axis=1)
        return square.reshape(len(flat), self.n, self.n)

    def block(self, x: Floats) -> KernelBlock:
        """All distances from ``x`` [m, N, k]."""
        return _ProjectorBlock(self, x)


class _ProjectorBlock(KernelBlock):
    def __init__(self, prepared: ProjectorPoints, x: Floats) -> None:
        self._prepared, self._x = prepared, x
        self.scaled_sq_dist = prepared.embed(x) @ prepared.columns

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        prepared = self._prepared
        sums = prepared.unfold(weights.astype(prepared.dtype, copy=False) @ prepared.projectors)
        total = np.einsum("mii->m", sums) / prepared.k  # tr yy' = k
        return normal_part(self._x, sums @ self._x), total


def normal_part(x: Floats, v: Floats) -> Floats:
    """(I - xx') v, the part of ``v`` orthogonal to the subspace ``x``."""
    return np.asarray(v - x @ (np.swapaxes(x, -1, -2) @ v))
