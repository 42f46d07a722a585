"""Robust epipolar geometry of a few matches, and the planes that are compatible with it.

References
----------
Hartley, In defense of the eight-point algorithm, 1997.
Hartley and Zisserman, Multiple View Geometry, 2nd edition: sections 13.1 (planes compatible with a
fundamental matrix) and 14.2 (the affine fundamental matrix).
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.epipolar import cross, sampson
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.robust import student_t_weights
from mssegment.geometry.rotations import skew
from mssegment.records import Floats, Record
from mssegment.special import median

FREEDOM = 2.5
"""Degrees of freedom of the Student t distribution of distances from epipolar lines."""
ROUNDS = 8
"""Rounds of reweighting."""
FIRST_SCALES = (4.0, 2.0, 1.0)
"""Scale of the first rounds, over the robust deviation of the residuals; then the noise."""
PERSPECTIVE_PRICE = 3.0
"""Nats of a perspective geometry: it has three parameters more than an affine one."""
MIN_PERSPECTIVE = 9
"""Fewest matches to which a perspective geometry is fitted: one more than determine it."""
GRADIENT_RANGE = (0.02, 50.0)
"""Range, over its median, of the factor that makes an algebraic residual a distance."""
TINY = 1e-12


class EpipolarFit(Record, frozen=True):
    """A fundamental matrix [3, 3] of rank 2, and minus its log-likelihood up to a constant."""

    matrix: Floats
    cost: float

    @property
    def epipole(self) -> Floats:
        """The epipole of the second view [3], homogeneous, of unit norm."""
        return np.asarray(np.linalg.svd(self.matrix)[0][:, 2])


def fit_epipolar(first: Floats, second: Floats, weights: Floats, noise: float) -> EpipolarFit:
    """Fit an epipolar geometry robustly.

    The more likely of the fundamental matrix of a perspective and that of an affine camera.

    Parameters
    ----------
    first, second : ndarray [P, 2]
        Matches in coordinates of about unit size, the same unit in both views.
    weights : ndarray [P]
        Weights of the matches.
    noise : float
        Scale of the Sampson distances, in the same unit.

    Returns
    -------
    EpipolarFit

    Examples
    --------
    Points at different depths, seen by a camera that moves to the right:

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> first = rng.uniform(-1, 1, (40, 2))
    >>> second = first - np.stack([0.1 / rng.uniform(1, 2, 40), np.zeros(40)], axis=1)
    >>> found = fit_epipolar(first, second, np.ones(40), 1e-3).matrix
    >>> (np.abs(found) / np.abs(found).max()).round(3).tolist()
    [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
    """
    return min(epipolar_fits(first, second, weights, noise), key=lambda fit: fit.cost)


def epipolar_fits(
    first: Floats, second: Floats, weights: Floats, noise: float
) -> list[EpipolarFit]:
    """The geometries that ``fit_epipolar`` chooses from: affine and, if determined, perspective."""
    rays = homogeneous(first), homogeneous(second)
    fits = [_reweighted(*rays, weights, noise, affine=True)]
    if len(first) >= MIN_PERSPECTIVE:
        fits.append(_reweighted(*rays, weights, noise, affine=False))
    return fits


def _reweighted(
    first: Floats, second: Floats, weights: Floats, noise: float, *, affine: bool
) -> EpipolarFit:
    """Iteratively reweighted least squares of the Sampson distance, from coarse to fine."""
    current = weights
    for r in range(ROUNDS):
        matrix = _affine(first, second, current) if affine else _eight_point(first, second, current)
        terms = sampson(matrix[None], first, second)
        error, gradient = np.abs(terms.error[0]), terms.gradient[0]
        scale = noise
        if r < len(FIRST_SCALES):
            scale = max(noise, FIRST_SCALES[r] * 1.48 * median(error))
        square = gradient**2 + TINY**2
        to_pixels = np.clip(median(square) / square, *GRADIENT_RANGE)
        current = weights * student_t_weights((error / scale) ** 2, FREEDOM, 1) * to_pixels
    cost = (FREEDOM + 1) / 2 * float(weights @ np.log1p((error / noise) ** 2 / FREEDOM))
    return EpipolarFit(matrix, cost + (0.0 if affine else PERSPECTIVE_PRICE))


def _eight_point(first: Floats, second: Floats, weights: Floats) -> Floats:
    """The weighted eight-point algorithm, with rank 2."""
    products = (second[:, :, None] * first[:, None, :]).reshape(len(first), 9)
    _, vectors = np.linalg.eigh((products * weights[:, None]).T @ products)
    left, values, right = np.linalg.svd(vectors[:, 0].reshape(3, 3))
    return np.asarray((left * [values[0], values[1], 0.0]) @ right)


def _affine(first: Floats, second: Floats, weights: Floats) -> Floats:
    """The weighted affine fundamental matrix: a plane through the matches in R^4."""
    vectors = np.concatenate([second[:, :2], first[:, :2]], axis=1)
    mean = weights @ vectors / weights.sum()
    centred = vectors - mean
    a, b, c, d = np.linalg.eigh((centred * weights[:, None]).T @ centred)[1][:, 0]
    offset = -float(np.array([a, b, c, d]) @ mean)
    return np.array([[0.0, 0.0, a], [0.0, 0.0, b], [c, d, offset]])


def compatible_plane(matrix: Floats, first: Floats, second: Floats, noise: float) -> Floats:
    """The homography compatible with an epipolar geometry that is nearest to matches.

    All homographies of planes under ``matrix`` are [e']x F + e' v' with the epipole e' of the
    second view; v is fitted robustly.

    Parameters
    ----------
    matrix : ndarray [3, 3]
        A fundamental matrix of rank 2.
    first, second : ndarray [P, 2]
        Matches, in the coordinates of ``matrix``.
    noise : float
        Smallest scale of the residuals.

    Returns
    -------
    ndarray [3, 3]
    """
    rays, images = homogeneous(first), homogeneous(second)
    epipole = np.linalg.svd(matrix)[0][:, 2]
    base = skew(epipole) @ matrix
    base /= max(float(np.abs(base).max()), TINY)
    across = cross(images, np.broadcast_to(epipole, images.shape))
    square = (across**2).sum(axis=1) + TINY
    along = -(cross(images, rays @ base.T) * across).sum(axis=1) / square
    weights = square
    for _ in range(ROUNDS):
        normal = (rays * weights[:, None]).T @ rays
        normal += 1e-9 * np.trace(normal) * np.eye(3)
        plane = np.linalg.solve(normal, (rays * weights[:, None]).T @ along)
        homography = base + np.outer(epipole, plane)
        mapped, depth = mapped_points(homography, first)
        residual = np.linalg.norm(mapped - second, axis=1)
        scale = max(noise, median(residual) / 0.67)
        weights = square / np.maximum(depth**2, 1e-6)
        weights = weights * student_t_weights((residual / scale) ** 2, FREEDOM, 1)
    return np.asarray(homography)


def mapped_points(homography: Floats, points: Floats) -> tuple[Floats, Floats]:
    """Images [P, 2] of points under a homography whose sign is that of most depths, and the depths.

    Points that are not in front of the camera are mapped far away.
    """
    image = homogeneous(points) @ homography.T
    sign = 1.0 if median(image[:, 2]) >= 0 else -1.0
    depth = sign * image[:, 2]
    return sign * image[:, :2] / np.maximum(depth, 1e-6)[:, None], depth
