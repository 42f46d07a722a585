"""To which precision parameters and scales are stated, and what a scale costs."""

from __future__ import annotations

import math

PRECISION_GAIN = 0.5 * math.log(12.0) - 0.5
"""Nats that the optimal precision of a parameter saves (Wallace and Freeman, 1987)."""
MIN_LENGTH = 1e-12
"""Smallest length in pixels, so that the logarithm for coincident tracks is finite."""


def log_precision(scale: float, count: int) -> float:
    """Log of the precision in pixels to which ``count`` tracks determine a parameter."""
    return math.log(scale) - 0.5 * math.log(count) + PRECISION_GAIN


def scale_cost(
    bounds: tuple[float, float], dimension: int, count: int, degrees_of_freedom: float
) -> float:
    """Nats to code the scale of the residuals of ``count`` tracks within ``bounds``.

    Each order of magnitude is as likely as any other. Residuals have this dimension and follow a
    Student t distribution.
    """
    precision = PRECISION_GAIN - 0.5 * math.log(information(dimension, degrees_of_freedom) * count)
    orders = math.log(bounds[1] / bounds[0])
    return max(math.log(max(orders, MIN_LENGTH)) - precision, 0.0)


def information(dimension: int, degrees_of_freedom: float) -> float:
    """Fisher information of a residual about the logarithm of its scale."""
    nu, c = degrees_of_freedom, dimension
    return 2.0 * c if math.isinf(nu) else 2.0 * c * nu / (nu + c + 2.0)
