"""The affine group A(2): the maps x -> A x + b of the plane, det A > 0 (section 5.5, (26)).

The logarithm of such matrices has a closed form, :func:`affine_logarithm`, evaluated entry by entry
over whole arrays. A function of a 2 x 2 matrix A = s I + N, with N^2 = c I (s half the trace, c the
discriminant; the eigenvalues are s +- sqrt c), is p I + q N: p is the mean of the function over the
two eigenvalues, q its divided difference. The logarithm of [A b; 0 1] is [L v; 0 0] with
L = (A - I) phi(A) and v = phi(A) b, phi(z) = ln z / (z - 1), and needs one pair (p, q).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

from mssegment.errors import ConfigurationError
from mssegment.manifolds.matrices import exponential, gauss_legendre
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import Array
from mssegment.records import Floats

_RADII = (0.1, 0.25)
_NODES = {np.dtype(np.float64): (5, 7, 12), np.dtype(np.float32): (2, 3, 6)}
"""Quadrature nodes for eigenvalues within each radius of 1, and beyond: the integral of phi is then
good to 1e-15 in double and about 1e-6 in single precision."""

_TINY = 1e-300
_SPLIT = 2.0**27 + 1.0
ILL_CONDITIONED = 0.01
"""The ratio of det A to its mean eigenvalue squared below which the smaller eigenvalue is computed
from the determinant."""
HALF_TURN_ROUNDING = 64.0
"""A is taken for -r I, half a turn, where its entries are that but for this many units of rounding:
those of a product x^-1 y of well-conditioned matrices."""

Mask = npt.NDArray[np.bool_]


class AffineGroup(MatrixGroup):
    """A(2): the affine maps of the plane that keep the orientation, dimension 6.

    Points are 3 x 3 matrices [A b; 0 1] with det A > 0.

    Parameters
    ----------
    n
        The dimension of the space, 2.
    exact
        Whether ``neg_half_grad_sq_dist`` is the exact gradient instead of (21).
    length_scale
        The length, in the unit of b, that weighs as much as a change of A by 1.

    Raises
    ------
    ConfigurationError
        For another dimension.

    Examples
    --------
    >>> import numpy as np
    >>> group = AffineGroup(2)
    >>> shift = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 4.0], [0.0, 0.0, 1.0]])
    >>> group.dist(np.eye(3), shift).round(6).item()
    5.0
    >>> AffineGroup(2, exact=True).name
    'affine(2,exact)'
    """

    examples = ("affine(2)", "affine(2,exact)")
    family = "affine"
    order = 2
    free_rows = 2
    size = 3

    def __init__(self, n: int = 2, *, exact: bool = False, length_scale: float = 1.0) -> None:
        if n != self.order:
            raise ConfigurationError(f"affine({n}) is not implemented: use affine(2)")
        super().__init__(exact=exact, length_scale=length_scale)

    @property
    def dim(self) -> int:
        """The dimension, 6."""
        return 6

    def algebra_log(self, m: Array, max_norm: float = np.inf) -> Array:
        """The logarithm by :func:`affine_logarithm`."""
        return affine_logarithm(m)

    def algebra_exp(self, v: Floats) -> Floats:
        """The exponential; linear in the translation, which is brought to length 1 for it."""
        length = np.linalg.norm(v[..., :2, 2], axis=-1)[..., None]
        unit = np.array(v)
        unit[..., :2, 2] /= np.where(length > 0, length, 1.0)
        out = exponential(unit)
        out[..., :2, 2] *= length
        return out

    def onto_algebra(self, v: Array) -> Array:
        """``v`` itself: every 2 x 3 matrix is in the algebra."""
        return v

    def project(self, x: Floats) -> Floats:
        """``x`` with the last row replaced by 0 0 1; there is none near where det A <= 0."""
        self.check_finite(x)
        projected = np.array(x, dtype=np.float64)
        projected[..., 2, :] = (0.0, 0.0, 1.0)
        self._refuse(~(_orientation(x) > 0), "det A is not positive")
        return projected

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest error of an entry of the last row, 0 0 1; infinite where det A <= 0."""
        error = np.max(np.abs(x[..., 2, :] - np.array([0.0, 0.0, 1.0])), axis=-1)
        return np.where(_orientation(x) > 0, error, np.inf)


