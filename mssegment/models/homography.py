"""The plane-to-plane map of two views, a point of SL(3): 3x3 matrices of determinant one."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.projective import (
    homogeneous,
    homogeneous_rows,
    transfer,
    transfer_sq_error,
)
from mssegment.manifolds import SL3
from mssegment.models.affine import is_flat, is_plausible
from mssegment.models.base import Flags, MotionModel, concentrated
from mssegment.records import Floats, Integers, Normalization

TRIPLES = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
GAUSS_NEWTON_ROUNDS = 4
CONVERGED = 1e-3
"""A step that changes no parameter by more is the last one: the next would be a hundredth of it."""
ROWS = 16
"""Motions fitted at a time: intermediate arrays that stay in the cache."""


class Homography(MotionModel):
    """x2 ~ H x1; an elemental subset is four matches, the residual the transfer error."""

    name: ClassVar[str] = "homography"
    purpose: ClassVar[str] = "planes, such as facades"
    in_auto: ClassVar[bool] = True
    planar_under_perspective: ClassVar[bool] = True
    is_local: ClassVar[bool] = True
    neighbours: ClassVar[int] = 14

    def __init__(self) -> None:
        self.manifold = SL3()
        self.subset_size = 4
        self.parameters = 8
        self.residual_dimension = 2

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points under a map with some perspective."""
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        matrix = np.array([[1.1, 0.1, 5.0], [-0.1, 0.9, 8.0], [2e-4, -1e-4, 1.0]])
        matrix[:2] += rng.uniform(-0.05, 0.05, (2, 3)) * [1.0, 1.0, 100.0]
        u, v, _ = transfer(matrix[None], homogeneous_rows(x))
        return np.stack([x, np.stack([u[0], v[0]], axis=1)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Four matches [B, 4, 2, 2], in closed form.

        Unsound: three collinear points, and quadrangles that change their orientation, which no
        plane in front of both cameras can do.
        """
        valid = np.ones(len(samples), dtype=bool)
        for triple in TRIPLES:
            corners = samples[:, triple]
            valid &= ~(is_flat(corners[:, :, 0]) | is_flat(corners[:, :, 1]))
        basis1, scales1 = _projective_basis(samples[:, :, 0], valid)
        basis2, scales2 = _projective_basis(samples[:, :, 1], valid)
        ratio = scales2 / scales1
        # the homogeneous scales w of the points of view 1 must have one sign
        valid &= (ratio > 0).all(axis=1) | (ratio < 0).all(axis=1)
        ratio = np.where(valid[:, None], ratio, 1.0)
        points = (basis2 * ratio[:, None, :]) @ np.linalg.inv(basis1)
        return self._checked(points, np.asarray(samples[:, :, 0].mean(axis=1)), np.asarray(valid))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the transfer error in view 2: linear start, Gauss-Newton."""
        if len(weights) > ROWS and observed.ndim == 3:
            blocks = [weights[start : start + ROWS] for start in range(0, len(weights), ROWS)]
            fits = [self.fit(observed, block) for block in blocks]
            return np.concatenate([p for p, _ in fits]), np.concatenate([s for _, s in fits])
        valid = (weights > 0).sum(axis=1) >= 4
        safe = np.where(valid[:, None], weights, 1.0)
        safe = safe / safe.sum(axis=1, keepdims=True)
        safe, own = concentrated(safe, observed)
        target, monomials = own[..., 1, :], _monomials(own[..., 0, :])
        middle = _sums(safe[:, None], monomials)[:, 0, 3:5]
        parameters = _linear_start(safe, target, monomials)
        moving = np.arange(len(safe))
        for _ in range(GAUSS_NEWTON_ROUNDS):
            step = _transfer_step(parameters[moving], safe, target, monomials)
            parameters[moving] += step
            on = np.abs(step).max(axis=1) > CONVERGED
            if not on.any():
                break
            moving, safe = moving[on], safe[on]
            if own.ndim == 4:
                target, monomials = target[on], monomials[on]
        points = np.concatenate([parameters, np.ones((len(valid), 1))], axis=1).reshape(-1, 3, 3)
        return self._checked(points, middle, valid)

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Transfer error in view 2, pixels [B, P]; infinite for points that H maps behind."""
        across, down, depth = transfer(points, homogeneous_rows(observed[..., 0, :]))
        across -= observed[..., 1, 0]
        down -= observed[..., 1, 1]
        across *= across
        down *= down
        across += down
        error = np.sqrt(across, out=across)
        error *= normalization.scale
        return np.where(depth > 0, error, np.inf)

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared transfer errors both ways, added; infinite where H maps behind a camera."""
        first, second = observed[:, 0], observed[:, 1]
        there = transfer_sq_error(points, homogeneous_rows(first), second)
        inverse = np.asarray(np.linalg.inv(points))
        return np.asarray((there + transfer_sq_error(inverse, homogeneous_rows(second), first)).T)

    def _checked(self, points: Floats, middle: Floats, valid: Flags) -> tuple[Floats, Flags]:
        """Scales to determinant one; sound where H is plausible at the ``middle`` [B, 2]."""
        finite = np.asarray(np.isfinite(points).all(axis=(1, 2)))
        points = np.where(finite[:, None, None], points, np.eye(3))
        determinant = np.linalg.det(points)
        largest = np.abs(points).max(axis=(1, 2))
        valid = valid & finite & np.asarray(np.abs(determinant) > 1e-12 * largest**3)
        determinant = np.where(valid, determinant, 1.0)
        points = points / np.cbrt(determinant)[:, None, None]
        rows = homogeneous_rows(np.asarray(middle)[:, None])
        x, y, depth = (row[:, 0] for row in transfer(points, rows))
        image = np.stack([x, y], axis=1)
        valid = np.asarray(valid & (depth > 0))
        # derivative of the map at the middle of its matches
        linear = points[:, :2, :2] - image[:, :, None] * points[:, None, 2, :2]
        linear = linear / np.where(valid, depth, 1.0)[:, None, None]
        return points, np.asarray(valid & is_plausible(linear))


def _projective_basis(corners: Floats, valid: Flags) -> tuple[Floats, Floats]:
    """The first three corners [B, 4, 2] as columns, and the fourth in that basis."""
    rays = homogeneous(corners)
    basis = np.where(valid[:, None, None], np.swapaxes(rays[:, :3], 1, 2), np.eye(3))
    fourth = np.where(valid[:, None], rays[:, 3], 1.0)
    return basis, np.linalg.solve(basis, fourth[..., None])[..., 0]


def _monomials(x: Floats) -> Floats:
    """x^2, xy, y^2, x, y and 1 of the points [..., P, 2], [..., P, 6].

    All sums over tracks that the equations below need are products of weights with these.
    """
    first, second = x[..., 0], x[..., 1]
    products = [first * first, first * second, second * second]
    return np.stack([*products, first, second, np.ones_like(first)], axis=-1)


def _linear_start(weights: Floats, target: Floats, monomials: Floats) -> Floats:
    """Least squares of the equations that are linear in H with H33 = 1, [B, 8]."""
    u, v = target[..., 0], target[..., 1]
    factors = np.empty((len(weights), 4, weights.shape[1]))
    factors[:, 0] = weights
    np.multiply(weights, u, out=factors[:, 1])
    np.multiply(weights, v, out=factors[:, 2])
    np.multiply(weights, u * u + v * v, out=factors[:, 3])
    sums = _sums(factors, monomials)
    side = np.concatenate([sums[:, 1, 3:], sums[:, 2, 3:], -sums[:, 3, 3:5]], axis=1)
    return _solve(sums, side)


def _transfer_step(
    parameters: Floats, weights: Floats, target: Floats, monomials: Floats
) -> Floats:
    """The Gauss-Newton step [B, 8] of the transfer error."""
    rows = np.concatenate([parameters, np.ones((len(parameters), 1))], axis=1)
    u, v, depth = transfer(rows, np.swapaxes(monomials[..., 3:], -1, -2))
    inverse = 1.0 / np.where(np.abs(depth) > 1e-6, depth, 1e-6)
    pull = weights * inverse
    # the weights of seven sums over the tracks: those of 1, u, v, u^2 + v^2, and the three gaps
    factors = np.empty((len(u), 7, u.shape[1]))
    stiffness = np.multiply(pull, inverse, out=factors[:, 0])
    by_u = np.multiply(stiffness, u, out=factors[:, 1])
    by_v = np.multiply(stiffness, v, out=factors[:, 2])
    factors[:, 3] = by_u * u + by_v * v
    gap_u = np.multiply(pull, target[..., 0] - u, out=factors[:, 4])
    gap_v = np.multiply(pull, target[..., 1] - v, out=factors[:, 5])
    factors[:, 6] = gap_u * u + gap_v * v
    sums = _sums(factors, monomials)
    side = np.concatenate([sums[:, 4, 3:], sums[:, 5, 3:], -sums[:, 6, 3:5]], axis=1)
    return _solve(sums[:, :4], side)


def _sums(factors: Floats, monomials: Floats) -> Floats:
    """The sums [B, k, 6] of the ``monomials``, [n, 6] or [B, n, 6], times ``factors`` [B, k, n]."""
    if monomials.ndim == 3:
        return np.asarray(factors @ monomials)
    # one large product is faster than one for each motion
    sums: Floats = factors.reshape(-1, factors.shape[2]) @ monomials
    return sums.reshape(*factors.shape[:2], 6)


def _normal_places() -> tuple[Integers, Floats]:
    """Where in the sums [4, 6] of 1, u, v and u^2 + v^2 the normal matrix finds its entries; signs.

    Both are [8, 8].
    """
    # where (x, y, 1) times (x, y, 1) stands among the monomials
    products = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])
    place, sign = np.zeros((8, 8), dtype=np.int64), np.zeros((8, 8))
    place[:3, :3] = place[3:6, 3:6] = products
    place[:3, 6:], place[3:6, 6:] = 6 + products[:, :2], 12 + products[:, :2]
    place[6:, :6] = place[:6, 6:].T
    place[6:, 6:] = 18 + products[:2, :2]
    sign[:3, :3] = sign[3:6, 3:6] = sign[6:, 6:] = 1.0
    sign[:6, 6:] = sign[6:, :6] = -1.0
    return place, sign


_PLACES, _SIGNS = _normal_places()


def _solve(sums: Floats, side: Floats) -> Floats:
    """Solutions [B, 8] of the normal equations from the sums [B, 4, 6] and ``side`` [B, 8]."""
    normal = sums.reshape(len(sums), 24).take(_PLACES, axis=1) * _SIGNS
    # an unsound set of matches must not stop the batch
    diagonal = normal.reshape(-1, 64)[:, ::9]
    diagonal += 1e-13 * diagonal.sum(axis=1, keepdims=True) + 1e-300
    return np.asarray(np.linalg.solve(normal, side[..., None])[..., 0])
