"""The special linear group SL(3): homographies, as 3 x 3 matrices with determinant 1."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

from mssegment.geometry.rotations import tangent_basis
from mssegment.manifolds.affine import affine_logarithm
from mssegment.manifolds.matrices import gauss_legendre
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import Array
from mssegment.records import Floats, Integers

QUADRATURE_BOUNDS = (4.0, 2.4)
"""Bounds of |tr M + tr M^-1 - 6| / 2 and |tr M - tr M^-1| / 2. Within them, where both traces are
positive, no eigenvalue is real and negative, and the quadrature applies."""
SHORTEST_OUTSIDE = 2.2
"""Logarithms of matrices outside of these bounds are longer than this."""
MAX_ROOTS, MAX_NEWTON_STEPS = 40, 20
MARGIN = 0.01
"""Square roots are used where the characteristic polynomial at negative numbers is larger than this
share of its terms, that is further than about 5 degrees from half a turn."""
SINGULAR = 1e-15
"""The determinant of a matrix with largest entry 1 below which it is rounding."""
MAX_CONDITION = 300.0
"""The product |M| |M^-1| up to which square roots are used; deflation is more accurate beyond."""


_BOUND_FRACTIONS = (0.075, 0.25)
_NODES = {np.dtype(np.float64): (5, 7, 12), np.dtype(np.float32): (2, 3, 5)}
"""Quadrature nodes within each fraction of the bounds, and up to the bounds: logarithms are then
good to 1e-13 in double and 3e-6 in single precision."""


class SL3(MatrixGroup):
    """SL(3): the homographies of the plane, dimension 8.

    Points are 3 x 3 matrices with determinant 1.

    Parameters
    ----------
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).

    Examples
    --------
    >>> import numpy as np
    >>> group = SL3()
    >>> group.log(np.eye(3), np.diag([2.0, 1.0, 0.5])).round(3).tolist()
    [[0.693, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -0.693]]
    >>> group.project(2.0 * np.eye(3)).round(6).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """

    examples = ("special_linear(3)", "special_linear(3,exact)")
    family = "special_linear"
    order = 3
    free_rows = 3
    size = 3

    @property
    def dim(self) -> int:
        """The dimension, 8."""
        return 8

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm (17), by quadrature after repeated square roots.

        NaN where no logarithm is real: an eigenvalue is zero, or real and negative (but for half a
        turn, where two of them coincide).
        """
        flat = np.reshape(m, (3, 3, int(np.prod(np.shape(m)[2:]))))
        with np.errstate(all="ignore"):
            return _log(flat, max_norm, MAX_ROOTS).reshape(np.shape(m))

    def onto_algebra(self, v: Array) -> Array:
        """``v`` minus the multiple of the identity that has its trace."""
        out = np.array(v)
        _add_to_diagonal(out, (v[0, 0] + v[1, 1] + v[2, 2]) / -3.0)
        return out

    def project(self, x: Floats) -> Floats:
        """``x`` divided by the cube root of its determinant; there is none near where that is 0."""
        self.check_finite(x)
        largest = np.abs(x).max(axis=(-2, -1), initial=0.0)[..., None, None]
        unit = x / np.where(largest > 0, largest, 1.0)
        determinant = np.linalg.det(unit)
        self._refuse(~(np.abs(determinant) > SINGULAR), "it is singular")
        once = unit / np.cbrt(determinant)[..., None, None]
        return np.asarray(once / np.cbrt(np.linalg.det(once))[..., None, None])

    def constraint_violation(self, x: Floats) -> Floats:
        """The error of the determinant, |det x - 1|."""
        return np.asarray(np.abs(np.linalg.det(x) - 1.0))


def _log(m: Array, max_norm: float, roots: int) -> Array:
    """The logarithms of ``m`` (3, 3, n), NaN where none is real; longer ones than ``max_norm`` may
    be NaN too. At most ``roots`` square roots are taken.
    """
    inverse = _adjugate(m)
    a, b = m[0, 0] + m[1, 1] + m[2, 2], inverse[0, 0] + inverse[1, 1] + inverse[2, 2]
    even, odd = np.abs(0.5 * (a + b) - 3.0), np.abs(0.5 * (a - b))
    near = (even < QUADRATURE_BOUNDS[0]) & (odd < QUADRATURE_BOUNDS[1]) & (a > 0) & (b > 0)
    fraction = max(
        float(even.max(initial=0.0, where=near)) / QUADRATURE_BOUNDS[0],
        float(odd.max(initial=0.0, where=near)) / QUADRATURE_BOUNDS[1],
    )
    level = sum(fraction > bound for bound in _BOUND_FRACTIONS)
    log = _log_near_identity(m, inverse, a, b, _NODES[m.dtype][level])
    far = np.flatnonzero(~near)
    if far.size:
        log[:, :, far] = np.nan
        if max_norm > SHORTEST_OUTSIDE:
            _set_far_logs(m, inverse, log, far, max_norm, roots)
    return log


