"""Lightweight replacements for SciPy and NumPy functions that are slow to import.

Segmenting two pictures takes about 0.48 s of CPU. Loading ``scipy.special`` would add 0.13 s to it,
``numpy.ma``, which ``np.median``, ``np.quantile`` and ``np.unique`` load, 0.01 s.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers


def chi_square_quantile(freedom: int, share: float) -> float:
    """A quantile of the chi-square distribution, as ``scipy.stats.chi2.ppf``.

    By hand since loading ``scipy.special`` takes 0.13 s.

    Parameters
    ----------
    freedom
        The degrees of freedom, at least 1.
    share
        The probability, between 0 and 1.

    Returns
    -------
    float
        The quantile: exact for one and two degrees of freedom, else to a few per cent in the tail.

    References
    ----------
    E. B. Wilson and M. M. Hilferty, "The distribution of chi-square", PNAS 17, 1931.

    Examples
    --------
    >>> round(chi_square_quantile(2, 0.95), 3)
    5.991
    """
    normal = NormalDist()
    if freedom == 1:
        return normal.inv_cdf((1.0 + share) / 2.0) ** 2
    if freedom == 2:
        return -2.0 * math.log1p(-share)
    variance = 2.0 / (9.0 * freedom)
    root = 1.0 - variance + normal.inv_cdf(share) * math.sqrt(variance)
    return float(freedom * root**3)


TAIL_TERMS = 200
"""Terms of a series whose factors are below a half, beyond any digit of a double."""


def student_t_tail(t: float, freedom: int) -> float:
    """The probability above ``t`` of the Student t distribution, as ``scipy.stats.t.sf``.

    By hand since loading ``scipy.special`` takes 0.13 s.

    Parameters
    ----------
    t
        At least 0.
    freedom
        The degrees of freedom, an even number.

    Returns
    -------
    float
        The probability, at most a half; exact in the far tail as well.

    Raises
    ------
    ValueError
        If ``freedom`` is odd or ``t`` negative.

    References
    ----------
    M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, equation 26.7.4.

    Examples
    --------
    >>> round(student_t_tail(2.0, 8), 6)
    0.040258
    """
    if freedom < 2 or freedom % 2 or t < 0:
        raise ValueError(f"expected even degrees of freedom and t >= 0, not {freedom} and {t}")
    within = freedom / (freedom + t * t)
    root = t / math.sqrt(freedom + t * t)
    k = np.arange(1, freedom // 2 + TAIL_TERMS)
    terms = np.append(1.0, np.cumprod(within * (2 * k - 1) / (2 * k)))
    # all terms add up to 1 / root: the tail is what those of the head leave
    if within < 0.5:
        return float(0.5 * root * terms[freedom // 2 :].sum())
    return float(0.5 * (1 - root * terms[: freedom // 2].sum()))


def trigamma_of_half(freedom: int) -> float:
    """The trigamma function of ``freedom`` / 2, as ``scipy.special.polygamma(1, freedom / 2)``.

    By hand since loading ``scipy.special`` takes 0.13 s. By the recurrence from 1/2 or 1.

    Parameters
    ----------
    freedom
        A positive integer.

    Examples
    --------
    >>> round(trigamma_of_half(2), 4)
    1.6449
    """
    x, value = (0.5, math.pi**2 / 2.0) if freedom % 2 else (1.0, math.pi**2 / 6.0)
    while x < freedom / 2.0:
        value -= 1.0 / (x * x)
        x += 1.0
    return value


def distinct(values: npt.ArrayLike) -> Integers:
    """The sorted distinct integers in ``values``, as ``np.unique``.

    By hand since ``np.unique`` loads ``numpy.ma``, 0.01 s.

    Examples
    --------
    >>> distinct([3, 1, 3]).tolist()
    [1, 3]
    """
    ordered = np.sort(np.asarray(values, dtype=np.int64), axis=None)
    first = np.r_[True, ordered[1:] != ordered[:-1]][: len(ordered)]
    return np.asarray(ordered[first])


def nan_median(values: Floats, axis: int = 0) -> Floats:
    """The medians along an axis without NaN, as ``np.nanmedian``; NaN where all are.

    That takes several times as long: it masks, or goes from row to row in Python.

    Examples
    --------
    >>> import numpy as np
    >>> nan_median(np.array([[4.0, np.nan], [1.0, 3.0], [3.0, 2.0], [2.0, np.nan]])).tolist()
    [2.5, 2.5]
    """
    ordered = np.sort(values, axis=axis)  # NaN last
    count = np.isfinite(values).sum(axis=axis, keepdims=True)
    lower, upper = np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[axis] - 1)
    both = [np.take_along_axis(ordered, place, axis) for place in (lower, upper)]
    return np.asarray(np.squeeze(both[0] + both[1], axis) / 2)


def median(values: Floats) -> float:
    """The median of all ``values``, as ``np.median``; at least one, all finite.

    By hand since ``np.median`` loads ``numpy.ma``, 0.01 s.

    Examples
    --------
    >>> import numpy as np
    >>> median(np.array([4.0, 1.0, 3.0, 2.0]))
    2.5
    """
    upper = values.size // 2
    lower = (values.size - 1) // 2
    ordered = np.partition(values, [lower, upper], axis=None)
    return float(ordered[lower] + ordered[upper]) / 2


def quantile(values: Floats, share: float) -> Floats:
    """The quantile along the last axis, as ``np.quantile``; all values finite.

    By hand since ``np.quantile`` loads ``numpy.ma``, 0.01 s.

    Parameters
    ----------
    values
        Numbers [..., n], n at least 1.
    share
        The probability, between 0 and 1.

    Returns
    -------
    array
        The quantiles [...], interpolated linearly.

    Examples
    --------
    >>> import numpy as np
    >>> quantile(np.array([[0.0, 10.0, 20.0]]), 0.25).tolist()
    [5.0]
    """
    place = share * (values.shape[-1] - 1)
    below = int(place)
    above = min(below + 1, values.shape[-1] - 1)
    low, high = np.moveaxis(np.partition(values, [below, above])[..., [below, above]], -1, 0)
    part, gap = place - below, high - low
    return np.asarray(low + gap * part if part < 0.5 else high - gap * (1 - part))


def binomial_log_tail(hits: Integers, trials: int, log_share: Floats) -> Floats:
    """Chernoff's bound of the log probability of at least so many hits.

    ``hits`` [P] of ``trials``, each with the probabilities exp(``log_share``), [B, P].

    Examples
    --------
    >>> binomial_log_tail(np.array([5, 50]), 100, np.log([[0.05, 0.05]])).round(1).tolist()
    [[0.0, -83.0]]
    """
    share = np.clip(hits / trials, 0.0, 1.0)
    rest = 1.0 - share
    log_share = np.minimum(log_share, -1e-12)
    p = np.exp(log_share)
    gain = share * (_log(share) - log_share) + rest * (_log(rest) - np.log1p(-p))
    return np.asarray(np.where(share > p, -trials * gain, 0.0))


def _log(values: Floats) -> Floats:
    """Logarithms, 0 for 0."""
    return np.asarray(np.log(np.where(values > 0, values, 1.0)))
