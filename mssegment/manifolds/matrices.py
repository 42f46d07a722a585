"""Stacks of small matrices: solutions, exponentials, and constants that logarithms need."""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np

from mssegment.manifolds.prepared import Array
from mssegment.records import Floats, Integers

ROUNDING = 1e-15
"""The shift, relative to the largest entry, of a matrix that rounding made singular."""
MAX_NORM = 0.3
"""The norm up to which Taylor's series is used; larger matrices are halved, the result squared."""


@cache
def gauss_legendre(nodes: int) -> list[tuple[float, float]]:
    """Abscissae and weights of Gauss-Legendre quadrature on [0, 1] (Golub and Welsch, 1969).

    From the eigenvalues and vectors of the recurrence: loading ``numpy.polynomial`` takes 2-4 ms.

    Examples
    --------
    >>> round(sum(w * t**2 for t, w in gauss_legendre(2)), 12)
    0.333333333333
    """
    k = np.arange(1.0, nodes)
    t, vectors = np.linalg.eigh(np.diag(k / np.sqrt(4.0 * k * k - 1.0), -1))
    return list(zip((0.5 + 0.5 * t).tolist(), (vectors[0] ** 2).tolist(), strict=True))


def exponential(v: Floats) -> Floats:
    """The matrix exponentials (16), by Taylor's series with scaling and squaring.

    The series is evaluated in pieces of four terms, which share the first powers (Paterson and
    Stockmeyer, 1973).

    Parameters
    ----------
    v
        Square matrices [..., s, s].

    Returns
    -------
    array
        Their exponentials [..., s, s].

    Examples
    --------
    >>> import numpy as np
    >>> exponential(np.array([[0.0, 1.0], [0.0, 0.0]])).tolist()
    [[1.0, 1.0], [0.0, 1.0]]
    """
    square = np.einsum("...ij,...ij->...", v, v)
    halvings = halvings_to(square, MAX_NORM)
    powers = np.empty((4, *v.shape))
    powers[0] = np.eye(v.shape[-1])
    np.multiply(v, np.ldexp(1.0, -halvings)[..., None, None], out=powers[1])
    np.matmul(powers[1], powers[1], out=powers[2])
    np.matmul(powers[1], powers[2], out=powers[3])
    fourth = powers[2] @ powers[2]
    low, middle, high = (_TAYLOR @ powers.reshape(4, -1)).reshape(3, *v.shape)
    total = low + fourth @ (middle + fourth @ high)
    for level in range(int(halvings.max(initial=0))):
        rows = halvings > level
        total[rows] = total[rows] @ total[rows]
    return np.asarray(total)


def halvings_to(square: Floats, norm: float) -> Integers:
    """How often to halve numbers until they are below ``norm``, given their squares [...].

    Each row has its own count: its result does not depend on the other rows. Where a square is not
    finite there is nothing to halve.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        count = np.ceil(np.log2(np.sqrt(square) / norm))
    return np.where(np.isfinite(count), np.maximum(count, 0.0), 0.0).astype(np.int64)


_TAYLOR = np.array([1.0 / factorial(i) for i in range(12)]).reshape(3, 4)
"""The coefficients of the exponential series; the omitted terms are below 1e-14 of its value."""


def inverse(x: Floats) -> Floats:
    """The inverses of ``x`` [..., s, s], as ``solve``."""
    return solve(x, np.broadcast_to(np.eye(x.shape[-1]), x.shape))


def solve(x: Floats, y: Floats) -> Floats:
    """x^-1 y for ``x`` [..., s, s] and ``y`` [..., s, t].

    Where rounding made a matrix singular, its diagonal is shifted by a rounding error.
    """
    try:
        return np.asarray(np.linalg.solve(x, y))
    except np.linalg.LinAlgError:
        shift = ROUNDING * np.abs(x).max(axis=(-2, -1), keepdims=True) * np.eye(x.shape[-1])
        return np.asarray(np.linalg.solve(x + shift, y))


def length2(log: Array) -> Array:
    """The squared Frobenius norms [...] of logarithms (r, s, ...); infinite where one is NaN."""
    square = np.einsum("ij...,ij...->...", log, log)
    return np.where(np.isnan(square), np.inf, square)


@cache
def bernoulli(count: int) -> list[float]:
    """The first coefficients of z, z^2, ... in z / (e^z - 1): the Bernoulli numbers over k!.

    Examples
    --------
    >>> [round(1 / c) if c else 0 for c in bernoulli(4)]
    [-2, 12, 0, -720]
    """
    even = np.arange(2, count + 1, 2)
    zeta = np.array([np.sum(1.0 / np.arange(1.0, 1e4 if s < 4 else 60.0) ** s) for s in even])
    zeta[0] = np.pi**2 / 6
    zeta[1] = np.pi**4 / 90
    coefficients = np.zeros(count)
    coefficients[0] = -0.5
    coefficients[even - 1] = (-1.0) ** (even // 2 + 1) * 2 * zeta / (2 * np.pi) ** even
    return [float(each) for each in coefficients]
