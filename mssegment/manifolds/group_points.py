"""Points of a matrix group, prepared for mean shift."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mssegment.manifolds.matrices import inverse, length2
from mssegment.manifolds.prepared import (
    CACHE_NUMBERS,
    Array,
    KernelBlock,
    Precision,
    PreparedPoints,
)
from mssegment.records import Floats, Integers

if TYPE_CHECKING:
    from mssegment.manifolds.matrix_group import MatrixGroup

MAX_CUTOFF = 3.0
"""For a larger cutoff (in the distance of the group) finding the pairs beyond it saves nothing."""
SLACK = 1.001
"""The factor on the cutoff that keeps rounding from leaving out pairs just within it."""
SPARE = 8
"""``nearest`` computes the distances of this many pairs more than twice as many as are wanted."""
NEGLIGIBLE = 1e-18
"""The share of the largest weight of a row below which weights do not change its sum."""
DENSE = 0.5
"""The share of pairs within the cutoff above which computing all logarithms is faster."""


class GroupPoints(PreparedPoints):
    """All a = x^-1 y of a block are one matrix product, all a^-1 another one.

    The points may be seen from an ``origin``, a group element near most of them: the distance is
    left-invariant, and nothing is lost to translations that they share. Pairs beyond the cutoff
    need no logarithm, since sinh |log a|_F >= |a - a^-1|_F / 2.
    """

    def __init__(
        self,
        group: MatrixGroup,
        y: Floats,
        bandwidth: float,
        dtype: Precision,
        cutoff: float,
        origin: Floats | None = None,
    ) -> None:
        self.origin = origin
        self.manifold, self.group, self.bandwidth = group, group, bandwidth
        self.size, self.dtype = len(y), dtype
        self.block_rows = max(1, CACHE_NUMBERS // max(1, 8 * self.size))
        self.cutoff = cutoff * bandwidth
        self.columns = self._columns(y.transpose(1, 2, 0))
        self._points = y

    @cached_property
    def inverses(self) -> Array:
        """The inverses of the points, as columns (size, free_rows n)."""
        return self._columns(inverse(self._points).transpose(2, 1, 0)[:, : self.group.free_rows])

    def _columns(self, entries: Array) -> Array:
        """Matrices (r, s, n) as one (r, s n)."""
        whole = np.ascontiguousarray(entries, dtype=self.dtype)
        return whole.reshape(len(whole), -1)

    def ratios(self, x: Floats) -> Array:
        """x^-1 y for ``x`` [m, s, s] and all points, (free_rows, m, size, n)."""
        inverses = np.moveaxis(inverse(x), 0, 1)[: self.group.free_rows].astype(self.dtype)
        ratio = inverses.reshape(-1, self.group.size) @ self.columns
        return ratio.reshape(self.group.free_rows, len(x), self.group.size, self.size)

    def sinh2(self, x: Floats, ratio: Array) -> Array:
        """The squared norms [m, n] of the hyperbolic sines of the logarithms of ``ratio``."""
        entries = x.transpose(2, 0, 1).astype(self.dtype)
        reverse = entries.reshape(-1, self.group.size) @ self.inverses
        reverse = reverse.reshape(self.group.size, len(x), self.group.free_rows, self.size)
        twice = ratio - reverse.transpose(2, 1, 0, 3)
        total: Array = np.einsum("imjn,imjn->mn", twice, twice)
        total *= 0.25
        return total

    def logs_at(self, ratio: Array, pairs: Integers) -> Array:
        """The logarithms (free_rows, size, k) of the ``pairs`` [k], flat indices into [m, n]."""
        place = pairs + pairs // self.size * ((self.group.size - 1) * self.size)
        chosen = np.empty((self.group.free_rows, self.group.size, len(pairs)), dtype=self.dtype)
        for j in range(self.group.size):
            for i, row in enumerate(ratio):
                row.ravel().take(place, out=chosen[i, j], mode="clip")
            place += self.size
        return self.group.algebra_log(chosen, self.cutoff)

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, s, s]."""
        return _GroupBlock(self, self.group.to_unit(x), self._from_origin(x))

    def _from_origin(self, x: Floats) -> Floats:
        """The queries ``x`` in the unit and from the origin of the points."""
        unit = self.group.to_unit(x)
        return unit if self.origin is None else self.group.divide(self.origin, unit)

    def nearest(self, x: Floats, count: int) -> Array:
        """As ``PreparedPoints.nearest``, with few logarithms.

        The candidates are the first pairs in the order of the lower bound of the distance; all
        pairs are computed where a further one may still be nearer.
        """
        spare = 2 * count + SPARE
        if spare >= self.size:
            return super().nearest(x, count)
        unit = self._from_origin(x)
        ratio = self.ratios(unit)
        sinh2 = self.sinh2(unit, ratio)
        order = np.argpartition(sinh2, spare, axis=1)[:, : spare + 1]
        pairs = order + np.arange(len(x))[:, None] * self.size
        z = length2(self.logs_at(ratio, pairs.ravel())).reshape(order.shape)
        z = np.sort(z, axis=1)[:, : count + 1]
        bound = np.arcsinh(np.sqrt(sinh2.ravel()[pairs[:, -1]]))
        z /= self.bandwidth**2
        unsure = np.flatnonzero(~(z[:, -1] <= (bound / self.bandwidth) ** 2))
        if unsure.size:
            z[unsure] = super().nearest(x[unsure], count)
        return z


