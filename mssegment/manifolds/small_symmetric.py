"""Logarithms of symmetric 2 x 2 and 3 x 3 matrices in closed form, for many at a time.

LAPACK takes 1 to 2 microseconds for each such matrix. Here a matrix is the row of its entries on
and above the diagonal, the entries of all matrices are arrays, and a logarithm needs no
eigenvectors: it is the polynomial of the matrix that agrees with ln at the eigenvalues.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.manifolds.symmetric import eigenvalues
from mssegment.records import Floats

Mask = npt.NDArray[np.bool_]

CLOSE = 1e-5
"""Eigenvalues that differ relatively by less: there a Taylor polynomial is exact to rounding."""
FAR = 1e-6
"""Smallest by largest eigenvalue below which the smallest is left to LAPACK."""


def entries(n: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Rows and columns of the entries of an n x n matrix: the diagonal, then those above it."""
    above = [(i, j) for i in range(n) for j in range(i + 1, n)]
    pairs = [(i, i) for i in range(n)] + above
    return tuple(i for i, _ in pairs), tuple(j for _, j in pairs)


def to_entries(x: Floats) -> Floats:
    """The entries [n (n + 1) / 2, ...] of symmetric matrices [..., n, n]."""
    rows, columns = entries(x.shape[-1])
    return np.stack([x[..., i, j] for i, j in zip(rows, columns, strict=True)])


def from_entries(e: Floats, n: int) -> Floats:
    """The inverse of ``to_entries``: matrices [..., n, n]."""
    out = np.empty((*e.shape[1:], n, n))
    for value, i, j in zip(e, *entries(n), strict=True):
        out[..., i, j] = out[..., j, i] = value
    return out


def congruence(r: Floats) -> Floats:
    """The matrices [..., k, k] that take the entries of y to those of r y r, r symmetric."""
    rows, columns = map(np.array, entries(r.shape[-1]))
    first = r[..., rows[:, None], rows] * r[..., columns[:, None], columns]
    second = r[..., rows[:, None], columns] * r[..., columns[:, None], rows]
    return np.asarray(first + np.where(rows == columns, 0.0, second))


class EntrywiseLogs:
    """Eigenvalues and logarithms of positive definite matrices.

    Parameters
    ----------
    e
        Entries [k, ...] of matrices of 2 or 3 rows, k = 3 or 6.

    Attributes
    ----------
    sq_norm
        The squared Frobenius norms of the logarithms [...]: the sums of the squared logarithms of
        the eigenvalues. Infinite where a matrix is not finite or not positive definite.

    Notes
    -----
    The eigenvalues of 3 x 3 matrices are those of O. K. Smith, "Eigenvalues of a symmetric 3 x 3
    matrix", Comm. ACM 4, 1961. An error there of the root of the rounding, where two are nearly
    equal, is opposite for the two, and cancels in both norms and logarithms. The logarithm is
    Newton's interpolation polynomial in the deviation from the mean eigenvalue (N. J. Higham,
    Functions of Matrices, 2008, section 1.2.2).
    """

    def __init__(self, e: Floats) -> None:
        self._n = 2 if len(e) == 3 else 3
        self._deviation = d = e.copy()
        with np.errstate(over="ignore", invalid="ignore"):
            self._mean = np.asarray(e[: self._n].mean(axis=0))
            d[: self._n] -= self._mean
            self._roots = _roots_of_2(d) if self._n == 2 else _roots_of_3(d)
            lost = ~(self._mean + self._roots[0] >= FAR * (self._mean + self._roots[-1]))
        missing = self._from_lapack(e, lost) if lost.any() else lost
        self._logs = np.log(self._mean + self._roots)
        self.sq_norm = np.sum(self._logs**2, axis=0)
        self.sq_norm[missing] = np.inf

    def _from_lapack(self, e: Floats, lost: Mask) -> Mask:
        """Correct the eigenvalues where they are ``lost``; the mask of those without logarithm.

        These are taken for the identity.
        """
        values = eigenvalues(from_entries(e[:, lost], self._n)).T
        exist = values[0] > 0
        missing = lost.copy()
        missing[lost] = ~exist
        self._mean[missing], self._deviation[:, missing] = 1.0, 0.0
        self._roots[:, lost] = np.where(exist, values - self._mean[lost], 0.0)
        return missing

    def weighted_sum(self, weights: Floats) -> Floats:
        """The sums of ``weights`` [m, n] times the logarithms of [m, n] matrices [m, k, k]."""
        constant, linear, square = self._polynomial()
        d, n = self._deviation, self._n
        total = np.einsum("kmn,mn->km", d, weights * linear)
        total[:n] += np.einsum("mn,mn->m", weights, constant)
        if square is not None:
            squares = weights * square
            for k, (i, j) in enumerate(zip(*entries(n), strict=True)):
                rows = (_entry(i, a) for a in range(n))
                columns = (_entry(a, j) for a in range(n))
                for left, right in zip(rows, columns, strict=True):
                    total[k] += np.einsum("mn,mn,mn->m", d[left], d[right], squares)
        return from_entries(total, n)

    def _polynomial(self) -> tuple[Floats, Floats, Floats | None]:
        """c0, c1 and c2 of ln(x) = c0 + c1 d + c2 d^2, d = x - mean."""
        a, b, c = self._roots[0], self._roots[-2], self._roots[-1]
        if self._n == 2:
            slope = _slope(self._logs[0], self._logs[1], a, c, self._mean)
            return self._logs[0] - slope * a, slope, None
        first = _slope(self._logs[0], self._logs[1], a, b, self._mean)
        second = _slope(self._logs[1], self._logs[2], b, c, self._mean)
        near = c - a < CLOSE * self._mean
        curve = (second - first) / np.where(near, 1.0, c - a)
        curve = np.where(near, -0.5 / self._mean**2, curve)
        return self._logs[0] - first * a + curve * a * b, first - curve * (a + b), curve


def _entry(i: int, j: int) -> int:
    """The place of the entry (i, j) of a 3 x 3 matrix among the six."""
    return i if i == j else i + j + 2


def _slope(log_a: Floats, log_b: Floats, a: Floats, b: Floats, mean: Floats) -> Floats:
    """The divided difference of ln at mean + a and mean + b, a <= b."""
    near = b - a < CLOSE * (mean + a)
    middle = mean + 0.5 * (a + b)
    quotient = (log_b - log_a) / np.where(near, 1.0, b - a)
    series = (1.0 + ((b - a) / middle) ** 2 / 12.0) / middle
    return np.where(near, series, quotient)


def _roots_of_2(d: Floats) -> Floats:
    """The eigenvalues [2, ...] of traceless 2 x 2 matrices given by entries, ascending."""
    half = np.hypot(0.5 * (d[0] - d[1]), d[2])
    return np.stack([-half, half])


def _roots_of_3(d: Floats) -> Floats:
    """The eigenvalues [3, ...] of traceless 3 x 3 matrices given by entries, ascending."""
    x, y, z, xy, xz, yz = d
    size = np.sqrt((x * x + y * y + z * z + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    determinant = x * (y * z - yz * yz) - xy * (xy * z - yz * xz) + xz * (xy * yz - y * xz)
    cubed = size**3
    cosine = np.divide(0.5 * determinant, cubed, out=np.zeros_like(size), where=cubed > 0)
    angle = np.arccos(np.clip(cosine, -1.0, 1.0)) / 3.0
    largest = 2.0 * size * np.cos(angle)
    smallest = 2.0 * size * np.cos(angle + 2.0 * np.pi / 3.0)
    return np.stack([smallest, -largest - smallest, largest])
