"""Essential matrices from five matches of calibrated views, batched.

References
----------
D. Nistér, "An efficient solution to the five-point relative pose problem", PAMI 26, 2004.
H. Stewénius, C. Engels and D. Nistér, "Recent developments on direct relative orientation", ISPRS
J. Photogrammetry and Remote Sensing 60, 2006.
"""

from __future__ import annotations

from itertools import combinations_with_replacement

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers

Flags = npt.NDArray[np.bool_]

LARGEST_IMAGINARY = 1e-6
"""Imaginary part, relative to the size of the root, up to which a root is taken as real. Rounding
turns a double root into a pair with imaginary parts of the square root of the precision."""
MIN_INDEPENDENCE = 1e-12
"""Least part of an equation, relative to the largest, that the others do not contain; rounding
leaves 1e-16 of it."""


def five_point(first: Floats, second: Floats) -> Floats:
    """All essential matrices E with x2' E x1 = 0 for five matches.

    With the null space of the five equations, E = x X + y Y + z Z + W; det E = 0 and
    2 E E' E = tr(E E') E are ten cubics in (x, y, z). Eliminating the ten monomials of degree three
    leaves the matrix of the multiplication by x on the other ten, whose eigenvectors hold the
    solutions.

    Parameters
    ----------
    first, second : ndarray [B, 5, 3]
        Rays (x, y, 1) in views 1 and 2, in normalized coordinates.

    Returns
    -------
    ndarray [B, 10, 3, 3]
        Matrices with norm sqrt(2); NaN in the place of roots that are not real, and throughout for
        degenerate matches.
    """
    basis, independent = _null_space(first, second)
    constraints = _constraints(basis)
    cubic, rest = constraints[..., :10], constraints[..., 10:]
    solvable = independent & np.asarray(np.abs(np.linalg.det(cubic)) > 0.0)
    reduced = np.linalg.solve(np.where(solvable[:, None, None], cubic, np.eye(10)), rest)
    solvable &= np.isfinite(reduced).all(axis=(1, 2))
    _, vectors = np.linalg.eig(_multiplication(np.where(solvable[:, None, None], reduced, 0.0)))
    rows = np.swapaxes(vectors, 1, 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        roots = rows[..., 6:9] / rows[..., 9:]
        real = np.abs(roots.imag).max(axis=-1) <= LARGEST_IMAGINARY * (
            1.0 + np.abs(roots.real).max(axis=-1)
        )
        weights = np.concatenate([roots.real, np.ones((*real.shape, 1))], axis=-1)
        matrices = np.einsum("bsm,bijm->bsij", weights, basis)
        matrices *= np.sqrt(2.0) / np.linalg.norm(matrices, axis=(2, 3), keepdims=True)
    return np.where((real & solvable[:, None])[..., None, None], matrices, np.nan)


def _null_space(first: Floats, second: Floats) -> tuple[Floats, Flags]:
    """An orthonormal basis [B, 3, 3, 4] of the matrices with x2' E x1 = 0.

    And whether the five equations are independent.
    """
    equations = (second[..., :, None] * first[..., None, :]).reshape(len(first), 5, 9)
    orthogonal, triangle = np.linalg.qr(np.swapaxes(equations, 1, 2), mode="complete")
    sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
    independent = sizes.min(axis=1) > MIN_INDEPENDENCE * sizes.max(axis=1)
    return orthogonal[:, :, 5:].reshape(-1, 3, 3, 4), np.asarray(independent)


def _constraints(basis: Floats) -> Floats:
    """The coefficients [B, 10, 20] of the ten cubics, with the monomials of ``MONOMIALS``."""
    square = np.einsum("bikm,bjkn->bijmn", basis, basis)
    trace = np.einsum("biimn->bmn", square)
    traced = 2.0 * square
    for i in range(3):
        traced[:, i, i] -= trace
    cubics = np.einsum("bikmn,bkjp->bijmnp", traced, basis).reshape(-1, 9, 64)
    minors = np.einsum("bjm,bkn->bjkmn", basis[:, 1], basis[:, 2])
    minors = minors - np.swapaxes(minors, 1, 2)
    cofactors = np.stack([minors[:, 1, 2], minors[:, 2, 0], minors[:, 0, 1]], axis=1)
    determinant = np.einsum("bjmn,bjp->bmnp", cofactors, basis[:, 0]).reshape(-1, 1, 64)
    return np.asarray(np.concatenate([cubics, determinant], axis=1) @ _COLLECT)


def _monomials() -> list[tuple[int, ...]]:
    """The products of three of (x, y, z, 1) as sorted indices, those of degree three first."""
    products = list(combinations_with_replacement(range(4), 3))
    # x^3 ... z^3, then x^2 ... z^2, x, y, z and 1
    return sorted(products, key=lambda product: (product.count(3), product))


MONOMIALS = _monomials()


def _collection() -> Floats:
    """The matrix [64, 20] that adds the coefficients of equal products."""
    matrix = np.zeros((4, 4, 4, len(MONOMIALS)))
    for index in np.ndindex(4, 4, 4):
        matrix[(*index, MONOMIALS.index(tuple(sorted(index))))] = 1.0
    return matrix.reshape(64, -1)


_COLLECT = _collection()


def _multiples() -> tuple[list[int], Integers]:
    """x times each of the last ten monomials: which are of degree three, and the indices of all."""
    indices = [MONOMIALS.index(tuple(sorted((0, *m[:-1])))) for m in MONOMIALS[10:]]
    return [k for k, index in enumerate(indices) if index < 10], np.array(indices)


_CUBIC_ROWS, _TIMES_X = _multiples()


def _multiplication(reduced: Floats) -> Floats:
    """The matrix [B, 10, 10] of the multiplication by x modulo the cubics."""
    matrix = np.zeros_like(reduced)
    for row, index in enumerate(_TIMES_X):
        if row in _CUBIC_ROWS:
            matrix[:, row] = -reduced[:, index]
        else:
            matrix[:, row, index - 10] = 1.0
    return matrix
