"""Kernel profiles k(z) of the density estimate (7) and the weights g = -k' of the shift (9)."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds import Array


class Kernel(ABC):
    """A profile k(z), z = d^2 / h^2, with k(0) = 1."""

    name: str

    def reach(self, precise: bool) -> float:
        """Beyond so many bandwidths a point has no weight (or none that matters)."""
        return np.inf

    @abstractmethod
    def profile(self, z: Array) -> Array:
        """k(z)."""

    @abstractmethod
    def weigh(self, z: Array) -> tuple[Array, Array | None]:
        """The weights g(z) [m, n], up to a constant factor, and the row sums of k(z) [m].

        None instead of the sums where they are those of the weights. ``z`` may be overwritten.
        """


class Gaussian(Kernel):
    """k(z) = exp(-z / 2), that is exp(-d^2 / 2 h^2): the kernel of the paper."""

    name = "gaussian"

    def reach(self, precise: bool) -> float:
        """Weights below 1e-15 are nothing, and below 1e-6 move no trajectory to another mode."""
        return 8.5 if precise else 5.5

    def profile(self, z: Array) -> Array:
        """exp(-z / 2)."""
        return np.asarray(np.exp(-0.5 * z))

    def weigh(self, z: Array) -> tuple[Array, Array | None]:
        """k and g are the same up to the factor 2."""
        z *= -0.5
        return np.exp(z, out=z), None


class TruncatedGaussian(Kernel):
    """The Gaussian profile lowered to reach 0 at d = 3 h, where it ends."""

    name = "truncated"
    edge = 3.0

    def reach(self, precise: bool) -> float:
        """3."""
        return self.edge

    def profile(self, z: Array) -> Array:
        """(exp(-z / 2) - e) / (1 - e), e = exp(-9 / 2); 0 beyond 3 h."""
        at_edge = float(np.exp(-0.5 * self.edge**2))
        return np.asarray(np.maximum(np.exp(-0.5 * z) - at_edge, 0) / (1 - at_edge))

    def weigh(self, z: Array) -> tuple[Array, Array | None]:
        """g is the Gaussian inside the edge, 0 outside."""
        inside = z < self.edge**2
        weights = np.exp(-0.5 * z) * inside
        at_edge = float(np.exp(-0.5 * self.edge**2))
        profile = (weights.sum(axis=1) - at_edge * inside.sum(axis=1)) / (1 - at_edge)
        return weights, profile


class Epanechnikov(Kernel):
    """k(z) = max(0, 1 - z): g is 1 within the bandwidth, so the shift is a plain local mean."""

    name = "epanechnikov"

    def reach(self, precise: bool) -> float:
        """1."""
        return 1.0

    def profile(self, z: Array) -> Array:
        """max(0, 1 - z)."""
        return np.asarray(np.maximum(1.0 - z, 0))

    def weigh(self, z: Array) -> tuple[Array, Array | None]:
        """g is 1 inside the bandwidth, 0 outside."""
        return (z < 1).astype(z.dtype), self.profile(z).sum(axis=1)


KERNELS: dict[str, Kernel] = {k.name: k for k in (Gaussian(), TruncatedGaussian(), Epanechnikov())}
"""The kernels by name."""


def kernel_named(name: str) -> Kernel:
    """The kernel called ``name``; raises ConfigurationError where there is none."""
    if name not in KERNELS:
        known = ", ".join(KERNELS)
        raise ConfigurationError(f"no kernel is called {name!r}: use one of {known}")
    return KERNELS[name]
