"""Homography of a plane between two views: a point of SL(3), 3x3 matrices of determinant one."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.projective import (
    homogeneous,
    homogeneous_rows,
    in_pixels,
    transfer,
    transfer_sq_error,
)
from mssegment.manifolds import SL3
from mssegment.models.affine import is_plausible, nearly_collinear
from mssegment.models.base import Flags, MotionModel, drop_unweighted
from mssegment.records import Floats, Integers, Normalization

TRIPLES = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
GAUSS_NEWTON_ROUNDS = 4
STEP_TOLERANCE = 1e-3
"""Iteration stops after a step that changes no parameter by more; the next would be 100 times
smaller."""
MOTIONS_PER_BLOCK = 16
"""Motions fitted at a time; their arrays stay in the cache."""


class Homography(MotionModel):
    """The homography x2 ~ H x1 of a plane.

    An elemental subset is four matches; the residual is the transfer error in view 2.
    """

    name: ClassVar[str] = "homography"
    purpose: ClassVar[str] = "planes, such as facades"
    in_auto: ClassVar[bool] = True
    planar_under_perspective: ClassVar[bool] = True
    is_local: ClassVar[bool] = True
    sampling_neighbours: ClassVar[int] = 14

    def __init__(self) -> None:
        self.manifold = SL3()
        self.subset_size = 4
        self.parameters = 8
        self.residual_dimension = 2

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points under a random homography with some perspective."""
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        matrix = np.array([[1.1, 0.1, 5.0], [-0.1, 0.9, 8.0], [2e-4, -1e-4, 1.0]])
        matrix[:2] += rng.uniform(-0.05, 0.05, (2, 3)) * [1.0, 1.0, 100.0]
        u, v, _ = transfer(matrix[None], homogeneous_rows(x))
        return np.stack([x, np.stack([u[0], v[0]], axis=1)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Solve for H from four matches [B, 4, 2, 2] in closed form.

        Not valid: three nearly collinear points, and quadrangles whose orientation changes, which
        is impossible for a plane in front of both cameras.
        """
        valid = np.ones(len(samples), dtype=bool)
        for triple in TRIPLES:
            corners = samples[:, triple]
            valid &= ~(nearly_collinear(corners[:, :, 0]) | nearly_collinear(corners[:, :, 1]))
        basis1, scales1 = _projective_basis(samples[:, :, 0], valid)
        basis2, scales2 = _projective_basis(samples[:, :, 1], valid)
        ratio = scales2 / scales1
        # the homogeneous scales w of the points of view 1 must have one sign
        valid &= (ratio > 0).all(axis=1) | (ratio < 0).all(axis=1)
        ratio = np.where(valid[:, None], ratio, 1.0)
        points = (basis2 * ratio[:, None, :]) @ np.linalg.inv(basis1)
        return self._checked(points, np.asarray(samples[:, :, 0].mean(axis=1)), np.asarray(valid))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Weighted least squares of the transfer error in view 2, by Gauss-Newton."""
        if len(weights) > MOTIONS_PER_BLOCK and observed.ndim == 3:
            blocks = [
                weights[start : start + MOTIONS_PER_BLOCK]
                for start in range(0, len(weights), MOTIONS_PER_BLOCK)
            ]
            fits = [self.fit(observed, block) for block in blocks]
            return np.concatenate([p for p, _ in fits]), np.concatenate([s for _, s in fits])
        valid = (weights > 0).sum(axis=1) >= 4
        weights = np.where(valid[:, None], weights, 1.0)
        weights = weights / weights.sum(axis=1, keepdims=True)
        weights, matches = drop_unweighted(weights, observed)
        target, monomials = matches[..., 1, :], _monomials(matches[..., 0, :])
        middle = _sums(weights[:, None], monomials)[:, 0, 3:5]
        parameters = _linear_start(weights, target, monomials)
        active = np.arange(len(weights))
        for _ in range(GAUSS_NEWTON_ROUNDS):
            step = _transfer_step(parameters[active], weights, target, monomials)
            parameters[active] += step
            unfinished = np.abs(step).max(axis=1) > STEP_TOLERANCE
            if not unfinished.any():
                break
            active, weights = active[unfinished], weights[unfinished]
            if matches.ndim == 4:
                target, monomials = target[unfinished], monomials[unfinished]
        points = np.concatenate([parameters, np.ones((len(valid), 1))], axis=1).reshape(-1, 3, 3)
        return self._checked(points, middle, valid)

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Transfer error in view 2, in pixels [B, P]; infinite where H maps behind the camera."""
        x, y, depth = transfer(points, homogeneous_rows(observed[..., 0, :]))
        x -= observed[..., 1, 0]
        y -= observed[..., 1, 1]
        x *= x
        y *= y
        x += y
        error = np.sqrt(x, out=x)
        error *= normalization.scale
        return np.where(depth > 0, error, np.inf)

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Sum of squared transfer errors in both views; infinite where H maps behind a camera."""
        first, second = observed[:, 0], observed[:, 1]
        forward = transfer_sq_error(points, homogeneous_rows(first), second)
        inverse = np.asarray(np.linalg.inv(points))
        backward = transfer_sq_error(inverse, homogeneous_rows(second), first)
        return np.asarray((forward + backward).T)

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """The ``matrix`` from view 1 to view 2."""
        return {"matrix": in_pixels(point, normalization.centres, normalization.scale)}

    def _checked(self, points: Floats, middle: Floats, valid: Flags) -> tuple[Floats, Flags]:
        """Scale to determinant one; valid if H is plausible around the point ``middle`` [B, 2]."""
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
        # derivative of the map at the mean of its matches
        linear = points[:, :2, :2] - image[:, :, None] * points[:, None, 2, :2]
        linear = linear / np.where(valid, depth, 1.0)[:, None, None]
        return points, np.asarray(valid & is_plausible(linear))


def _projective_basis(corners: Floats, valid: Flags) -> tuple[Floats, Floats]:
    """The first three corners [B, 4, 2] as columns, and the fourth in their basis."""
    rays = homogeneous(corners)
    basis = np.where(valid[:, None, None], np.swapaxes(rays[:, :3], 1, 2), np.eye(3))
    fourth = np.where(valid[:, None], rays[:, 3], 1.0)
    return basis, np.linalg.solve(basis, fourth[..., None])[..., 0]


def _monomials(x: Floats) -> Floats:
    """The monomials x^2, xy, y^2, x, y and 1 of points [..., P, 2], as [..., P, 6].

    All sums over tracks in the normal equations are products of weights with these.
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
    """The Gauss-Newton step [B, 8] for the transfer error."""
    rows = np.concatenate([parameters, np.ones((len(parameters), 1))], axis=1)
    u, v, depth = transfer(rows, np.swapaxes(monomials[..., 3:], -1, -2))
    inverse = 1.0 / np.where(np.abs(depth) > 1e-6, depth, 1e-6)
    scaled = weights * inverse
    # weights of the sums over the tracks: of 1, u, v and u^2 + v^2, and of the three residuals
    factors = np.empty((len(u), 7, u.shape[1]))
    squared = np.multiply(scaled, inverse, out=factors[:, 0])
    times_u = np.multiply(squared, u, out=factors[:, 1])
    times_v = np.multiply(squared, v, out=factors[:, 2])
    factors[:, 3] = times_u * u + times_v * v
    residual_u = np.multiply(scaled, target[..., 0] - u, out=factors[:, 4])
    residual_v = np.multiply(scaled, target[..., 1] - v, out=factors[:, 5])
    factors[:, 6] = residual_u * u + residual_v * v
    sums = _sums(factors, monomials)
    side = np.concatenate([sums[:, 4, 3:], sums[:, 5, 3:], -sums[:, 6, 3:5]], axis=1)
    return _solve(sums[:, :4], side)


def _sums(factors: Floats, monomials: Floats) -> Floats:
    """Sums [B, k, 6] of ``monomials``, [n, 6] or [B, n, 6], with weights ``factors`` [B, k, n]."""
    if monomials.ndim == 3:
        return np.asarray(factors @ monomials)
    # one large product is faster than one per motion
    sums: Floats = factors.reshape(-1, factors.shape[2]) @ monomials
    return sums.reshape(*factors.shape[:2], 6)


def _normal_matrix_layout() -> tuple[Integers, Floats]:
    """Index and sign [8, 8] of each entry of the normal matrix.

    The indices refer to the sums [4, 6] of 1, u, v and u^2 + v^2.
    """
    # index of each product of two of (x, y, 1) among the monomials
    products = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])
    index, sign = np.zeros((8, 8), dtype=np.int64), np.zeros((8, 8))
    index[:3, :3] = index[3:6, 3:6] = products
    index[:3, 6:], index[3:6, 6:] = 6 + products[:, :2], 12 + products[:, :2]
    index[6:, :6] = index[:6, 6:].T
    index[6:, 6:] = 18 + products[:2, :2]
    sign[:3, :3] = sign[3:6, 3:6] = sign[6:, 6:] = 1.0
    sign[:6, 6:] = sign[6:, :6] = -1.0
    return index, sign


_INDICES, _SIGNS = _normal_matrix_layout()


def _solve(sums: Floats, side: Floats) -> Floats:
    """Solve the normal equations given by ``sums`` [B, 4, 6] and ``side`` [B, 8] for [B, 8]."""
    normal = sums.reshape(len(sums), 24).take(_INDICES, axis=1) * _SIGNS
    # a degenerate set of matches must not make the batch fail
    diagonal = normal.reshape(-1, 64)[:, ::9]
    diagonal += 1e-13 * diagonal.sum(axis=1, keepdims=True) + 1e-300
    return np.asarray(np.linalg.solve(normal, side[..., None])[..., 0])