class _GroupBlock(KernelBlock):
    def __init__(self, prepared: GroupPoints, x: Floats, centred: Floats) -> None:
        self._prepared, self._x = prepared, x
        ratio = prepared.ratios(centred)
        self._pairs = self._within_cutoff(centred, ratio)
        if self._pairs is None:
            whole = np.ascontiguousarray(np.moveaxis(ratio, 2, 1))
            self._log = prepared.group.algebra_log(whole, prepared.cutoff)
            self.scaled_sq_dist = self._squares() / prepared.bandwidth**2
        else:
            self._log = prepared.logs_at(ratio, self._pairs)
            self.scaled_sq_dist = np.full((len(x), prepared.size), np.inf, dtype=prepared.dtype)
            self.scaled_sq_dist.ravel()[self._pairs] = self._squares() / prepared.bandwidth**2

    def _within_cutoff(self, centred: Floats, ratio: Array) -> Integers | None:
        """The pairs that may be within the cutoff, or None where they are too many to save time."""
        if self._prepared.cutoff > MAX_CUTOFF:
            return None
        sinh2 = self._prepared.sinh2(centred, ratio)
        near = np.flatnonzero(sinh2 <= np.sinh(SLACK * self._prepared.cutoff) ** 2)
        return near if near.size < DENSE * sinh2.size else None

    def _squares(self) -> Array:
        """The squared norms of the logarithms; sets logarithms that do not exist to zero."""
        squares = length2(self._log)
        missing = np.isinf(squares)
        if missing.any():
            self._log[:, :, missing] = 0.0
        return squares

    def _gradients(self, weights: Array) -> Array:
        """-1/2 grad d^2 of the pairs; the exact one, which is slow, only where a weight matters."""
        group = self._prepared.group
        if not group.exact_gradient or self._pairs is not None:
            return group.gradient_from_log(self._log)
        matters = weights > NEGLIGIBLE * weights.max(axis=1, keepdims=True, initial=0.0)
        if matters.all():
            return group.gradient_from_log(self._log)
        gradients = np.zeros_like(self._log)
        gradients[:, :, matters] = group.gradient_from_log(self._log[:, :, matters])
        return gradients

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        group = self._prepared.group
        gradients = self._gradients(weights)
        if self._pairs is None:
            sums = np.einsum("mn,ijmn->ijm", weights, gradients)
        else:
            own, (m, n) = weights.ravel()[self._pairs], weights.shape
            starts = np.searchsorted(self._pairs, np.arange(0, m * n, n))
            filled = np.flatnonzero(np.diff(starts, append=len(own)))
            sums = np.zeros((*gradients.shape[:2], m))
            if filled.size:
                sums[:, :, filled] = np.add.reduceat(own * gradients, starts[filled], axis=2)
        total = weights.sum(axis=1, dtype=np.float64)
        return group.from_unit(self._x @ group.axes_last(sums)), total
