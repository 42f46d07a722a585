"""The Grassmann manifold G(N, k): the k-dimensional subspaces of R^N (section 4.1 of the paper)."""

from __future__ import annotations

from functools import lru_cache
from math import factorial

import numpy as np
import numpy.typing as npt

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold, parse_integers
from mssegment.manifolds.matrices import halvings_to
from mssegment.manifolds.prepared import (
    Array,
    LogPreparedPoints,
    PreparedPoints,
    precision,
)
from mssegment.manifolds.projectors import ProjectorPoints, normal_part
from mssegment.manifolds.sphere import UnitVectorPoints
from mssegment.records import Floats

_TINY = 1e-300
METRICS = ("chordal", "geodesic")
MAX_SERIES = 4.0
"""For longer tangents the series of the exponential loses digits to its doublings, and the SVD is
used."""

Mask = npt.NDArray[np.bool_]


class Grassmann(Manifold):
    """G(N, k), the k-dimensional subspaces of R^N.

    A point is an orthonormal basis, an N x k matrix x with x'x = I; x and x q, q orthogonal, are
    the same subspace. The exponential is (15). The distance is (12), which the paper calls arc
    length; it is the chordal distance |xx' - yy'|_F / sqrt 2, the norm of the sines of the
    principal angles: a metric, but shorter than the geodesic. ``neg_half_grad_sq_dist`` is the
    exact gradient of its square. With the metric ``geodesic`` the distance is the norm of the
    angles, and its gradient the logarithm, which takes an SVD for each pair unless k = 1.

    Parameters
    ----------
    n
        N, the dimension of the space.
    k
        The dimension of the subspaces, 1 <= k < N.
    metric
        ``chordal`` or ``geodesic``.

    Raises
    ------
    ConfigurationError
        For other dimensions.

    References
    ----------
    A. Edelman, T. Arias and S. Smith, "The geometry of algorithms with orthogonality constraints",
    SIAM J. Matrix Anal. Appl. 20, 1998.

    Examples
    --------
    >>> import numpy as np
    >>> lines = Grassmann(3, 1)
    >>> x, y = np.array([[0.0], [0.0], [1.0]]), np.array([[0.0], [0.6], [0.8]])
    >>> lines.dist(x, y).round(3).item(), lines.dist(x, -y).round(3).item()
    (0.6, 0.6)
    >>> lines.dist(lines.exp(x, lines.log(x, y)), y).round(6).item()
    0.0
    """

    examples = (
        "grassmann(3,1)",
        "grassmann(4,2)",
        "grassmann(10,3)",
        "grassmann(13,4)",
        "grassmann(3,1,geodesic)",
        "grassmann(5,2,geodesic)",
    )
    basis_free = True
    is_compact = True

    def __init__(self, n: int, k: int, metric: str = "chordal") -> None:
        if not 1 <= k < n:
            raise ConfigurationError(f"grassmann({n},{k}) is no manifold: use 1 <= k < N")
        if metric not in METRICS:
            raise ConfigurationError(
                f"the metrics of grassmann are {' and '.join(METRICS)}, found {metric!r}"
            )
        self.n, self.k, self.metric = n, k, metric
        self.dist_is_geodesic = metric == "geodesic"

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Grassmann:
        """G(N, k) from ``(N, k)`` or ``(N, k, metric)``."""
        named = arguments[2:] in [(name,) for name in METRICS]
        n, k = parse_integers("grassmann", arguments[:2] if named else arguments, "N,k")
        return cls(n, k, arguments[2] if named else METRICS[0])

    @classmethod
    def from_shape(cls, shape: tuple[int, ...]) -> Grassmann:
        """G(N, k) for bases of this shape."""
        n, k = cls.expect_axes("grassmann", shape, 2)
        return cls(n, k)

    @property
    def name(self) -> str:
        """``grassmann(N,k)`` or ``grassmann(N,k,geodesic)``."""
        metric = ",geodesic" if self.dist_is_geodesic else ""
        return f"grassmann({self.n},{self.k}{metric})"

    @property
    def dim(self) -> int:
        """The dimension, k (N - k)."""
        return self.k * (self.n - self.k)

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, ``(N, k)``."""
        return (self.n, self.k)

    @property
    def floats_per_prepared_point(self) -> int:
        """N (N + 1): two copies of the upper triangle of the projector."""
        return self.n * (self.n + 1)

    def exp(self, x: Floats, v: Floats) -> Floats:
        """Equation (15) without its SVD: x cos(sqrt G) + v sinc(sqrt G) with G = v'v.

        Both are entire functions of the k x k matrix G, computed by their series. The result is
        made orthonormal: where x'x is I + E, a shift at x is not orthogonal to x, and a step of c
        shifts would leave (1 - 2 c) E.
        """
        if self.k == 1:
            length = np.sqrt(_t(v) @ v)
            moved = x * np.cos(length) + v * (np.sin(length) / np.maximum(length, _TINY))
            return np.asarray(moved / np.sqrt(_t(moved) @ moved))
        gram = _gram(v)
        long = np.einsum("...ii->...", gram) > MAX_SERIES**2
        if np.any(long):
            wide, tall = np.broadcast_arrays(x, v)
            return _orthonormal(_exp_by_svd(wide, tall, long))
        cosine, sinc = _cos_sinc(gram)
        moved = x @ cosine
        moved += v @ sinc
        return _orthonormal(moved)

    def log(self, x: Floats, y: Floats) -> Floats:
        """The geodesic logarithm, by the SVD of y'x.

        Where a principal angle is pi/2 the shortest geodesic is not unique, and one is returned.
        """
        q, cosines, r = np.linalg.svd(_t(y) @ x)
        normal = normal_part(x, y) @ q
        sines = np.linalg.norm(normal, axis=-2)
        angles = np.arctan2(sines, cosines)
        factors = np.where(sines > 1e-12, angles / np.maximum(sines, _TINY), 1.0)
        return np.asarray((normal * factors[..., None, :]) @ r)

    def principal_angles(self, x: Floats, y: Floats) -> Floats:
        """The k principal angles between two subspaces, in radians, smallest first.

        From sines and cosines, which is accurate for small angles too (Bjorck and Golub, 1973).

        Parameters
        ----------
        x, y
            Points [..., N, k].

        Returns
        -------
        array
            The angles [..., k], between 0 and pi/2.

        Examples
        --------
        >>> import numpy as np
        >>> planes = Grassmann(4, 2)
        >>> x, y = np.eye(4)[:, :2], np.eye(4)[:, [0, 2]]
        >>> planes.principal_angles(x, y).round(3).tolist()
        [0.0, 1.571]
        """
        cosines = np.linalg.svd(_t(y) @ x, compute_uv=False)
        sines = np.linalg.svd(normal_part(x, y), compute_uv=False)[..., ::-1]
        return np.asarray(np.arctan2(sines, cosines))

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The inner product tr(u'v)."""
        return np.asarray(np.einsum("...ij,...ij->...", u, v))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """Equation (12), d^2 = k - tr(x' y y' x), as |(I - xx') y|_F to avoid cancellation; or the
        norm of the principal angles.
        """
        if self.dist_is_geodesic:
            return np.asarray(np.linalg.norm(self.principal_angles(x, y), axis=-1))
        return np.asarray(np.linalg.norm(normal_part(x, y), axis=(-2, -1)))

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """(I - xx') y y' x, that is -1/2 grad d^2.

        Equation (13) omits the factor 2 of the derivative of a square; so (14) is the mean shift
        step (9), exactly. The logarithm where the metric is geodesic.
        """
        if self.dist_is_geodesic:
            return self.log(x, y)
        return normal_part(x, y @ (_t(y) @ x))

    def project(self, x: Floats) -> Floats:
        """An orthonormal basis of the column space of ``x``, the one nearest to ``x``."""
        self.check_finite(x)
        u, _, v = np.linalg.svd(x, full_matrices=False)
        return np.asarray(u @ v)

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """(I - xx') v.

        Of the Jacobian of a function at ``x`` this is the gradient (11).
        """
        return normal_part(x, v)

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Uniformly distributed subspaces [size, N, k]."""
        return np.linalg.qr(rng.standard_normal((size, self.n, self.k)))[0]

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest entry of |x'x - I|."""
        return np.asarray(np.max(np.abs(_t(x) @ x - np.eye(self.k)), axis=(-2, -1)))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, N, k] as projectors, of which d^2 is a dot product; no cutoff."""
        dtype = precision(precise, self.k, bandwidth)
        if self.dist_is_geodesic and self.k == 1 and dtype is not None:
            return UnitVectorPoints(self, y, bandwidth, dtype, antipodal=True)
        if dtype is None or self.dist_is_geodesic:
            return LogPreparedPoints(self, y, bandwidth)
        return ProjectorPoints(self, y, bandwidth, dtype)


def _t(x: Array) -> Array:
    return x.swapaxes(-1, -2)


@lru_cache(maxsize=16)
def _identity(k: int) -> Floats:
    return np.eye(k)


def _gram(v: Floats) -> Floats:
    """v'v; the copy makes NumPy call gemm: syrk is slower for small matrices."""
    return np.asarray(_t(v).copy() @ v)


