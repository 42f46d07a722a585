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


def _product(a: Array, b: Array) -> Array:
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]
    return out


def _inverse(a: Array) -> Array:
    """Inverses by cofactors."""
    out = np.empty_like(a)
    for i in range(3):
        for j in range(3):
            p, q, r, s = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            out[j, i] = a[p, r] * a[q, s] - a[p, s] * a[q, r]
    return np.asarray(out / (a[0, 0] * out[0, 0] + a[0, 1] * out[1, 0] + a[0, 2] * out[2, 0]))


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
    """Principal square roots by the product form of the Denman-Beavers iteration."""
    y, z = m, m
    for _ in range(MOST_STEPS):
        inverse = _inverse(z)
        y = 0.5 * _product(y, _identity(m) + inverse)
        z = 0.5 * (_identity(m) + 0.5 * (z + inverse))
        if np.max(np.abs(z - _identity(m)), initial=0.0) < 500 * np.finfo(m.dtype).eps:
            break
    return y


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
    return _identity(e) * (r * d) + (p - r * b) * e + (q + r * a) * _product(e, e)
