"""The special linear group SL(3): homographies of the plane, 3 x 3 matrices with determinant 1."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.manifolds.base import Array
from mssegment.manifolds.matrix_group import MatrixGroup, gauss_legendre
from mssegment.records import Floats

_DOUBLE, _SINGLE = gauss_legendre(16), gauss_legendre(7)
NEAR = 1.0
"""|M - I|_F below which 16 quadrature nodes give the logarithm to 1e-14 (7: 1e-6)."""
MOST_ROOTS, MOST_STEPS = 40, 20
TAYLOR_TERMS = 14


class SpecialLinear(MatrixGroup):
    """SL(3), dimension 8."""

    examples = ("special_linear(3)", "special_linear(3,exact)")
    family = "special_linear"
    order = 3
    rows = 3
    size = 3

    @property
    def dim(self) -> int:
        """8."""
        return 8

    def algebra_exp(self, v: Array) -> Array:
        """Equation (16) by Taylor's series after halving ``v`` (3, 3, ...), then squaring."""
        length = float(np.sqrt(np.max(np.sum(v * v, axis=(0, 1)), initial=0.0)))
        squarings = max(0, int(np.ceil(np.log2(4.0 * length)))) if length > 0.25 else 0
        small = v / 2.0**squarings
        total = _identity(v)
        for i in range(TAYLOR_TERMS, 0, -1):
            total = _identity(v) + _product(small, total) / i
        for _ in range(squarings):
            total = _product(total, total)
        return total

    def algebra_log(self, m: Array) -> Array:
        """Equation (17) of ``m`` (3, 3, ...) by repeated square roots and a quadrature.

        NaN where no logarithm is real: an eigenvalue is zero or real and negative.
        """
        flat = np.reshape(m, (3, 3, int(np.prod(np.shape(m)[2:]))))
        with np.errstate(all="ignore"):
            return self._log(flat).reshape(np.shape(m))

    def _log(self, flat: Array) -> Array:
        log = np.full_like(flat, np.nan)
        todo = np.flatnonzero(_has_real_log(flat))
        root = flat[:, :, todo]
        for roots in range(MOST_ROOTS):
            done = np.sum((root - _identity(root)) ** 2, axis=(0, 1)) < NEAR**2
            log[:, :, todo[done]] = 2.0**roots * _log_near_identity(root[:, :, done])
            todo, root = todo[~done], root[:, :, ~done]
            if not todo.size:
                break
            root = _square_root(root)
        return self.onto_algebra(log)

    def onto_algebra(self, v: Array) -> Array:
        """``v`` without its trace."""
        return np.asarray(v - _identity(v) * ((v[0, 0] + v[1, 1] + v[2, 2]) / 3.0))

    def project(self, x: Floats) -> Floats:
        """``x`` divided by the cube root of its determinant."""
        return np.asarray(x / np.cbrt(np.linalg.det(x))[..., None, None])

    def deviation(self, x: Floats) -> Floats:
        """|det x - 1|."""
        return np.asarray(np.abs(np.linalg.det(x) - 1.0))


def _identity(like: Array) -> Array:
    return np.broadcast_to(
        np.eye(3, dtype=like.dtype).reshape(3, 3, *(1,) * (like.ndim - 2)), like.shape
    )


def _add_to_diagonal(m: Array, numbers: Array) -> None:
    for i in range(3):
        m[i, i] += numbers


def _product(a: Array, b: Array) -> Array:
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    part = np.empty(out.shape[2:], dtype=out.dtype)
    for i in range(3):
        for j in range(3):
            total = np.multiply(a[i, 0], b[0, j], out=out[i, j, ...])
            total += np.multiply(a[i, 1], b[1, j], out=part)
            total += np.multiply(a[i, 2], b[2, j], out=part)
    return out


def _invariants(m: Array) -> tuple[Array, Array, Array]:
    """Trace, sum of the principal minors, determinant."""
    a = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    b = m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0]
    c = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    minors = a + m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0] + m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return m[0, 0] + m[1, 1] + m[2, 2], minors, m[0, 0] * a - m[0, 1] * b + m[0, 2] * c


def _has_real_log(m: Array) -> npt.NDArray[np.bool_]:
    """Whether no eigenvalue is real and <= 0.

    -x is an eigenvalue when x^3 + a x^2 + b x + d = 0, with a the trace, b the sum of the principal
    minors, d the determinant; for d > 0 the cubic has no root x > 0 unless its minimum is <= 0.
    """
    a, b, d = _invariants(m)
    discriminant = a * a - 3.0 * b
    x = (np.sqrt(np.maximum(discriminant, 0.0)) - a) / 3.0
    dips = (discriminant >= 0) & (x > 0) & (((x + a) * x + b) * x + d <= 0)
    return np.asarray(np.isfinite(a) & np.isfinite(b) & (d > 0) & ~dips)


def _square_root(m: Array) -> Array:
    """Principal square roots U, by Cayley and Hamilton a polynomial in M (Hoger and Carlson, 1984).

    With r_i the roots of the eigenvalues, s = r1 + r2 + r3 is the largest root of
    (s^2 - a)^2 = 4 b + 8 d s, where a, b, d^2 are the invariants of M: the others have two signs
    changed. Newton's iteration comes down to it from above without a detour.
    """
    a, b, determinant = _invariants(m)
    d = np.sqrt(determinant)
    s = np.sqrt(3.0 * np.sqrt(3.0 * np.sum(m * m, axis=(0, 1)))).astype(m.dtype)
    enough = 0.1 * float(np.sqrt(np.finfo(m.dtype).eps))
    for _ in range(MOST_STEPS):
        gap = s * s - a
        fall = (gap * gap - 8.0 * d * s - 4.0 * b) / (4.0 * s * gap - 8.0 * d)
        s -= fall
        # the error that is left is of the order of the square of the last step
        if not np.any(np.abs(fall) > enough * s):
            break
    q = 0.5 * (s * s - a)
    over = 1.0 / (s * q - d)
    root = (over * (s * s - q)) * m
    root -= over * _product(m, m)
    _add_to_diagonal(root, over * (s * d))
    return np.asarray(root)


def _log_near_identity(m: Array) -> Array:
    """log M = integral over [0, 1] of E (I + t E)^-1 dt, E = M - I, by Gauss and Legendre.

    By Cayley and Hamilton the integrand is a polynomial in E whose coefficients need only the
    invariants of E: (I + t E)^-1 = ((1 + t a + t^2 b) I - t (1 + t a) E + t^2 E^2) / det(I + t E).
    """
    e = m - _identity(m)
    a, b, d = _invariants(e)
    p, q, r = np.zeros_like(a), np.zeros_like(a), np.zeros_like(a)
    for t, w in _DOUBLE if m.dtype == np.float64 else _SINGLE:
        linear = 1.0 + t * a
        quadratic = linear + (t * t) * b
        over = w / (quadratic + t**3 * d)
        p += quadratic * over
        q -= t * (linear * over)
        r += (t * t) * over
    log = (q + r * a) * _product(e, e)
    log += (p - r * b) * e
    _add_to_diagonal(log, r * d)
    return log
