"""The affine group A(2): the maps x -> A x + b of the plane, det A > 0 (section 5.5, (26)).

The logarithm is a closed form in real arithmetic, entry by entry over whole arrays. A function of
a 2 x 2 matrix A = s I + N, with N^2 = c I (s half the trace, c the discriminant; the eigenvalues
are s +- sqrt c), is p I + q N: p is the mean of the function over the two eigenvalues, q its
divided difference. The logarithm of [A b; 0 1] is [L v; 0 0] with L = (A - I) phi(A) and
v = phi(A) b, phi(z) = ln z / (z - 1), and needs one pair (p, q).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from mssegment.manifolds.base import Array
from mssegment.manifolds.matrices import gauss_legendre
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.records import Floats

_WITHIN = (0.1, 0.25)
_NODES = {np.dtype(np.float64): (5, 7, 12), np.dtype(np.float32): (2, 3, 6)}
"""Enough for the integral of phi where eigenvalues are so near 1, and where it is used at all, to
1e-15, and to 1e-6 or so."""

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

    def algebra_log(self, m: Array, within: float = np.inf) -> Array:
        """The principal logarithm of [A b; 0 1], both (2, 3, ...).

        NaN where no logarithm is real: det A <= 0, or negative real eigenvalues.
        """
        e = np.array(m).reshape(2, 3, int(np.prod(np.shape(m)[2:])))
        e[0, 0] -= 1.0
        e[1, 1] -= 1.0
        with np.errstate(all="ignore"):  # what has no logarithm is NaN
            return _times(e, *_phi(*_split(e))).reshape(np.shape(m))

    def onto_algebra(self, v: Array) -> Array:
        """``v``: every 2 x 3 matrix is in the algebra."""
        return v

    def project(self, x: Floats) -> Floats:
        """``x`` with the last row 0 0 1."""
        projected = np.array(x, dtype=np.float64)
        projected[..., 2, :] = (0.0, 0.0, 1.0)
        return projected

    def constraint_violation(self, x: Floats) -> Floats:
        """The distance of the last row from 0 0 1; infinite where det A <= 0."""
        determinant = x[..., 0, 0] * x[..., 1, 1] - x[..., 0, 1] * x[..., 1, 0]
        off = np.max(np.abs(x[..., 2, :] - np.array([0.0, 0.0, 1.0])), axis=-1)
        return np.where(determinant > 0, off, np.inf)


def _split(e: Array) -> tuple[Array, Array]:
    """s and c of the left 2 x 2 part of ``e`` (2, 3, ...)."""
    s = 0.5 * (e[0, 0] + e[1, 1])
    half = 0.5 * (e[0, 0] - e[1, 1])
    return s, half * half + e[0, 1] * e[1, 0]


def _times(e: Array, p: Array, q: Array) -> Array:
    """[F E, F t] with F = p I + q (E - s I), for e = [E t] (2, 3, ...)."""
    half = 0.5 * (e[0, 0] - e[1, 1])
    half *= q
    f00, f11 = p + half, p - half
    f01, f10 = q * e[0, 1], q * e[1, 0]
    out = np.empty_like(e)
    for j in range(3):
        np.multiply(f00, e[0, j], out=out[0, j])
        out[0, j] += f01 * e[1, j]
        np.multiply(f10, e[0, j], out=out[1, j])
        out[1, j] += f11 * e[1, j]
    return out


def _phi(s: Array, c: Array) -> tuple[Array, Array]:
    """p and q of phi(z) = ln z / (z - 1) at the eigenvalues 1 + s +- sqrt c; NaN if not real.

    Near the identity phi(A) is the integral of (I + t (A - I))^-1 dt over [0, 1]. Elsewhere it
    follows from the logarithm, or, where one eigenvalue is near 1, from the two eigenvalues.
    """
    away = np.sqrt(np.abs(c))
    away += np.abs(s)
    near = away < (0.5 if s.dtype == np.float64 else 0.9)
    if near.all():
        return _phi_near(s, c, float(away.max(initial=0.0)))
    if 2 * np.count_nonzero(near) > near.size:
        p, q = _phi_near(s, c)
        _fill(~near, _phi_far, s, c, p, q)
    else:
        p, q = _phi_far(s, c)
        _fill(near, _phi_near, s, c, p, q)
    no_logarithm = ~(((1.0 + s) ** 2 > c) & ((c < 0) | (s > -1.0)))
    p[no_logarithm] = np.nan
    return p, q


def _phi_near(s: Array, c: Array, within: float = 1.0) -> tuple[Array, Array]:
    """By a quadrature, where the eigenvalues are ``within`` so much of 1."""
    nodes = _NODES[s.dtype][sum(within >= bound for bound in _WITHIN)]
    p, q = np.zeros_like(s), np.zeros_like(s)
    for t, w in gauss_legendre(nodes):
        u = t * s
        u += 1.0
        over = u * u
        over -= (t * t) * c
        np.divide(w, over, out=over)
        u *= over
        p += u
        over *= t
        q -= over
    return p, q


def _phi_far(s: Array, c: Array) -> tuple[Array, Array]:
    """By det(A - I) = s^2 - c, where that is not near 0."""
    root = np.sqrt(np.abs(c))
    middle, away = 1.0 + s, s * s - c
    ell = 0.5 * np.log(middle * middle - c)
    real = 0.5 * np.log((middle + root) / (middle - root))
    g = np.where(c > 0, real, np.arctan2(root, middle)) / root
    close = (np.abs(c) < 0.04 * middle * middle) & (middle > 0)
    g[close] = _atanh_ratio(c[close] / middle[close] ** 2) / middle[close]
    p, q = (ell * s - g * c) / away, (g * s - ell) / away
    single = (c > 0) & (middle > root) & (np.abs(away) < 1e-2 * (1 + s * s))
    _fill(single, _phi_by_eigenvalue, s, c, p, q)
    return p, q


def _atanh_ratio(x: Array) -> Array:
    """atanh(sqrt x) / sqrt x for |x| < 0.04, where the eigenvalues are too close to tell apart."""
    total = np.zeros_like(x)
    for i in range(11, -1, -1):
        total = total * x + 1.0 / (2 * i + 1)
    return total


def _phi_by_eigenvalue(s: Array, c: Array) -> tuple[Array, Array]:
    root = np.sqrt(c)
    return _mean_and_difference(_ratio(np.log1p, s + root), _ratio(np.log1p, s - root), root)


def _mean_and_difference(above: Array, below: Array, root: Array) -> tuple[Array, Array]:
    return 0.5 * (above + below), 0.5 * (above - below) / root


def _ratio(function: Callable[[Array], Array], z: Array) -> Array:
    """function(z) / z, 1 at 0."""
    return np.divide(function(z), z, out=np.ones_like(z), where=z != 0)


def _fill(
    where: Mask,
    function: Callable[[Array, Array], tuple[Array, Array]],
    s: Array,
    c: Array,
    p: Array,
    q: Array,
) -> None:
    """Put ``function``'s p and q where ``where`` says so."""
    if where.any():
        p[where], q[where] = function(s[where], c[where])
