"""Data points prepared for mean shift: distances and gradients from blocks of trajectories."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats

if TYPE_CHECKING:
    from mssegment.manifolds.base import Manifold

Array = npt.NDArray[np.floating[Any]]
"""Floating point numbers of either precision."""

Precision = np.dtype[np.floating[Any]]

CACHE_NUMBERS = 1 << 18
"""Numbers of an intermediate array that fits the cache of a core (1 MB in single precision)."""


MIN_BLOCK_ROWS = 8
"""Rows of a block below which a matrix product is no faster than one row at a time."""


class KernelBlock(ABC):
    """Distances and gradients between m query points and the n prepared points.

    Attributes
    ----------
    scaled_sq_dist
        d^2 / h^2 [m, n], the argument z of the kernel profile k(z) in (7); infinite where there is
        no logarithm. The caller may overwrite it.
    """

    scaled_sq_dist: Array

    @abstractmethod
    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        """Numerator and denominator of the mean shift vector (9).

        Parameters
        ----------
        weights
            The weights g(d^2 / h^2) [m, n].

        Returns
        -------
        summed
            The sums over the n points of the weights times -1/2 grad d^2, tangents [m, ...].
        total
            The sums of the weights [m].
        """


class PreparedPoints(ABC):
    """n fixed points of a manifold, prepared for many queries.

    Attributes
    ----------
    manifold
        The manifold.
    size
        The number n of points.
    bandwidth
        h, by which distances are divided.
    block_rows
        The number of query points per block with which the work stays in the cache.
    """

    manifold: Manifold
    size: int
    bandwidth: float
    block_rows: int

    @abstractmethod
    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from the query points ``x`` [m, ...]."""

    def nearest(self, x: Floats, count: int) -> Array:
        """Scaled squared distances of the ``count`` + 1 points nearest to each of ``x`` [m, ...].

        Returns [m, count + 1]: the largest last, the others in no particular order.
        """
        z = self.block(x).scaled_sq_dist
        z.partition(count, axis=1)
        return z[:, : count + 1]


class LogPreparedPoints(PreparedPoints):
    """The default, made from the manifold's ``dist`` and ``neg_half_grad_sq_dist``.

    Parameters
    ----------
    manifold
        The manifold.
    y
        The points [n, ...].
    bandwidth
        h.
    """

    def __init__(self, manifold: Manifold, y: Floats, bandwidth: float) -> None:
        self.manifold, self.y, self.bandwidth = manifold, y, bandwidth
        self.size = len(y)
        numbers = max(1, self.size * int(np.prod(manifold.point_shape)))
        self.block_rows = max(1, CACHE_NUMBERS // numbers)

    def block(self, x: Floats) -> KernelBlock:
        """Distances and gradients from ``x`` [m, ...], pair by pair."""
        return _LogBlock(self, x)


class _LogBlock(KernelBlock):
    def __init__(self, prepared: LogPreparedPoints, x: Floats) -> None:
        self._manifold, self._at, self._to = prepared.manifold, x[:, None], prepared.y[None]
        self._gradients: Floats | None = None
        if prepared.manifold.dist_is_geodesic:
            log = prepared.manifold.log(self._at, self._to)
            length = prepared.manifold.norm(self._at, log)
            self._gradients = np.nan_to_num(log, nan=0.0)
            dist = np.where(np.isnan(length), np.inf, length)
        else:
            dist = prepared.manifold.dist(self._at, self._to)
        self.scaled_sq_dist = (dist / prepared.bandwidth) ** 2

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        if self._gradients is None:
            self._gradients = self._manifold.neg_half_grad_sq_dist(self._at, self._to)
        double = weights.astype(np.float64)
        return np.einsum("mn,mn...->m...", double, self._gradients), double.sum(axis=1)


def precision(precise: bool, magnitude: float, bandwidth: float) -> Precision | None:
    """The precision in which to compute d^2 / h^2 as a difference of larger terms.

    Parameters
    ----------
    precise
        Whether single precision is not allowed.
    magnitude
        The size of the terms.
    bandwidth
        h.

    Returns
    -------
    dtype or None
        Single precision if it is allowed and d^2 / h^2 is good to about 0.01; else double if it is
        good to about 1e-6; None where cancellation leaves less than that.
    """
    if not precise and magnitude * _EPS32 < MAX_ERROR_SINGLE * bandwidth**2:
        return np.dtype(np.float32)
    return np.dtype(np.float64) if magnitude * _EPS64 < MAX_ERROR * bandwidth**2 else None


MAX_ERROR_SINGLE, MAX_ERROR = 1e-2, 1e-6
"""The largest error of d^2 / h^2 from cancellation: where single precision is allowed the path of a
trajectory may be that inexact, since modes are refined in double precision."""
_EPS32, _EPS64 = float(np.finfo(np.float32).eps), float(np.finfo(np.float64).eps)
