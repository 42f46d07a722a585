"""Small functions that SciPy and NumPy have, where loading theirs takes longer than the work.

``scipy.special`` takes a tenth of the whole segmentation of two pictures; ``np.unique``,
``np.median`` and ``np.quantile`` load ``numpy.ma``.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers


def chi_square_quantile(freedom: int, share: float) -> float:
    """What the sum of ``freedom`` squared standard normal numbers stays below with this chance.

    Exact for one and two degrees of freedom, else to a few per cent in the tail (Wilson and
    Hilferty, 1931).
    """
    normal = NormalDist()
    if freedom == 1:
        return normal.inv_cdf((1.0 + share) / 2.0) ** 2
    if freedom == 2:
        return -2.0 * math.log1p(-share)
    spread = 2.0 / (9.0 * freedom)
    root = 1.0 - spread + normal.inv_cdf(share) * math.sqrt(spread)
    return float(freedom * root**3)


def trigamma_of_half(freedom: int) -> float:
    """The trigamma function of ``freedom`` / 2, by its recurrence from 1/2 or 1."""
    x, value = (0.5, math.pi**2 / 2.0) if freedom % 2 else (1.0, math.pi**2 / 6.0)
    while x < freedom / 2.0:
        value -= 1.0 / (x * x)
        x += 1.0
    return value


def distinct(values: npt.ArrayLike) -> Integers:
    """The different whole numbers in ``values``, in order, as ``np.unique``."""
    ordered = np.sort(np.asarray(values, dtype=np.int64), axis=None)
    first = np.r_[True, ordered[1:] != ordered[:-1]][: len(ordered)]
    return np.asarray(ordered[first])


def median(values: Floats) -> float:
    """The median of all ``values``, as ``np.median``; at least one, all finite."""
    upper = values.size // 2
    lower = (values.size - 1) // 2
    ordered = np.partition(values, [lower, upper], axis=None)
    return float(ordered[lower] + ordered[upper]) / 2


def quantile(values: Floats, share: float) -> Floats:
    """The quantile along the last axis, as ``np.quantile``; all values finite."""
    place = share * (values.shape[-1] - 1)
    below = int(place)
    above = min(below + 1, values.shape[-1] - 1)
    low, high = np.moveaxis(np.partition(values, [below, above])[..., [below, above]], -1, 0)
    part, gap = place - below, high - low
    return np.asarray(low + gap * part if part < 0.5 else high - gap * (1 - part))
