"""Affine motion between two views: a point of the affine group A(2), equation (26)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.projective import in_pixels
from mssegment.manifolds import AffineGroup
from mssegment.models.base import Flags, MotionModel, weighted_sums
from mssegment.records import Floats, Normalization

MIN_RELATIVE_HEIGHT = 0.02
"""Smallest height of an elemental triangle, relative to its longest side."""
MOTIONS_PER_BLOCK = 32
"""Motions per block of residuals; a block stays in the cache."""
SINGULAR_VALUE_RANGE = (0.2, 5.0)
"""Range of the singular values of A in a plausible motion."""


class Affine(MotionModel):
    """The affine motion x2 = A x1 + b.

    An elemental subset is three matches; the residual is the transfer error in view 2.
    """

    name: ClassVar[str] = "affine"
    purpose: ClassVar[str] = "objects that translate, rotate and change size"
    in_auto: ClassVar[bool] = True
    is_local: ClassVar[bool] = True

    def __init__(self) -> None:
        self.manifold = AffineGroup()
        self.subset_size = 3
        self.parameters = 6
        self.residual_dimension = 2

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points under a random rotation, stretch and shift."""
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        linear = np.array([[1.1, -0.1], [0.15, 0.95]]) + rng.uniform(-0.05, 0.05, (2, 2))
        return np.stack([x, x @ linear.T + rng.uniform(-15.0, 15.0, 2)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Solve for A and b from three matches [B, 3, 2, 2].

        Nearly collinear matches and implausible maps are not valid.
        """
        valid = ~(nearly_collinear(samples[:, :, 0]) | nearly_collinear(samples[:, :, 1]))
        edges1 = np.swapaxes(samples[:, 1:, 0] - samples[:, :1, 0], 1, 2)
        edges2 = np.swapaxes(samples[:, 1:, 1] - samples[:, :1, 1], 1, 2)
        edges1 = np.where(valid[:, None, None], edges1, np.eye(2))
        linear = edges2 @ np.linalg.inv(edges1)
        shift = samples[:, 0, 1] - np.einsum("bij,bj->bi", linear, samples[:, 0, 0])
        return self._checked(linear, shift, valid)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Weighted least squares of the transfer error, from the weighted moments of the tracks.

        The moments of all motions are one matrix product. Normalized coordinates are of order one,
        so moments about the origin are as accurate as those about each centroid.
        """
        origin = observed.mean(axis=-3, keepdims=True) if observed.size else np.zeros((1, 2, 2))
        x = (observed - origin).reshape(*observed.shape[:-2], 4)
        products = x[..., :2, None] * x[..., None, :]
        features = np.concatenate(
            [x, products.reshape(*x.shape[:-1], 8), np.ones((*x.shape[:-1], 1))], axis=-1
        )
        moments = weighted_sums(weights, features)
        total = moments[:, 12]
        moments = moments[:, :12] / np.where(total > 0, total, 1.0)[:, None]
        mean1, mean2 = moments[:, :2], moments[:, 2:4]
        second = moments[:, 4:].reshape(-1, 2, 4)
        central = second - mean1[:, :, None] * moments[:, None, :4]
        scatter, cross = central[:, :, :2], central[:, :, 2:]
        rounding = 1e-14 * np.trace(second[:, :, :2], axis1=1, axis2=2)
        linear, regular = _solve_2x2(scatter, cross, rounding)
        centroid1, centroid2 = mean1 + origin[..., 0, 0, :], mean2 + origin[..., 0, 1, :]
        shift = centroid2 - np.einsum("bij,bj->bi", linear, centroid1)
        return self._checked(linear, shift, (total > 0) & regular)

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Transfer error in view 2, in pixels [B, P]."""
        if observed.ndim == 4:
            images = observed[:, :, 0] @ np.swapaxes(points[:, :2, :2], 1, 2)
            images += points[:, None, :2, 2]
            images -= observed[:, :, 1]
            return np.asarray(np.linalg.norm(images, axis=-1) * normalization.scale)
        first = np.concatenate([observed[:, 0], np.ones((len(observed), 1))], axis=1).T
        second = np.ascontiguousarray(observed[:, 1].T)
        errors = np.empty((len(points), len(observed)))
        # blocks that stay in the cache take a third of the time
        for start in range(0, len(points), MOTIONS_PER_BLOCK):
            x = errors[start : start + MOTIONS_PER_BLOCK]
            rows = points[start : start + MOTIONS_PER_BLOCK]
            np.matmul(rows[:, 0], first, out=x)
            y: Floats = rows[:, 1] @ first
            x -= second[0]
            y -= second[1]
            x *= x
            y *= y
            x += y
            np.sqrt(x, out=x)
            x *= normalization.scale
        return errors

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """The ``matrix`` from view 1 to view 2."""
        return {"matrix": in_pixels(point, normalization.centres, normalization.scale)}

    def _checked(self, linear: Floats, shift: Floats, valid: Flags) -> tuple[Floats, Flags]:
        points = np.zeros((len(linear), 3, 3))
        points[:, :2, :2], points[:, :2, 2], points[:, 2, 2] = linear, shift, 1.0
        valid = valid & np.isfinite(points).all(axis=(1, 2))
        return points, valid & is_plausible(linear)


def _solve_2x2(scatter: Floats, cross: Floats, rounding: Floats) -> tuple[Floats, Flags]:
    """Least-squares maps A [B, 2, 2] from the central moments, and which are well conditioned.

    ``scatter`` is that of view 1, ``cross`` the cross moments of both views, both [B, 2, 2];
    ``rounding`` [B] bounds the rounding errors. Closed form, because a solver is mostly overhead
    for 2 x 2 matrices.
    """
    xx, yy, xy = scatter[:, 0, 0], scatter[:, 1, 1], scatter[:, 0, 1]
    half_trace = 0.5 * (xx + yy)
    root = np.hypot(0.5 * (xx - yy), xy)
    least = np.maximum(1e-6 * np.maximum(half_trace + root, 1e-12), rounding)
    regular = np.asarray(half_trace - root > least)
    determinant = np.where(regular, xx * yy - xy * xy, 1.0)[:, None]
    cross_x, cross_y = cross[:, 0], cross[:, 1]
    columns = [
        (yy[:, None] * cross_x - xy[:, None] * cross_y) / determinant,
        (xx[:, None] * cross_y - xy[:, None] * cross_x) / determinant,
    ]
    return np.stack(columns, axis=2), regular


def is_plausible(linear: Floats) -> Flags:
    """Which linear maps [..., 2, 2] have a real logarithm and no extreme stretch."""
    trace = linear[..., 0, 0] + linear[..., 1, 1]
    determinant = linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]
    # the singular values follow from the Frobenius norm and the determinant
    square = (linear**2).sum(axis=(-2, -1))
    gap = np.sqrt(np.maximum(square**2 - 4 * determinant**2, 0.0))
    largest, least = np.sqrt((square + gap) / 2), np.sqrt(np.maximum(square - gap, 0.0) / 2)
    # if both eigenvalues are real and negative, there is no real logarithm
    reversed_axes = (trace < 0) & (trace**2 >= 4 * determinant)
    return np.asarray(
        (determinant > 0)
        & ~reversed_axes
        & (least > SINGULAR_VALUE_RANGE[0])
        & (largest < SINGULAR_VALUE_RANGE[1])
    )


def nearly_collinear(triangles: Floats) -> Flags:
    """Which triangles [..., 3, 2] are degenerate: collinear or a single point."""
    a, b = triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :]
    twice_area = np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    longest = np.maximum(
        np.maximum((a**2).sum(axis=-1), (b**2).sum(axis=-1)), ((a - b) ** 2).sum(axis=-1)
    )
    return np.asarray(twice_area <= MIN_RELATIVE_HEIGHT * longest + 1e-14)
