"""The plane-to-plane map of two views, a point of SL(3): 3x3 matrices of determinant one."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment import manifolds
from mssegment.motions.affine import is_flat, is_plausible
from mssegment.motions.base import Flags, MotionModel
from mssegment.records import Coordinates, Floats

TRIPLES = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
GAUSS_NEWTON_ROUNDS = 4


class Homography(MotionModel):
    """x2 ~ H x1; an elemental subset is four matches, the residual the transfer error."""

    name: ClassVar[str] = "homography"

    def __init__(self) -> None:
        self.manifold = manifolds.from_name("special_linear(3)")
        self.subset_size = 4
        self.parameters = 8
        self.residual_dimension = 2

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Four matches [B, 4, 2, 2], in closed form.

        Unsound: three collinear points, and quadrangles that change their orientation, which no
        plane in front of both cameras can do.
        """
        sound = np.ones(len(samples), dtype=bool)
        for triple in TRIPLES:
            corners = samples[:, triple]
            sound &= ~(is_flat(corners[:, :, 0]) | is_flat(corners[:, :, 1]))
        basis1, scales1 = _projective_basis(samples[:, :, 0], sound)
        basis2, scales2 = _projective_basis(samples[:, :, 1], sound)
        ratio = scales2 / scales1
        # the homogeneous scales w of the points of view 1 must have one sign
        sound &= (ratio > 0).all(axis=1) | (ratio < 0).all(axis=1)
        ratio = np.where(sound[:, None], ratio, 1.0)
        points = (basis2 * ratio[:, None, :]) @ np.linalg.inv(basis1)
        return self._checked(points, np.asarray(samples[:, :, 0].mean(axis=1)), np.asarray(sound))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the transfer error in view 2: linear start, Gauss-Newton."""
        sound = (weights > 0).sum(axis=1) >= 4
        safe = np.where(sound[:, None], weights, 1.0)
        safe = safe / safe.sum(axis=1, keepdims=True)
        design, target = _linear_system(observed)
        parameters = np.stack([_solve(w[None], design[None], target[None])[0] for w in safe])
        for _ in range(GAUSS_NEWTON_ROUNDS):
            parameters = parameters + _solve(safe, *_transfer(parameters, observed))
        points = np.concatenate([parameters, np.ones((len(safe), 1))], axis=1).reshape(-1, 3, 3)
        return self._checked(points, safe @ observed[:, 0], sound)

    def residuals(self, points: Floats, observed: Floats, coordinates: Coordinates) -> Floats:
        """Transfer error in view 2, pixels [B, P]; infinite for points that H sends behind."""
        gap, depth = _project(points, observed[:, 0])
        gap = gap - observed[:, 1]
        error = np.hypot(gap[..., 0], gap[..., 1]) * coordinates.scale
        return np.where(depth > 0, error, np.inf)

    def symmetric_residuals(
        self, points: Floats, observed: Floats, coordinates: Coordinates
    ) -> Floats:
        """Root mean square of the transfer errors both ways, pixels [B, P]."""
        there = self.residuals(points, observed, coordinates)
        inverse = np.asarray(np.linalg.inv(points), dtype=np.float64)
        back = self.residuals(inverse, observed[:, ::-1], coordinates)
        return np.sqrt((there**2 + back**2) / 2)

    def algebraic_residuals(
        self, points: Floats, observed: Floats, coordinates: Coordinates
    ) -> Floats:
        """The transfer error again, pixels."""
        return self.residuals(points, observed, coordinates)

    def _checked(self, points: Floats, middle: Floats, sound: Flags) -> tuple[Floats, Flags]:
        """Scales to determinant one; sound where H is plausible at the ``middle`` [B, 2]."""
        finite = np.asarray(np.isfinite(points).all(axis=(1, 2)))
        points = np.where(finite[:, None, None], points, np.eye(3))
        determinant = np.linalg.det(points)
        largest = np.abs(points).max(axis=(1, 2))
        sound = sound & finite & np.asarray(np.abs(determinant) > 1e-12 * largest**3)
        determinant = np.where(sound, determinant, 1.0)
        points = points / np.cbrt(determinant)[:, None, None]
        image, depth = _project(points, np.asarray(middle)[:, None])
        sound = np.asarray(sound & (depth[:, 0] > 0))
        # derivative of the map at the middle of its matches
        linear = points[:, :2, :2] - image[:, 0, :, None] * points[:, None, 2, :2]
        linear = linear / np.where(sound, depth[:, 0], 1.0)[:, None, None]
        return points, np.asarray(sound & is_plausible(linear))


def _project(points: Floats, x: Floats) -> tuple[Floats, Floats]:
    """H x for x [P, 2] or [B, P, 2]: images [B, P, 2] and homogeneous depths [B, P]."""
    image = x @ np.swapaxes(points[:, :, :2], 1, 2) + points[:, None, :, 2]
    depth = np.asarray(image[..., 2])
    safe = np.where(np.abs(depth) > 1e-12, depth, 1e-12)
    return image[..., :2] / safe[..., None], depth


def _projective_basis(corners: Floats, sound: Flags) -> tuple[Floats, Floats]:
    """The first three corners [B, 4, 2] as columns, and the fourth in that basis."""
    rays = np.concatenate([corners, np.ones((*corners.shape[:-1], 1))], axis=-1)
    basis = np.where(sound[:, None, None], np.swapaxes(rays[:, :3], 1, 2), np.eye(3))
    fourth = np.where(sound[:, None], rays[:, 3], 1.0)
    return basis, np.linalg.solve(basis, fourth[..., None])[..., 0]


def _linear_system(observed: Floats) -> tuple[Floats, Floats]:
    """The equations of H with H33 = 1: [P, 2, 8] and [P, 2]."""
    x1 = np.concatenate([observed[:, 0], np.ones((len(observed), 1))], axis=-1)
    design = np.zeros((len(observed), 2, 8))
    design[:, 0, :3] = design[:, 1, 3:6] = x1
    design[:, :, 6:] = -observed[:, 1, :, None] * observed[:, None, 0]
    return design, observed[:, 1]


def _solve(weights: Floats, jacobian: Floats, gap: Floats) -> Floats:
    """Weighted normal equations of jacobian [B, P, 2, 8] and gap [B, P, 2]: steps [B, 8]."""
    weighted = jacobian * weights[..., None, None]
    flat = weighted.reshape(len(weights), -1, 8)
    normal = np.swapaxes(flat, 1, 2) @ jacobian.reshape(len(weights), -1, 8)
    side = np.swapaxes(flat, 1, 2) @ gap.reshape(len(weights), -1, 1)
    # an unsound set of matches must not stop the batch
    ridge = 1e-13 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(8)
    return np.asarray(np.linalg.solve(normal + ridge + 1e-300 * np.eye(8), side)[..., 0])


def _transfer(parameters: Floats, observed: Floats) -> tuple[Floats, Floats]:
    """Jacobian [B, P, 2, 8] and gap [B, P, 2] of the transfer error."""
    points = np.concatenate([parameters, np.ones((len(parameters), 1))], axis=1).reshape(-1, 3, 3)
    image, depth = _project(points, observed[:, 0])
    depth = np.where(np.abs(depth) > 1e-6, depth, 1e-6)
    x1 = np.concatenate([observed[:, 0], np.ones((len(observed), 1))], axis=-1)
    jacobian = np.zeros((*image.shape, 8))
    jacobian[:, :, 0, :3] = jacobian[:, :, 1, 3:6] = x1
    jacobian[..., 6:] = -image[..., None] * observed[None, :, None, 0]
    return jacobian / depth[..., None, None], observed[:, 1] - image
