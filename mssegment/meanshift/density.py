"""Kernel sums over points that have weights or bandwidths of their own."""

from __future__ import annotations

import numpy as np

from mssegment.manifolds import Array
from mssegment.records import Floats, Record


class PointWeights(Record, frozen=True):
    """What each of the n data points contributes to the density, beyond a common bandwidth h.

    With bandwidths h_i and weights w_i the density is the sum of w_i (h / h_i)^dim k(d^2 / h_i^2),
    over the sum of the w_i, up to a constant (Comaniciu, Ramesh and Meer, "The variable bandwidth
    mean shift and data-driven scale selection", ICCV 2001).

    Attributes
    ----------
    scale
        (h / h_i)^2 [n], by which d^2 / h^2 is multiplied.
    profile
        Factors of k [n].
    gradient
        Factors of g [n].
    total
        The sum of the w_i.
    """

    scale: Floats
    profile: Floats
    gradient: Floats
    total: float

    @classmethod
    def build(
        cls, weights: Floats, bandwidths: Floats, bandwidth: float, dimension: int
    ) -> PointWeights:
        """From weights [n], bandwidths [n], the common ``bandwidth`` and the manifold's dimension.

        The factors are brought to at most the largest weight, so that dimensions do not overflow.
        """
        ratio = np.log(bandwidth / bandwidths)
        profile = weights * np.exp(dimension * (ratio - ratio.max(initial=-np.inf)))
        scale = np.exp(2.0 * ratio)
        gradient = profile * np.exp(2.0 * (ratio - ratio.max(initial=-np.inf)))
        return cls(scale, profile, gradient, float(weights.sum()))

    def scaled(self, z: Array) -> Array:
        """``z`` [m, n] in the bandwidth of each point, in place."""
        z *= self.scale.astype(z.dtype)
        return z