def _orientation(x: Floats) -> Floats:
    """The determinant of A relative to its largest entry, which may be very large or small."""
    a = x[..., :2, :2] / np.maximum(np.abs(x[..., :2, :2]).max(axis=(-2, -1), keepdims=True), _TINY)
    return np.asarray(a[..., 0, 0] * a[..., 1, 1] - a[..., 0, 1] * a[..., 1, 0])


def affine_logarithm(m: Array) -> Array:
    """The principal logarithm of affine maps of the plane.

    Parameters
    ----------
    m
        The first two rows of the matrices [A b; 0 1], matrix axes first (2, 3, ...).

    Returns
    -------
    array
        The first two rows of the logarithms (2, 3, ...); the last one is zero. NaN where no
        logarithm is real: an eigenvalue of A is zero, or real and negative, unless A = -r I.
    """
    e = np.array(m).reshape(2, 3, int(np.prod(np.shape(m)[2:])))
    e[0, 0] -= 1.0
    e[1, 1] -= 1.0
    with np.errstate(all="ignore"):  # without a real logarithm the result is NaN
        log = _times(e, *_phi(*_split(e)))
        _set_half_turns(e, log)
        _set_ill_conditioned(np.asarray(m).reshape(e.shape), log)
        return log.reshape(np.shape(m))


def _set_ill_conditioned(m: Array, log: Array) -> None:
    """The logarithm where the eigenvalues of A are positive and of very different size.

    The smaller one is det A over the larger one, with the determinant free of cancellation.
    """
    middle = 0.5 * (m[0, 0] + m[1, 1])
    rough = m[0, 0] * m[1, 1] - m[0, 1] * m[1, 0]
    (some,) = np.nonzero((middle > 0) & (np.abs(rough) < ILL_CONDITIONED * middle * middle))
    if not some.size:
        return
    a, middle = m[:, :, some].astype(np.float64), middle[some].astype(np.float64)
    determinant = _difference_of_products(a[0, 0], a[1, 1], a[0, 1], a[1, 0])
    root = np.sqrt(middle * middle - determinant)
    larger = middle + root
    smaller = determinant / larger
    valid = determinant > 0
    n = a[:, :2].copy()
    n[0, 0] = 0.5 * (a[0, 0] - a[1, 1])
    n[1, 1] = -n[0, 0]
    for values, target in (
        ((np.log(larger), np.log(smaller)), None),
        ((_log_ratio(larger), _log_ratio(smaller)), a[:, 2]),
    ):
        p, q = 0.5 * (values[0] + values[1]), 0.5 * (values[0] - values[1]) / root
        function = q * n
        function[0, 0] += p
        function[1, 1] += p
        function[:, :, ~valid] = np.nan
        if target is None:
            log[:, :2, some] = function
        else:
            log[:, 2, some] = np.einsum("ijk,jk->ik", function, target)


def _log_ratio(z: Array) -> Array:
    """ln z / (z - 1), 1 at 1."""
    return np.where(np.abs(z - 1.0) < 0.5, _log1p_ratio(z - 1.0), np.log(z) / (z - 1.0))