def _set_far_logs(
    m: Array, inverse: Array, log: Array, far: Integers, max_norm: float, roots: int
) -> None:
    """Fill in the logarithms of the matrices ``far`` from the identity, NaN where none is real.

    By square roots, which lose digits in proportion to the squared condition number, and to the
    inverse square of the distance from half a turn; where that is much, by deflation.
    """
    some = m[:, :, far]
    size = np.einsum("ijk,ijk->k", some, some) * np.einsum(
        "ijk,ijk->k", inverse[:, :, far], inverse[:, :, far]
    )
    by_roots = _far_from_negative(some) & (size < MAX_CONDITION**2) & (roots > 0)
    rooted = far[by_roots]
    if rooted.size:
        root = _square_root(m[:, :, rooted])
        log[:, :, rooted] = 2.0 * _log(root, 0.5 * max_norm, roots - 1)
    rest = far[~by_roots & np.isfinite(some).all(axis=(0, 1))]
    if rest.size:
        log[:, :, rest] = _log_by_deflation(m[:, :, rest].astype(np.float64))


def _log_by_deflation(m: Floats) -> Floats:
    """The logarithms of ``m`` (3, 3, n) by one step of the Schur decomposition.

    A real 3 x 3 matrix has a real eigenvalue z with a left eigenvector q. In an orthonormal basis
    that ends with q, M = [A b; 0 z], and log M = ln z I + log [A/z b/z; 0 1], an affine map.
    """
    stack = np.moveaxis(m, 2, 0)
    values, vectors = np.linalg.eig(np.swapaxes(stack, 1, 2))
    usable = (values.imag == 0) & (values.real > 0)
    best = np.argmax(np.where(usable, values.real, -np.inf), axis=1)
    row = np.arange(len(stack))
    z, q = values.real[row, best], vectors.real[row, :, best]
    exists = usable[row, best]
    z = np.where(exists, z, 1.0)
    basis = np.concatenate([tangent_basis(q), q[:, :, None]], axis=2)
    triangular = np.swapaxes(basis, 1, 2) @ stack @ basis / z[:, None, None]
    logs = np.zeros_like(stack)
    affine = affine_logarithm(np.moveaxis(triangular, 0, 2)[:2])
    logs[:, :2] = np.moveaxis(affine, 2, 0)
    log_z = np.where(exists, np.log(z), np.nan)
    out: Floats = np.moveaxis(basis @ logs @ np.swapaxes(basis, 1, 2), 0, 2)
    _add_to_diagonal(out, log_z)
    return out


@cache
def _nodes(count: int) -> list[tuple[float, float]]:
    """(1 - t^2) / 2 and the weights at the positive ones of 2 ``count`` Gauss-Legendre nodes t."""
    symmetric = [(2.0 * t - 1.0, 2.0 * w) for t, w in gauss_legendre(2 * count)]
    return [(0.5 * (1.0 - t * t), w) for t, w in symmetric if t > 0]


