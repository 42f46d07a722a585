"""Kernel profiles k(z) of the density estimate (7) and the weights g = -k' of mean shift (9)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds import Array
from mssegment.registry import KERNELS


class Kernel(ABC):
    """A kernel profile k(z) of z = d^2 / h^2, with k(0) = 1.

    Attributes
    ----------
    name
        The name in ``registry.KERNELS``.
    """

    name: ClassVar[str]
    compact: ClassVar[bool] = False
    """The profile ends at a finite distance, where its slope may jump: the density has flat regions
    and many modes near each other, and only plain steps are taken."""

    def cutoff(self, precise: bool) -> float:
        """The distance, in bandwidths, beyond which points may be left out.

        Parameters
        ----------
        precise
            Whether the result is needed in double precision.
        """
        return np.inf

    @abstractmethod
    def profile(self, z: Array) -> Array:
        """The profile k(z), of the shape of ``z``."""

    @abstractmethod
    def weights(self, z: Array) -> tuple[Array, Array | None]:
        """The weights g(z) of the mean shift, and the sums of the profile.

        Parameters
        ----------
        z
            Scaled squared distances [m, n]; they may be overwritten.

        Returns
        -------
        weights
            g(z) [m, n], up to a constant factor.
        profile_sums
            The row sums of k(z) [m]; None where they are those of the weights.
        """


class Gaussian(Kernel):
    """k(z) = exp(-z / 2), that is exp(-d^2 / 2 h^2): the kernel of the paper.

    Examples
    --------
    >>> import numpy as np
    >>> Gaussian().profile(np.array([0.0, 1.0, 4.0])).round(3).tolist()
    [1.0, 0.607, 0.135]
    """

    name = "gaussian"

    def cutoff(self, precise: bool) -> float:
        """The radius where the weight is 1e-16; 3e-7 unless ``precise``."""
        return 8.5 if precise else 5.5

    def profile(self, z: Array) -> Array:
        """The profile exp(-z / 2)."""
        return np.asarray(np.exp(-0.5 * z))

    def weights(self, z: Array) -> tuple[Array, Array | None]:
        """The weights exp(-z / 2): k and g are equal up to the factor 2."""
        z *= -0.5
        return np.exp(z, out=z), None


class TruncatedGaussian(Kernel):
    """The Gaussian profile, shifted and scaled so that it ends at 0 at d = 3 h.

    Examples
    --------
    >>> import numpy as np
    >>> TruncatedGaussian().profile(np.array([0.0, 1.0, 9.0])).round(3).tolist()
    [1.0, 0.602, 0.0]
    """

    name = "truncated"
    compact = True
    radius: ClassVar[float] = 3.0
    """Where the profile ends, in bandwidths."""

    def cutoff(self, precise: bool) -> float:
        """3, the radius of the support."""
        return self.radius

    def profile(self, z: Array) -> Array:
        """The profile (exp(-z / 2) - e) / (1 - e), e = exp(-9 / 2); 0 beyond 3 h."""
        last = float(np.exp(-0.5 * self.radius**2))
        return np.asarray(np.maximum(np.exp(-0.5 * z) - last, 0) / (1 - last))

    def weights(self, z: Array) -> tuple[Array, Array | None]:
        """The Gaussian weights within 3 h, 0 beyond."""
        inside = z < self.radius**2
        weights = np.exp(-0.5 * z) * inside
        last = float(np.exp(-0.5 * self.radius**2))
        profile = (weights.sum(axis=1) - last * inside.sum(axis=1)) / (1 - last)
        return weights, profile


class Epanechnikov(Kernel):
    """k(z) = max(0, 1 - z). Its weights are uniform: a mean shift step is a local mean.

    Examples
    --------
    >>> import numpy as np
    >>> Epanechnikov().profile(np.array([0.0, 0.25, 4.0])).tolist()
    [1.0, 0.75, 0.0]
    """

    name = "epanechnikov"
    compact = True

    def cutoff(self, precise: bool) -> float:
        """1, the radius of the support."""
        return 1.0

    def profile(self, z: Array) -> Array:
        """The profile max(0, 1 - z)."""
        return np.asarray(np.maximum(1.0 - z, 0))

    def weights(self, z: Array) -> tuple[Array, Array | None]:
        """1 within the bandwidth, 0 beyond."""
        return (z < 1).astype(z.dtype), self.profile(z).sum(axis=1)


GAUSSIAN, TRUNCATED, EPANECHNIKOV = Gaussian(), TruncatedGaussian(), Epanechnikov()


def kernel_named(name: str) -> Kernel:
    """The kernel with this name.

    Raises
    ------
    ConfigurationError
        Where there is none.

    Examples
    --------
    >>> kernel_named("epanechnikov").cutoff(precise=True)
    1.0
    """
    if name not in KERNELS:
        known = ", ".join(KERNELS)
        raise ConfigurationError(f"no kernel is called {name!r}: use one of {known}")
    kernel: Kernel = KERNELS[name]
    return kernel
