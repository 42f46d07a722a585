"""Many small matrices at a time: solutions, exponentials, and the numbers that logarithms need."""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np

from mssegment.manifolds.base import Array
from mssegment.records import Floats

ROUNDING = 1e-15
"""Of the largest entry: so much moves a matrix that rounding made singular."""
HALVED = 0.3
"""The exponential of anything longer is that of its half, squared."""


@cache
def gauss_legendre(nodes: int) -> list[tuple[float, float]]:
    """Abscissae and weights of Gauss-Legendre quadrature on [0, 1] (Golub and Welsch, 1969).

    From eigenvalues and vectors of the recurrence, without loading ``numpy.polynomial``.
    """
    k = np.arange(1.0, nodes)
    t, vectors = np.linalg.eigh(np.diag(k / np.sqrt(4.0 * k * k - 1.0), -1))
    return list(zip((0.5 + 0.5 * t).tolist(), (vectors[0] ** 2).tolist(), strict=True))


def exponential(v: Floats) -> Floats:
    """The matrix exponentials (16) of ``v`` [..., s, s]: Taylor's series after halving, squared.

    The series is cut into pieces of four terms, which share the first powers (Paterson and
    Stockmeyer, 1973).
    """
    longest = float(np.sqrt(np.max(np.einsum("...ij,...ij->...", v, v), initial=0.0)))
    halvings = max(0, int(np.ceil(np.log2(longest / HALVED)))) if longest > HALVED else 0
    powers = np.empty((4, *v.shape))
    powers[0] = np.eye(v.shape[-1])
    np.multiply(v, 0.5**halvings, out=powers[1])
    np.matmul(powers[1], powers[1], out=powers[2])
    np.matmul(powers[1], powers[2], out=powers[3])
    fourth = powers[2] @ powers[2]
    low, middle, high = (_TAYLOR @ powers.reshape(4, -1)).reshape(3, *v.shape)
    total = low + fourth @ (middle + fourth @ high)
    for _ in range(halvings):
        total = total @ total
    return np.asarray(total)


_TAYLOR = np.array([1.0 / factorial(i) for i in range(12)]).reshape(3, 4)
"""The coefficients of the exponential: what is left out is below 1e-14 of it."""


def inverse(x: Floats) -> Floats:
    """x^-1, as ``solve``."""
    return solve(x, np.broadcast_to(np.eye(x.shape[-1]), x.shape))


def solve(x: Floats, y: Floats) -> Floats:
    """x^-1 y; matrices so long that double precision makes them singular are moved a little."""
    try:
        return np.asarray(np.linalg.solve(x, y))
    except np.linalg.LinAlgError:
        off = ROUNDING * np.abs(x).max(axis=(-2, -1), keepdims=True) * np.eye(x.shape[-1])
        return np.asarray(np.linalg.solve(x + off, y))


def length2(log: Array) -> Array:
    """The squared Frobenius norm of (r, s, ...) matrices; infinite where there is no logarithm."""
    square = np.einsum("ij...,ij...->...", log, log)
    return np.where(np.isnan(square), np.inf, square)


@cache
def bernoulli(count: int) -> list[float]:
    """The coefficients of z, z^2, ... in z / (e^z - 1): -1/2, 1/12, 0, -1/720, ..."""
    even = np.arange(2, count + 1, 2)
    zeta = np.array([np.sum(1.0 / np.arange(1.0, 1e4 if s < 4 else 60.0) ** s) for s in even])
    zeta[0] = np.pi**2 / 6
    zeta[1] = np.pi**4 / 90
    coefficients = np.zeros(count)
    coefficients[0] = -0.5
    coefficients[even - 1] = (-1.0) ** (even // 2 + 1) * 2 * zeta / (2 * np.pi) ** even
    return [float(each) for each in coefficients]
