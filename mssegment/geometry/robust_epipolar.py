"""Robust epipolar geometry of many frame pairs at a time, and how well it predicts each match.

Two models are fitted by reweighting with a Student t distribution: the affine epipolar geometry, a
hyperplane in the four coordinates of a match, and the fundamental matrix of rank 2 by the
normalized eight-point algorithm. Residuals are leave-one-out: divided by 1 - leverage, they are the
distance of a match from the geometry that the others predict.

References
----------
Shapiro, Zisserman and Brady, 3D motion recovery via affine epipolar geometry, IJCV 16, 1995.
Hartley, In defense of the eight-point algorithm, PAMI 19, 1997.
Lange, Little and Taylor, Robust statistical modeling using the t distribution, 1989.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.geometry.epipolar import sampson
from mssegment.geometry.robust import student_t_weights
from mssegment.records import Floats

Flags = npt.NDArray[np.bool_]

FREEDOM = 3.0
"""Degrees of freedom of the Student t distribution of the residuals."""
ROUNDS = 2
"""Rounds of reweighting; with 4 of them the partitions are as good, in half as much time again."""
AFFINE_MATCHES, FUNDAMENTAL_MATCHES = 6, 9
"""Fewest matches of a fit: one more than determines the geometry, and for the affine one two."""
TO_DEVIATION = 1.4826
"""From the median of absolute values to the standard deviation of a normal distribution."""
MOST_LEVERAGE = 0.95
"""A match of higher leverage says nothing about its own residual."""
GRADIENT_RANGE = 50.0
"""Weights that turn algebraic into Sampson residuals differ by at most this from their median."""
SINGULAR = 1e-13
"""Variances below this share of the largest are none: the matches are degenerate."""


def affine_epipolar_residuals(matches: Floats, used: Flags, least_scale: Floats) -> Floats:
    """Leave-one-out distances from affine epipolar geometries.

    Parameters
    ----------
    matches : ndarray [n, 4, p]
        Coordinates x1, y1, x2, y2 of the matches of n frame pairs, in pixels.
    used : ndarray [n, p] of bool
        The matches to which each geometry is fitted, at least ``AFFINE_MATCHES``.
    least_scale : ndarray [n]
        The noise in pixels, below which the scale of the residuals is not estimated.

    Returns
    -------
    ndarray [n, p]
        Signed distances in pixels, also of the matches that are not ``used``.
    """
    weights = used.astype(np.float64)
    for step in range(ROUNDS + 1):
        total = weights.sum(axis=1)
        centre = (matches @ weights[:, :, None])[:, :, 0] / total[:, None]
        centred = matches - centre[:, :, None]
        scatter = (centred * weights[:, None]) @ centred.transpose(0, 2, 1)
        values, axes = np.linalg.eigh(scatter)
        along = axes.transpose(0, 2, 1) @ centred
        residuals = along[:, 0]
        if step < ROUNDS:
            weights = _reweighted(residuals, used, least_scale)
    spread = np.maximum(values[:, 1:], SINGULAR * values[:, -1:] + 1e-300)
    leverage = (along[:, 1:] ** 2 / spread[:, :, None]).sum(axis=1) + 1 / total[:, None]
    return _left_out(residuals, weights * leverage)


def fundamental_residuals(matches: Floats, used: Flags, least_scale: Floats) -> Floats:
    """Leave-one-out Sampson distances from fundamental matrices of rank 2.

    Parameters and result are those of ``affine_epipolar_residuals``; at least
    ``FUNDAMENTAL_MATCHES`` are needed.
    """
    first, to_unit1 = _centred_rays(matches[:, :2], used)
    second, to_unit2 = _centred_rays(matches[:, 2:], used)
    unit1, unit2 = first * to_unit1[:, :, None], second * to_unit2[:, :, None]
    equations = (unit2[:, :, None] * unit1[:, None]).reshape(len(matches), 9, -1)
    transposed = equations.transpose(0, 2, 1)
    to_pixels = to_unit2[:, :, None] * to_unit1[:, None]
    weights = used.astype(np.float64)
    for step in range(ROUNDS + 1):
        values, vectors = np.linalg.eigh((equations * weights[:, None]) @ transposed)
        matrices = to_pixels * _of_rank_two(vectors[:, :, 0].reshape(-1, 3, 3))
        terms = sampson(matrices, first.transpose(0, 2, 1), second.transpose(0, 2, 1))
        if step < ROUNDS:
            squared = terms.gradient**2
            ratio = _median(squared, used)[:, None] / squared
            weights = _reweighted(terms.error, used, least_scale)
            weights *= np.clip(ratio, 1 / GRADIENT_RANGE, GRADIENT_RANGE)
    spread = np.maximum(values[:, 1:], SINGULAR * values[:, -1:] + 1e-300)
    along = vectors[:, :, 1:].transpose(0, 2, 1) @ equations
    # seven parameters: eight directions less the one that rank 2 takes away
    leverage = (along**2 / spread[:, :, None]).sum(axis=1) * (7 / 8)
    return _left_out(terms.error, weights * leverage)


def _centred_rays(points: Floats, used: Flags) -> tuple[Floats, Floats]:
    """Homogeneous points [n, 3, p] about their mean, and factors [n, 3] that make spreads 1."""
    weights = (used / used.sum(axis=1, keepdims=True))[:, :, None]
    rays = np.ones((len(points), 3, points.shape[2]))
    np.subtract(points, points @ weights, out=rays[:, :2])
    variance = (rays[:, :2] ** 2 @ weights).sum(axis=(1, 2)) / 2
    factors = np.ones((len(points), 3))
    factors[:, :2] = 1 / np.sqrt(variance + 1e-18)[:, None]
    return rays, factors


def _of_rank_two(matrices: Floats) -> Floats:
    """The nearest matrices [n, 3, 3] of rank 2, in the Frobenius norm."""
    # without the direction that the matrix shortens most; an eigenvector is cheaper than the SVD
    lost = np.linalg.eigh(matrices.transpose(0, 2, 1) @ matrices)[1][:, :, :1]
    return np.asarray(matrices - (matrices @ lost) @ lost.transpose(0, 2, 1))


def _reweighted(residuals: Floats, used: Flags, least_scale: Floats) -> Floats:
    """Student t weights [n, p] of the residuals, 0 for matches that are not used."""
    scale = np.maximum(TO_DEVIATION * _median(np.abs(residuals), used), least_scale)
    squared = (residuals / scale[:, None]) ** 2
    return np.where(used, student_t_weights(squared, FREEDOM, 1), 0.0)


def _median(values: Floats, used: Flags) -> Floats:
    """The (lower) median of each row of [n, p] among those used."""
    ordered = np.sort(np.where(used, values, np.inf), axis=1)
    middle = (np.maximum(used.sum(axis=1), 1) - 1) // 2
    return np.asarray(ordered[np.arange(len(ordered)), middle])


def _left_out(residuals: Floats, leverage: Floats) -> Floats:
    return np.asarray(residuals / np.maximum(1 - leverage, 1 - MOST_LEVERAGE))