def _difference_of_products(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """a b - c d with the rounding errors of both products (Dekker, 1971)."""
    first, second = a * b, c * d
    return np.asarray(
        (first - second) + (_product_error(a, b, first) - _product_error(c, d, second))
    )


def _product_error(a: Floats, b: Floats, product: Floats) -> Floats:
    """a b - ``product`` in double precision, by splitting both factors into halves."""
    a_high, b_high = a * _SPLIT, b * _SPLIT
    a_high, b_high = a_high - (a_high - a), b_high - (b_high - b)
    a_low, b_low = a - a_high, b - b_high
    return np.asarray(
        ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    )


def _set_half_turns(e: Array, log: Array) -> None:
    """The logarithm ln r I + pi J, J = [0 -1; 1 0], where A = -r I but for rounding errors.

    Their real logarithms are ln r I + pi P J P^-1 for any P, of which this is a shortest one, and
    the limit of those of similarities. The translation is phi(A) b with ln A / (A - I), A = -r I.
    """
    middle = 1.0 + 0.5 * (e[0, 0] + e[1, 1])
    apart = np.maximum(np.abs(e[0, 1]), np.abs(e[1, 0]))
    np.maximum(apart, np.abs(0.5 * (e[0, 0] - e[1, 1])), out=apart)
    tolerance = HALF_TURN_ROUNDING * float(np.finfo(e.dtype).eps)
    (half,) = np.nonzero((middle < 0) & (apart <= tolerance * np.abs(middle)))
    if not half.size:
        return
    size, shift = np.log(-middle[half]), 1.0 / (middle[half] - 1.0)
    angle = np.copysign(np.pi, e[1, 0, half] - e[0, 1, half]).astype(e.dtype)
    b0, b1 = e[0, 2, half] * shift, e[1, 2, half] * shift
    log[0, 0, half] = log[1, 1, half] = size
    log[1, 0, half], log[0, 1, half] = angle, -angle
    log[0, 2, half] = size * b0 - angle * b1
    log[1, 2, half] = angle * b0 + size * b1


def _split(e: Array) -> tuple[Array, Array]:
    """s and c of the left 2 x 2 block of ``e`` (2, 3, ...)."""
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
    follows from the logarithm or, where one eigenvalue is near 1, from the two eigenvalues.
    """
    radius = np.sqrt(np.abs(c))
    radius += np.abs(s)
    near = radius < (0.5 if s.dtype == np.float64 else 0.9)
    if near.all():
        return _phi_near(s, c, float(radius.max(initial=0.0)))
    if 2 * np.count_nonzero(near) > near.size:
        p, q = _phi_near(s, c)
        _fill(~near, _phi_far, s, c, p, q)
    else:
        p, q = _phi_far(s, c)
        _fill(near, _phi_near, s, c, p, q)
    undefined = ~(((1.0 + s) ** 2 > c) & ((c < 0) | (s > -1.0)))
    p[undefined] = np.nan
    return p, q


def _phi_near(s: Array, c: Array, radius: float = 1.0) -> tuple[Array, Array]:
    """p and q of phi by a quadrature, for eigenvalues within ``radius`` of 1."""
    nodes = _NODES[s.dtype][sum(radius >= bound for bound in _RADII)]
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
    """p and q of phi from the logarithm, over det(A - I) = s^2 - c, where that is not near 0."""
    root = np.sqrt(np.abs(c))
    middle, determinant = 1.0 + s, s * s - c
    ell = 0.5 * np.log(middle * middle - c)
    real = 0.5 * np.log((middle + root) / (middle - root))
    g = np.where(c > 0, real, np.arctan2(root, middle)) / root
    close = (np.abs(c) < 0.04 * middle * middle) & (middle > 0)
    g[close] = _atanh_ratio(c[close] / middle[close] ** 2) / middle[close]
    p, q = (ell * s - g * c) / determinant, (g * s - ell) / determinant
    one_near_1 = (c > 0) & (middle > root) & (np.abs(determinant) < 1e-2 * (1 + s * s))
    _fill(one_near_1, _phi_by_eigenvalue, s, c, p, q)
    return p, q


def _atanh_ratio(x: Array) -> Array:
    """atanh(sqrt x) / sqrt x by its series, for |x| < 0.04: eigenvalues that nearly coincide."""
    total = np.zeros_like(x)
    for i in range(11, -1, -1):
        total = total * x + 1.0 / (2 * i + 1)
    return total


def _phi_by_eigenvalue(s: Array, c: Array) -> tuple[Array, Array]:
    """p and q of phi from its values at two distinct real eigenvalues."""
    root = np.sqrt(c)
    larger, smaller = _log1p_ratio(s + root), _log1p_ratio(s - root)
    return 0.5 * (larger + smaller), 0.5 * (larger - smaller) / root


def _log1p_ratio(z: Array) -> Array:
    """ln(1 + z) / z, 1 at 0."""
    return np.divide(np.log1p(z), z, out=np.ones_like(z), where=z != 0)


def _fill(
    where: Mask,
    function: Callable[[Array, Array], tuple[Array, Array]],
    s: Array,
    c: Array,
    p: Array,
    q: Array,
) -> None:
    """Overwrite ``p`` and ``q`` by those of ``function`` at ``where``."""
    if where.any():
        p[where], q[where] = function(s[where], c[where])
