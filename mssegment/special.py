"""The few special functions of single numbers that are needed, without loading ``scipy.special``.

Importing that takes as long as a tenth of the whole segmentation of two pictures.
"""

from __future__ import annotations

import math
from statistics import NormalDist


def chi_square_quantile(freedom: int, share: float) -> float:
    """What the sum of ``freedom`` squared standard normal numbers stays below with this chance.

    Exact for one and two degrees of freedom, else to a few per cent in the tail (Wilson and
    Hilferty, 1931).
    """
    if freedom == 1:
        return NormalDist().inv_cdf((1.0 + share) / 2.0) ** 2
    if freedom == 2:
        return -2.0 * math.log1p(-share)
    spread = 2.0 / (9.0 * freedom)
    root = 1.0 - spread + NormalDist().inv_cdf(share) * math.sqrt(spread)
    return float(freedom * root**3)


def trigamma_of_half(freedom: int) -> float:
    """The trigamma function of ``freedom`` / 2, by its recurrence from 1/2 or 1."""
    x, value = (0.5, math.pi**2 / 2.0) if freedom % 2 else (1.0, math.pi**2 / 6.0)
    while x < freedom / 2.0:
        value -= 1.0 / (x * x)
        x += 1.0
    return value