def _orthonormal(x: Floats) -> Floats:
    """Bases whose x'x = I + E with E far below 1, made orthonormal to 3/4 E^2 (Newton-Schulz)."""
    return np.asarray(x @ (1.5 * _identity(x.shape[-1]) - 0.5 * _gram(x)))


def _exp_by_svd(x: Floats, v: Floats, long: Mask) -> Floats:
    """Equation (15) with its SVD for the ``long`` tangents [...], and the series for the others."""
    cosine, sinc = _cos_sinc(_gram(np.where(long[..., None, None], 0.0, v)))
    moved = np.array(x @ cosine + v @ sinc)
    u, s, r = np.linalg.svd(v[long], full_matrices=False)
    turned = (x[long] @ _t(r)) * np.cos(s)[..., None, :] + u * np.sin(s)[..., None, :]
    moved[long] = turned @ r
    return moved


def _cos_sinc(gram: Floats) -> tuple[Floats, Floats]:
    """cos(sqrt G) and sinc(sqrt G) of symmetric k x k matrices, |G| halved until it is below 1.

    Each series is a low half plus G^4 times a high half, which share the powers of G. Each matrix
    has its own number of halvings, so that it does not depend on the others.
    """
    trace = np.einsum("...ii->...", gram)
    short = bool(trace.max(initial=0.0) < SHORT_SERIES_BELOW)
    halvings = None if short else halvings_to(trace, 1.0)
    if halvings is not None:
        gram = gram * np.ldexp(1.0, -2 * halvings)[..., None, None]
    powers = np.empty((5, *gram.shape))
    powers[0] = _identity(gram.shape[-1])
    powers[1] = gram
    np.matmul(gram, gram, out=powers[2])
    np.matmul(powers[2], gram, out=powers[3])
    np.matmul(powers[2], powers[2], out=powers[4])
    flat = powers.reshape(5, -1)
    if halvings is None:
        cosine, sinc = (_SHORT_SERIES @ flat).reshape(2, *gram.shape)
        return cosine, sinc
    low, high = (_SERIES @ flat).reshape(2, 2, *gram.shape)
    cosine, sinc = low + powers[4] @ high
    for level in range(int(halvings.max(initial=0))):
        rows = halvings > level
        sinc[rows] = sinc[rows] @ cosine[rows]
        cosine[rows] = 2.0 * cosine[rows] @ cosine[rows] - _identity(gram.shape[-1])
    return cosine, sinc


def _coefficients(power: int) -> tuple[float, float]:
    """The coefficients of G^power in cos(sqrt G) and in sinc(sqrt G)."""
    sign = (-1.0) ** power
    return sign / factorial(2 * power), sign / factorial(2 * power + 1)


def _series() -> Floats:
    """Rows: low halves of cos and sinc, high halves of both; omitted terms are below 1e-16."""
    table = np.zeros((2, 2, 5))
    for power in range(9):
        half, column = (0, power) if power < 4 else (1, power - 4)
        table[half, :, column] = _coefficients(power)
    return table.reshape(4, 5)


_SERIES = _series()
_SHORT_SERIES = np.array([_coefficients(power) for power in range(5)]).T.copy()
SHORT_SERIES_BELOW = 0.01
"""For a smaller |G| the series end at G^4: the next term is below 1e-16."""