def _adjugate(m: Array) -> Array:
    """The adjugates of ``m`` (3, 3, n), which are the inverses where the determinant is 1."""
    out = np.empty_like(m)
    for i in range(3):
        for j in range(3):
            r, s, t, u = (i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3
            np.multiply(m[r, t], m[s, u], out=out[j, i])
            out[j, i] -= m[r, u] * m[s, t]
    return out


def _add_to_diagonal(m: Array, numbers: Array) -> None:
    """Add ``numbers`` [...] times the identity to ``m`` (3, 3, ...), in place."""
    for i in range(3):
        m[i, i] += numbers


def _product(a: Array, b: Array) -> Array:
    """The matrix products of ``a`` and ``b`` (3, 3, ...)."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), dtype=np.result_type(a, b))
    part = np.empty(out.shape[2:], dtype=out.dtype)
    for i in range(3):
        for j in range(3):
            total = np.multiply(a[i, 0], b[0, j], out=out[i, j, ...])
            total += np.multiply(a[i, 1], b[1, j], out=part)
            total += np.multiply(a[i, 2], b[2, j], out=part)
    return out


def _invariants(m: Array) -> tuple[Array, Array, Array]:
    """The coefficients of the characteristic polynomial: trace, principal minors, determinant."""
    a = m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]
    b = m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0]
    c = m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0]
    minors = a + m[0, 0] * m[2, 2] - m[0, 2] * m[2, 0] + m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    return m[0, 0] + m[1, 1] + m[2, 2], minors, m[0, 0] * a - m[0, 1] * b + m[0, 2] * c


def _far_from_negative(m: Array) -> npt.NDArray[np.bool_]:
    """Whether no eigenvalue is real and <= 0, nor nearly so.

    -x is an eigenvalue when x^3 + a x^2 + b x + d = 0, with a the trace, b the sum of the principal
    minors, d the determinant; for d > 0 the cubic has no root x > 0 unless its minimum is <= 0.
    """
    a, b, d = _invariants(m)
    discriminant = a * a - 3.0 * b
    x = (np.sqrt(np.maximum(discriminant, 0.0)) - a) / 3.0
    size = ((x + np.abs(a)) * x + np.abs(b)) * x + d
    dips = (discriminant >= 0) & (x > 0) & (((x + a) * x + b) * x + d <= MARGIN * size)
    return np.asarray(np.isfinite(a) & np.isfinite(b) & (d > 0) & ~dips)


def _square_root(m: Array) -> Array:
    """Principal square roots, polynomials in M by Cayley-Hamilton (Hoger and Carlson, 1984).

    With r_i the roots of the eigenvalues, s = r1 + r2 + r3 is the largest solution of
    (s^2 - a)^2 = 4 b + 8 d s, where a, b, d^2 are the invariants of M: the other solutions have two
    signs changed. Newton's iteration from above decreases monotonically to it.
    """
    a, b, determinant = _invariants(m)
    d = np.sqrt(determinant)
    s = np.sqrt(3.0 * np.sqrt(3.0 * np.sum(m * m, axis=(0, 1)))).astype(m.dtype)
    tolerance = 0.1 * float(np.sqrt(np.finfo(m.dtype).eps))
    for _ in range(MAX_NEWTON_STEPS):
        gap = s * s - a
        decrease = (gap * gap - 8.0 * d * s - 4.0 * b) / (4.0 * s * gap - 8.0 * d)
        s -= decrease
        # the remaining error is of the order of the square of the last step
        if not np.any(np.abs(decrease) > tolerance * s):
            break
    q = 0.5 * (s * s - a)
    over = 1.0 / (s * q - d)
    root = (over * (s * s - q)) * m
    root -= over * _product(m, m)
    _add_to_diagonal(root, over * (s * d))
    return np.asarray(root)


def _log_near_identity(m: Array, inverse: Array, a: Array, b: Array, nodes: int) -> Array:
    """log M from M, its ``inverse``, their traces ``a`` and ``b``, by a quadrature.

    With sinh log M = (M - M^-1) / 2 and cosh log M = (M + M^-1) / 2 = I + E, log M is the integral
    over t from 0 to 1 of sinh log M (I + (1 - t^2) E / 2)^-1 dt. The inverse is even in log M, so
    half as many nodes are needed as for an integral over M alone, in a wider region. By
    Cayley-Hamilton (M^2 = a M - b I + M^-1) the integrand is p M - q M^-1 + r I, with p and q
    rational in the traces, and r such that the trace is zero.
    """
    x, y = a - 1.0, b - 1.0
    total, product = x + y, x * y
    square = total * total
    plain, own, other = np.zeros_like(a), np.zeros_like(a), np.zeros_like(a)
    for u, w in _nodes(nodes):
        v, rest = 0.5 * u, 1.0 - u
        g = v * v / rest
        over = (v * g) * square
        over += v * total
        over += (v * v - 2.0 * v * g) * product
        over += rest
        np.divide(0.5 * w, over, out=over)
        plain += over
        own += v * over
        over *= 2.0 * g
        other += over
    p, q = plain + own * y + other * x, plain + own * x + other * y
    log = p * m
    log -= q * inverse
    _add_to_diagonal(log, (q * b - p * a) / 3.0)
    return log
