"""The affine group A(2): the maps x -> A x + b of the plane, det A > 0 (section 5.5, (26)).

Logarithm and exponential are closed forms in real arithmetic, entry by entry over whole arrays.
A function of a 2 x 2 matrix A = s I + N, with N^2 = c I (s half the trace, c the discriminant; the
eigenvalues are s +- sqrt c), is p I + q N: p is the mean of the function over the two eigenvalues,
q its divided difference. The logarithm of [A b; 0 1] is [L v; 0 0] with L = (A - I) phi(A) and
v = phi(A) b, phi(z) = ln z / (z - 1); the exponential of [L v; 0 0] is [A b; 0 1] with
A = I + L psi(L) and b = psi(L) v, psi(z) = (e^z - 1) / z. So each needs one pair (p, q).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.records import Floats

_ABSCISSAE, _WEIGHTS = (
    a.tolist() for a in (0.5 * np.array(np.polynomial.legendre.leggauss(12)) + [[0.5], [0.0]])
)
"""Gauss-Legendre on [0, 1]: the integrals of phi and psi to 1e-15 where they are used."""

Mask = npt.NDArray[np.bool_]


class AffineGroup(MatrixGroup):
    """A(2), 3 x 3 matrices [A b; 0 1], dimension 6."""

    examples = ("affine(2)", "affine(2,exact)")
    family = "affine"
    order = 2
    rows = 2
    size = 3

    @property
    def dim(self) -> int:
        """6."""
        return 6

    def algebra_exp(self, v: Floats) -> Floats:
        """The exponential of [L v; 0 0], both (2, 3, ...)."""
        flat = np.asarray(v, dtype=np.float64).reshape(2, 3, -1)
        return _assemble(flat, *_psi(*_split(flat)), one=1.0).reshape(np.shape(v))

    def algebra_log(self, m: Floats) -> Floats:
        """The principal logarithm of [A b; 0 1], both (2, 3, ...).

        NaN where no logarithm is real: det A <= 0, or negative real eigenvalues.
        """
        e = np.array(m, dtype=np.float64).reshape(2, 3, -1)
        e[0, 0] -= 1.0
        e[1, 1] -= 1.0
        return _assemble(e, *_phi(*_split(e)), one=0.0).reshape(np.shape(m))

    def onto_algebra(self, v: Floats) -> Floats:
        """``v``: every 2 x 3 matrix is in the algebra."""
        return v

    def project(self, x: Floats) -> Floats:
        """``x`` with the last row 0 0 1."""
        projected = np.array(x, dtype=np.float64)
        projected[..., 2, :] = (0.0, 0.0, 1.0)
        return projected

    def deviation(self, x: Floats) -> Floats:
        """The distance of the last row from 0 0 1; infinite where det A <= 0."""
        determinant = x[..., 0, 0] * x[..., 1, 1] - x[..., 0, 1] * x[..., 1, 0]
        off = np.max(np.abs(x[..., 2, :] - np.array([0.0, 0.0, 1.0])), axis=-1)
        return np.where(determinant > 0, off, np.inf)


def _split(e: Floats) -> tuple[Floats, Floats]:
    """s and c of the left 2 x 2 part of ``e`` (2, 3, ...)."""
    s = 0.5 * (e[0, 0] + e[1, 1])
    half = 0.5 * (e[0, 0] - e[1, 1])
    return s, half * half + e[0, 1] * e[1, 0]


def _assemble(e: Floats, p: Floats, q: Floats, one: float) -> Floats:
    """[one I + E F, F t] with F = p I + q (E - s I), for e = [E t] (2, 3, ...)."""
    s = 0.5 * (e[0, 0] + e[1, 1])
    f00, f11 = p + q * (e[0, 0] - s), p + q * (e[1, 1] - s)
    f01, f10 = q * e[0, 1], q * e[1, 0]
    out = np.empty_like(e)
    for j in range(3):
        out[0, j] = f00 * e[0, j] + f01 * e[1, j]
        out[1, j] = f10 * e[0, j] + f11 * e[1, j]
    out[0, 0] += one
    out[1, 1] += one
    return out


def _phi(s: Floats, c: Floats) -> tuple[Floats, Floats]:
    """p and q of phi(z) = ln z / (z - 1) at the eigenvalues z = 1 + s +- sqrt c.

    With det(A - I) = s^2 - c away from 0 both follow from the logarithm; near the identity from
    phi(A) = integral of (I + t (A - I))^-1 dt over [0, 1]; where one eigenvalue is near 1 and the
    other is not, from the two eigenvalues.
    """
    root = np.sqrt(np.abs(c))
    trace_half, determinant = 1.0 + s, (1.0 + s) ** 2 - c
    no_logarithm = ~((determinant > 0) & ((c < 0) | (trace_half > 0)))
    with np.errstate(all="ignore"):
        real = 0.5 * np.log((trace_half + root) / (trace_half - root))
        g = np.where(c > 0, real, np.arctan2(root, trace_half)) / root
        ell, away = 0.5 * np.log(determinant), s * s - c
        p, q = (ell * s - g * c) / away, (g * s - ell) / away
    near = (np.abs(s) + root < 0.5) | (root == 0)
    single = ~near & (c > 0) & (np.abs(away) < 1e-2 * (1 + s * s)) & ~no_logarithm
    _fill(near, _phi_near, s, c, p, q)
    _fill(single, _phi_by_eigenvalue, s, c, p, q)
    return np.where(no_logarithm, np.nan, p), q


def _phi_near(s: Floats, c: Floats) -> tuple[Floats, Floats]:
    p, q = np.zeros_like(s), np.zeros_like(s)
    for t, w in zip(_ABSCISSAE, _WEIGHTS, strict=True):
        u = 1.0 + t * s
        over = w / (u * u - t * t * c)
        p += u * over
        q -= t * over
    return p, q


def _phi_by_eigenvalue(s: Floats, c: Floats) -> tuple[Floats, Floats]:
    root = np.sqrt(c)
    return _mean_and_difference(_ratio(np.log1p, s + root), _ratio(np.log1p, s - root), root)


def _psi(s: Floats, c: Floats) -> tuple[Floats, Floats]:
    """p and q of psi(z) = (e^z - 1) / z at the eigenvalues z = s +- sqrt c, as in ``_phi``."""
    root = np.sqrt(np.abs(c))
    with np.errstate(all="ignore"):
        scale = np.exp(s)
        even = scale * np.where(c > 0, np.cosh(root), np.cos(root)) - 1.0
        odd = scale * np.where(c > 0, np.sinh(root), np.sin(root)) / root
        determinant = s * s - c
        p, q = (even * s - odd * c) / determinant, (odd * s - even) / determinant
    near = (np.abs(s) + root < 1.0) | (root == 0)
    single = ~near & (c > 0)
    _fill(near, _psi_near, s, c, p, q)
    _fill(single, _psi_by_eigenvalue, s, c, p, q)
    return p, q


def _psi_near(s: Floats, c: Floats) -> tuple[Floats, Floats]:
    p, q = np.zeros_like(s), np.zeros_like(s)
    root = np.sqrt(np.abs(c))
    for t, w in zip(_ABSCISSAE, _WEIGHTS, strict=True):
        scale = w * np.exp(t * s)
        p += scale * np.where(c > 0, np.cosh(t * root), np.cos(t * root))
        q += scale * t * np.where(c > 0, _ratio(np.sinh, t * root), np.sinc(t * root / np.pi))
    return p, q


def _psi_by_eigenvalue(s: Floats, c: Floats) -> tuple[Floats, Floats]:
    root = np.sqrt(c)
    return _mean_and_difference(_ratio(np.expm1, s + root), _ratio(np.expm1, s - root), root)


def _mean_and_difference(above: Floats, below: Floats, root: Floats) -> tuple[Floats, Floats]:
    return 0.5 * (above + below), 0.5 * (above - below) / root


def _ratio(function: Callable[[Floats], Floats], z: Floats) -> Floats:
    """function(z) / z, 1 at 0."""
    return np.divide(function(z), z, out=np.ones_like(z), where=z != 0)


def _fill(
    where: Mask,
    function: Callable[[Floats, Floats], tuple[Floats, Floats]],
    s: Floats,
    c: Floats,
    p: Floats,
    q: Floats,
) -> None:
    """Put ``function``'s p and q where ``where`` says so."""
    if where.any():
        p[where], q[where] = function(s[where], c[where])
