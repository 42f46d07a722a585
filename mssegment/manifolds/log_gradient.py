"""The exact gradient of |log x^-1 y|^2 on a matrix group: the adjoint derivative of the logarithm.

With X = log(x^-1 y), d log(exp(-tE) exp X) / dt = -B(ad_X) E at t = 0, where B(z) = z / (e^z - 1).
So -1/2 times the gradient is B(a) X with a = ad_X*, the adjoint of ad_X in the inner product tr A'B
of the algebra: a Z is the part of [X', Z] in the algebra. Equivalently it is L(M', X) M' projected
onto the algebra, with M = exp X and L the Frechet derivative of the logarithm.

B(z) = C(z) - z / 2 with the even function C(z) = (z / 2) coth(z / 2), which satisfies
C(2z) = C(z) + z^2 / (4 C(z)). Taylor's series of C converges for |z| < 2 pi only; the doubling
continues it to wherever the logarithm is differentiable, as squaring does for the exponential.

References
----------
N. J. Higham, Functions of Matrices, SIAM 2008, sections 3.2 and 11.8.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from mssegment.manifolds.matrices import bernoulli
from mssegment.manifolds.prepared import Array
from mssegment.records import Floats

if TYPE_CHECKING:
    from mssegment.manifolds.matrix_group import MatrixGroup

SERIES_BELOW = 1.0
"""The series is used for |X| below this: |ad_X| <= sqrt 2 |X| (Boettcher and Wenzel, 2008), so that
its terms fall by a factor (sqrt 2 / 2 pi)^2 = 0.05."""
SERIES_TERMS = 26
"""Powers of a in the series: the next term is below 1e-16."""
START, START_TERMS = 0.5, 14
"""Doubling starts at a matrix of at most this norm, with this many powers of it in the series."""
HALF_TURN = 1e-10
"""A half turn: C(a) has a pair of singular values below this share of its norm, and a determinant
below the square of it, times the norm to the power of its order."""
CHUNK = 4096
"""Pairs whose matrices are doubled at a time, to bound the memory."""


def gradient_from_log(group: MatrixGroup, log: Array) -> Array:
    """-1/2 times the gradient of the squared distance, in the Lie algebra.

    Parameters
    ----------
    group
        The group, whose algebra is meant.
    log
        The logarithms X of x^-1 y (free_rows, size, ...); NaN stays NaN.

    Returns
    -------
    array
        B(a) X, of the same shape and precision.
    """
    flat = log.reshape(*log.shape[:2], -1)
    square = np.einsum("ijk,ijk->k", flat, flat, dtype=np.float64)
    far = np.flatnonzero(square >= SERIES_BELOW**2)
    if not far.size:
        return _series(group, flat).reshape(log.shape)
    total = flat.copy()
    near = np.flatnonzero(square < SERIES_BELOW**2)
    total[:, :, near] = _series(group, flat[:, :, near])
    for start in range(0, len(far), CHUNK):
        some = far[start : start + CHUNK]
        total[:, :, some] = _doubling(group, flat[:, :, some].astype(np.float64))
    return total.reshape(log.shape)


def _series(group: MatrixGroup, log: Array) -> Array:
    """B(a) X by its series, for ``log`` (free_rows, size, k) of norm below ``SERIES_BELOW``."""
    term, total = log, log.copy()
    smallest = 0.1 * float(np.finfo(log.dtype).eps)
    for i, coefficient in enumerate(bernoulli(SERIES_TERMS), start=1):
        term = adjoint(group, log, term)
        total += coefficient * term
        largest = float(np.abs(term).max(initial=0.0)) * abs(coefficient)
        if i % 2 == 0 and not largest > smallest:
            break
    return total


def adjoint(group: MatrixGroup, x: Array, z: Array) -> Array:
    """a Z: [x', z] projected onto the algebra, for ``x`` and ``z`` (free_rows, size, ...)."""
    rows, size = group.free_rows, group.size
    shape = np.broadcast_shapes(x.shape[2:], z.shape[2:])
    whole = np.zeros((size, size, *shape), dtype=np.result_type(x, z))
    for i in range(size):
        for j in range(size):
            whole[i, j] = sum(x[r, i] * z[r, j] for r in range(rows))
            if max(i, j) < rows:
                whole[i, j] -= sum(z[i, r] * x[j, r] for r in range(size))
    return group.onto_algebra(whole[:rows])


def _doubling(group: MatrixGroup, log: Floats) -> Floats:
    """B(a) X by doubling, for ``log`` (free_rows, size, k) of any norm."""
    basis, structure = _structure(group)
    coordinates = np.einsum("aij,ijk->ka", basis, log)
    a = np.einsum("ka,abc->kbc", coordinates, structure)
    norm = np.linalg.norm(a, axis=(1, 2))
    doublings = np.ceil(np.log2(np.maximum(norm / START, 1.0))).astype(np.int64)
    half = a / 2.0 ** doublings[:, None, None]
    square = half @ half
    c = _even_series(square)
    for level in range(int(doublings.max(initial=0))):
        rows = np.flatnonzero(doublings > level)
        c[rows] += _divided(square[rows] / 4.0, c[rows])
        square[rows] *= 4.0
    vector = coordinates[:, :, None]
    gradient = (c @ vector - 0.5 * (a @ vector))[:, :, 0]
    return np.asarray(np.einsum("aij,ka->ijk", basis, gradient))


def _divided(quarter: Floats, c: Floats) -> Floats:
    """C(a)^-1 a^2 / 4, for ``quarter`` = a^2 / 4 [k, d, d].

    C is zero at i pi, a half turn, where the logarithm has two values and its derivative none in
    some directions: there the pseudoinverse, which leaves those out.
    """
    angles = np.linalg.norm(quarter, axis=(1, 2)) >= 0.99 * (np.pi / 2.0) ** 2  # |z| up to |a|
    suspects = np.flatnonzero(angles)
    # the norm of all rows: about an axis of the basis those of the pair are as small as the pair
    bound = np.linalg.norm(c[suspects], axis=(1, 2)) ** c.shape[-1]
    singular = suspects[np.abs(np.linalg.det(c[suspects])) <= HALF_TURN**2 * bound]
    if not singular.size:
        return np.asarray(np.linalg.solve(c, quarter))
    regular = c.copy()
    regular[singular] = np.eye(c.shape[-1])
    divided = np.asarray(np.linalg.solve(regular, quarter))
    divided[singular] = np.linalg.pinv(c[singular], rcond=HALF_TURN) @ quarter[singular]
    return divided


def _even_series(square: Floats) -> Floats:
    """C(a) [k, d, d] from a^2 of norm at most ``START``^2, by Horner's rule."""
    coefficients = bernoulli(START_TERMS)
    identity = np.eye(square.shape[-1])
    total = np.zeros_like(square)
    for i in range(START_TERMS, 0, -2):
        total = square @ (total + coefficients[i - 1] * identity)
    return total + identity


@lru_cache(maxsize=32)
def _structure(group: MatrixGroup) -> tuple[Floats, Floats]:
    """An orthonormal basis of the algebra [d, free_rows, size], and the matrices of a for each.

    ``structure`` [d, d, d]: with X = sum of x_a basis_a, the matrix of ad_X* is the sum of
    x_a structure_a.
    """
    units = np.eye(group.free_rows * group.size).reshape(group.free_rows, group.size, -1)
    projected = group.onto_algebra(units).reshape(len(units.T), -1)
    u, s, _ = np.linalg.svd(projected)
    basis = u[:, s > 0.5].T.reshape(-1, group.free_rows, group.size)
    by_axes = np.moveaxis(basis, 0, 2)
    images = adjoint(group, by_axes[:, :, :, None], by_axes[:, :, None, :])  # rows, size, a, b
    structure = np.einsum("cij,ijab->acb", basis, images)
    return basis, np.ascontiguousarray(structure)
