"""Symmetric positive definite matrices prepared for mean shift, with either metric."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds.base import Manifold
from mssegment.manifolds.euclidean import Euclidean
from mssegment.manifolds.prepared import CACHE_NUMBERS, Array, KernelBlock, PreparedPoints
from mssegment.manifolds.small_symmetric import (
    EntrywiseLogs,
    congruence,
    to_entries,
)
from mssegment.manifolds.symmetric import (
    around,
    eigenvalues,
    eigh,
    exp_derivative,
    square_roots,
    symmetric_function,
    transposed,
)
from mssegment.records import Floats


class AffinePoints(PreparedPoints):
    """Points with the affine-invariant metric: all x^-1/2 y x^-1/2 of a block.

    Their eigenvalues give the distances; logarithms are made only up to ``cutoff`` bandwidths.
    """

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float, cutoff: float) -> None:
        self.manifold, self.y, self.size, self.bandwidth = manifold, y, len(y), bandwidth
        self.cutoff = cutoff
        numbers = self.size * int(np.prod(manifold.point_shape))
        self.block_rows = max(1, CACHE_NUMBERS // max(1, numbers))

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, n, n]."""
        return _AffineBlock(self, x)


class SmallAffinePoints(AffinePoints):
    """The same for 2 x 2 and 3 x 3 matrices, in closed form."""

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float, cutoff: float) -> None:
        super().__init__(manifold, y, bandwidth, cutoff)
        self.entries = to_entries(y)

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, n, n]."""
        return _SmallAffineBlock(self, x)


class LogPoints(PreparedPoints):
    """Points with the log-Euclidean metric: their logarithms, in Euclidean space."""

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float, precise: bool) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        dimension = int(np.prod(manifold.point_shape))
        self.space = Euclidean(dimension).prepare(self.embed(y), bandwidth, precise)
        self.block_rows = self.space.block_rows

    def embed(self, x: Floats) -> Floats:
        """The entries of the matrix logarithms [m, n^2]."""
        return symmetric_function(np.log, np.asarray(x)).reshape(
            len(x), int(np.prod(self.manifold.point_shape))
        )

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, n, n]."""
        return _LogBlock(self, x)


class _AffineBlock(KernelBlock):
    def __init__(self, prepared: AffinePoints, x: Floats) -> None:
        self._root, inverse = square_roots(x)
        self._ratio = around(inverse[:, None], prepared.y[None])
        values = np.log(eigenvalues(self._ratio))
        self.scaled_sq_dist = np.einsum("mni,mni->mn", values, values) / prepared.bandwidth**2
        self._near = self.scaled_sq_dist <= prepared.cutoff**2

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        row, column = np.nonzero(self._near)
        values, vectors = eigh(self._ratio[row, column])
        scaled = vectors * (np.log(values) * weights[row, column, None])[:, None, :]
        logs = scaled @ transposed(vectors)
        sums = np.zeros(self._root.shape)
        starts = np.searchsorted(row, np.arange(len(weights)))
        filled = np.flatnonzero(np.diff(starts, append=len(row)))
        if filled.size:
            sums[filled] = np.add.reduceat(logs, starts[filled], axis=0)
        total = weights.sum(axis=1, dtype=np.float64)
        return self._root @ sums @ self._root, total


class _SmallAffineBlock(KernelBlock):
    def __init__(self, prepared: SmallAffinePoints, x: Floats) -> None:
        self._root, inverse = square_roots(x)
        map_ = np.moveaxis(congruence(inverse), 0, 1)
        k = len(map_)
        ratio = map_.reshape(-1, k) @ prepared.entries
        self._logs = EntrywiseLogs(ratio.reshape(k, len(x), prepared.size))
        self.scaled_sq_dist = self._logs.sq_norm / prepared.bandwidth**2

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        double = weights.astype(np.float64)
        return self._root @ self._logs.weighted_sum(double) @ self._root, double.sum(axis=1)


class _LogBlock(KernelBlock):
    def __init__(self, prepared: LogPoints, x: Floats) -> None:
        self._x = x
        self._block = prepared.space.block(prepared.embed(x))
        self.scaled_sq_dist = self._block.scaled_sq_dist

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        summed, total = self._block.weighted_sum(weights)
        return exp_derivative(self._x, summed.reshape(self._x.shape)), total
