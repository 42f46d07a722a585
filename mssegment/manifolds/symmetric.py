"""Functions of symmetric matrices [..., n, n], by their eigenvalues."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.records import Floats


def transposed(x: Floats) -> Floats:
    """Each matrix transposed."""
    return np.swapaxes(x, -1, -2)


def symmetric_part(x: Floats) -> Floats:
    """(x + x') / 2."""
    return np.asarray(0.5 * (x + transposed(x)))


def eigh(x: Floats) -> tuple[Floats, Floats]:
    """``np.linalg.eigh``, with NaN where a matrix is not finite instead of an error for all."""
    finite = np.asarray(np.isfinite(x).all(axis=(-2, -1), keepdims=True))
    if finite.all():
        return np.linalg.eigh(x)
    values, vectors = np.linalg.eigh(np.where(finite, x, np.eye(x.shape[-1])))
    return np.where(finite[..., 0], values, np.nan), np.where(finite, vectors, np.nan)


def eigenvalues(x: Floats) -> Floats:
    """The eigenvalues [..., n] of ``eigh`` alone, ascending."""
    finite = np.asarray(np.isfinite(x).all(axis=(-2, -1), keepdims=True))
    values = np.linalg.eigvalsh(np.where(finite, x, np.eye(x.shape[-1])))
    return np.where(finite[..., 0], values, np.nan)


def symmetric_function(function: Callable[[Floats], Floats], x: Floats) -> Floats:
    """A function of symmetric matrices, applied to their eigenvalues."""
    values, q = eigh(x)
    return np.asarray((q * function(values)[..., None, :]) @ transposed(q))


def square_roots(x: Floats) -> tuple[Floats, Floats]:
    """x^1/2 and x^-1/2 of symmetric positive definite matrices."""
    values, q = eigh(x)
    root = np.sqrt(values)[..., None, :]
    return np.asarray((q * root) @ transposed(q)), np.asarray((q / root) @ transposed(q))


def around(inverse: Floats, y: Floats) -> Floats:
    """x^-1/2 y x^-1/2, with ``inverse`` = x^-1/2."""
    return symmetric_part(inverse @ y @ inverse)


def log_derivative(x: Floats, v: Floats) -> Floats:
    """D log(x)[v], by divided differences of the logarithm (Daleckii and Krein)."""
    q, differences = _divided_differences(x)
    return np.asarray(q @ ((transposed(q) @ v @ q) * differences) @ transposed(q))


def exp_derivative(x: Floats, v: Floats) -> Floats:
    """D exp(log x)[v], the inverse of ``log_derivative`` at ``x``."""
    q, differences = _divided_differences(x)
    return np.asarray(q @ ((transposed(q) @ v @ q) / differences) @ transposed(q))


def _divided_differences(x: Floats) -> tuple[Floats, Floats]:
    """Eigenvectors of ``x``, and the divided differences of ln at its eigenvalues [..., n, n].

    With a, b the logarithms: (a - b) / (e^a - e^b) = e^(-(a + b) / 2) h / sinh h, h = (a - b) / 2.
    """
    values, q = eigh(x)
    logs = np.log(values)
    half = 0.5 * (logs[..., :, None] - logs[..., None, :])
    mean = 0.5 * (logs[..., :, None] + logs[..., None, :])
    ratio = np.divide(half, np.sinh(half), out=np.ones_like(half), where=half != 0)
    return q, np.exp(-mean) * ratio
