"""The few special functions of single numbers that are needed, without loading ``scipy.special``.

Importing that takes as long as a tenth of the whole segmentation of two pictures.
"""

from __future__ import annotations

import math

TERMS, ROUNDING = 1000, 1e-16
SHIFT = 10.0
"""Above this the asymptotic series of the trigamma function has reached double precision."""


def trigamma(x: float) -> float:
    """psi'(x), x > 0, by its recurrence and its asymptotic series (Abramowitz, Stegun 6.4.12)."""
    total = 0.0
    while x < SHIFT:
        total += 1.0 / (x * x)
        x += 1.0
    z = 1.0 / (x * x)
    series = 1 / 6 - z * (1 / 30 - z * (1 / 42 - z * (1 / 30 - z * (5 / 66 - z * 691 / 2730))))
    return total + 1.0 / x + 0.5 * z + z / x * series


def gamma_share(a: float, x: float) -> float:
    """The regularised lower incomplete gamma function P(a, x), a > 0, x >= 0.

    Its power series, or 1 minus Legendre's continued fraction (Abramowitz, Stegun 6.5.29, 6.5.31).
    """
    if x <= 0:
        return 0.0
    scale = math.exp(a * math.log(x) - x - math.lgamma(a))
    if x < a + 1.0:
        term = total = 1.0 / a
        for i in range(1, TERMS):
            term *= x / (a + i)
            total += term
            if term < ROUNDING * total:
                break
        return scale * total
    b = x + 1.0 - a
    numerator, denominator = 1e300, 1.0 / b
    fraction = denominator
    for i in range(1, TERMS):
        factor = -i * (i - a)
        b += 2.0
        denominator = 1.0 / (factor * denominator + b)
        numerator = b + factor / numerator
        fraction *= denominator * numerator
        if abs(denominator * numerator - 1.0) < ROUNDING:
            break
    return 1.0 - scale * fraction


def gamma_quantile(a: float, share: float) -> float:
    """The x with P(a, x) = ``share``, 0 < share < 1: half the chi-square quantile with 2 a freedom.

    By Newton's iteration inside a bracket that every step narrows.
    """
    low, high = 0.0, a + 1.0
    while gamma_share(a, high) < share:
        low, high = high, 2.0 * high
    x = 0.5 * (low + high)
    for _ in range(200):
        miss = gamma_share(a, x) - share
        low, high = (x, high) if miss < 0 else (low, x)
        slope = math.exp((a - 1.0) * math.log(x) - x - math.lgamma(a))
        new = x - miss / slope if slope > 0 else low
        new = new if low < new < high else 0.5 * (low + high)
        if abs(new - x) <= 4e-16 * x:
            return new
        x = new
    return x
