"""Small functions that SciPy and NumPy have, where loading theirs takes longer than the work.

``scipy.special`` takes a tenth of the whole segmentation of two pictures, ``statistics`` a
hundredth; ``np.unique``, ``np.median`` and ``np.quantile`` load ``numpy.ma``.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers


def normal_quantile(share: float) -> float:
    """What a standard normal number stays below with this chance, 0 < ``share`` < 1.

    By Newton's method on the tail, which is convex: from 0 no step goes too far.
    """
    tail, x, step = min(share, 1.0 - share), 0.0, 1.0
    while step > 1e-15 * x:
        step = (0.5 * math.erfc(x / math.sqrt(2.0)) - tail) * _normal_inverse_density(x)
        x += step
    return x if share > 0.5 else -x


def _normal_inverse_density(x: float) -> float:
    return math.sqrt(2.0 * math.pi) * math.exp(x * x / 2.0)


def chi_square_quantile(freedom: int, share: float) -> float:
    """What the sum of ``freedom`` squared standard normal numbers stays below with this chance.

    Exact for one and two degrees of freedom, else to a few per cent in the tail (Wilson and
    Hilferty, 1931).
    """
    if freedom == 1:
        return normal_quantile((1.0 + share) / 2.0) ** 2
    if freedom == 2:
        return -2.0 * math.log1p(-share)
    spread = 2.0 / (9.0 * freedom)
    root = 1.0 - spread + normal_quantile(share) * math.sqrt(spread)
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


def best_matching(gain: Integers) -> list[tuple[int, int]]:
    """The pairs (row, column), one of each row or one of each column, whose gains sum to most.

    The Hungarian method (Kuhn, 1955): each row in turn takes the shortest augmenting path, in
    prices (``row_price``, ``price``) that leave no pair cheaper than nothing.
    """
    if len(gain) > gain.shape[1]:
        return sorted((i, j) for j, i in best_matching(gain.T))
    cost = (gain.max(initial=0) - gain).astype(np.float64)
    row_price, price = np.zeros(len(cost)), np.zeros(cost.shape[1])
    row_of, column_of = np.full(cost.shape[1], -1), np.full(len(cost), -1)
    for start in range(len(cost)):
        distance, before = np.full(len(price), np.inf), np.full(len(price), -1)
        open_ = np.ones(len(price), dtype=bool)
        row, reached, column = start, 0.0, -1
        while row >= 0:
            through = reached + cost[row] - row_price[row] - price
            closer = open_ & (through < distance)
            distance[closer], before[closer] = through[closer], row
            column = int(np.argmin(np.where(open_, distance, np.inf)))
            open_[column] = False
            reached, row = float(distance[column]), int(row_of[column])
        cheaper = np.where(open_, 0.0, reached - distance)
        price -= cheaper
        taken = ~open_ & (row_of >= 0)
        row_price[row_of[taken]] += cheaper[taken]
        row_price[start] += reached
        while row != start:
            row = int(before[column])
            row_of[column] = row
            column, column_of[row] = int(column_of[row]), column
    return list(enumerate(column_of.tolist()))


def linked(pairs: Integers, count: int) -> Integers:
    """A number for each of ``count`` things, the same where ``pairs`` [k, 2] link them somehow."""
    group = np.arange(count)
    while True:
        least = group.copy()
        np.minimum.at(least, pairs[:, 0], group[pairs[:, 1]])
        np.minimum.at(least, pairs[:, 1], group[pairs[:, 0]])
        least = least[least]
        if np.array_equal(least, group):
            return group
        group = least
