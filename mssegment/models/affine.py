"""Affine motion between two views, a point of the affine group A(2), equation (26)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.manifolds import AffineGroup
from mssegment.models.base import Flags, MotionModel, weighted_sums
from mssegment.records import Floats, Normalization

FLATTEST = 0.02
"""Least height of an elemental triangle, over its longest side."""
ROWS = 32
"""Motions whose residuals are computed at a time."""
STRETCH = (0.2, 5.0)
"""Singular values of A between which a motion is not absurd."""


class Affine(MotionModel):
    """x2 = A x1 + b; an elemental subset is three matches, the residual is the transfer error."""

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
        """Points under a map that turns, stretches and shifts."""
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        linear = np.array([[1.1, -0.1], [0.15, 0.95]]) + rng.uniform(-0.05, 0.05, (2, 2))
        return np.stack([x, x @ linear.T + rng.uniform(-15.0, 15.0, 2)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Three matches [B, 3, 2, 2] give A exactly; slivers and wild stretches are unsound."""
        valid = ~(is_flat(samples[:, :, 0]) | is_flat(samples[:, :, 1]))
        edges1 = np.swapaxes(samples[:, 1:, 0] - samples[:, :1, 0], 1, 2)
        edges2 = np.swapaxes(samples[:, 1:, 1] - samples[:, :1, 1], 1, 2)
        edges1 = np.where(valid[:, None, None], edges1, np.eye(2))
        linear = edges2 @ np.linalg.inv(edges1)
        shift = samples[:, 0, 1] - np.einsum("bij,bj->bi", linear, samples[:, 0, 0])
        return self._checked(linear, shift, valid)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Weighted least squares of the transfer error, from the weighted moments of the tracks.

        All motions take their moments from one matrix product. Coordinates have the size of one, so
        that moments about the origin lose no digit that matters against those about a centroid.
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
        across, down, skew = scatter[:, 0, 0], scatter[:, 1, 1], scatter[:, 0, 1]
        middle = 0.5 * (across + down)
        root = np.hypot(0.5 * (across - down), skew)
        rounding = 1e-14 * np.trace(second[:, :, :2], axis1=1, axis2=2)
        least = np.maximum(1e-6 * np.maximum(middle + root, 1e-12), rounding)
        valid = (total > 0) & (middle - root > least)
        # the inverse of the scatter by hand: of 2 x 2 matrices a solver is mostly overhead
        determinant = np.where(valid, across * down - skew * skew, 1.0)[:, None]
        own, other = cross[:, 0], cross[:, 1]
        linear = np.stack(
            [
                (down[:, None] * own - skew[:, None] * other) / determinant,
                (across[:, None] * other - skew[:, None] * own) / determinant,
            ],
            axis=2,
        )
        middle1, middle2 = mean1 + origin[..., 0, 0, :], mean2 + origin[..., 0, 1, :]
        shift = middle2 - np.einsum("bij,bj->bi", linear, middle1)
        return self._checked(linear, shift, valid)

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Transfer error in view 2, pixels [B, P]."""
        if observed.ndim == 4:
            images = observed[:, :, 0] @ np.swapaxes(points[:, :2, :2], 1, 2)
            images += points[:, None, :2, 2]
            images -= observed[:, :, 1]
            return np.asarray(np.linalg.norm(images, axis=-1) * normalization.scale)
        place = np.concatenate([observed[:, 0], np.ones((len(observed), 1))], axis=1).T
        target = np.ascontiguousarray(observed[:, 1].T)
        errors = np.empty((len(points), len(observed)))
        # blocks of rows that stay in the cache take a third of the time of all at once
        for start in range(0, len(points), ROWS):
            across = errors[start : start + ROWS]
            rows = points[start : start + ROWS]
            np.matmul(rows[:, 0], place, out=across)
            down: Floats = rows[:, 1] @ place
            across -= target[0]
            down -= target[1]
            across *= across
            down *= down
            across += down
            np.sqrt(across, out=across)
            across *= normalization.scale
        return errors

    def _checked(self, linear: Floats, shift: Floats, valid: Flags) -> tuple[Floats, Flags]:
        points = np.zeros((len(linear), 3, 3))
        points[:, :2, :2], points[:, :2, 2], points[:, 2, 2] = linear, shift, 1.0
        valid = valid & np.isfinite(points).all(axis=(1, 2))
        return points, valid & is_plausible(linear)


def is_plausible(linear: Floats) -> Flags:
    """Which linear maps [..., 2, 2] have a real logarithm and stretch nothing absurdly."""
    trace = linear[..., 0, 0] + linear[..., 1, 1]
    determinant = linear[..., 0, 0] * linear[..., 1, 1] - linear[..., 0, 1] * linear[..., 1, 0]
    # singular values from |A|^2 and det A
    square = (linear**2).sum(axis=(-2, -1))
    gap = np.sqrt(np.maximum(square**2 - 4 * determinant**2, 0.0))
    largest, least = np.sqrt((square + gap) / 2), np.sqrt(np.maximum(square - gap, 0.0) / 2)
    # both eigenvalues real and negative: no real logarithm
    reversed_axes = (trace < 0) & (trace**2 >= 4 * determinant)
    return np.asarray(
        (determinant > 0) & ~reversed_axes & (least > STRETCH[0]) & (largest < STRETCH[1])
    )


def is_flat(triangles: Floats) -> Flags:
    """Which triangles [..., 3, 2] are slivers or a single point."""
    a, b = triangles[..., 1, :] - triangles[..., 0, :], triangles[..., 2, :] - triangles[..., 0, :]
    twice_area = np.abs(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
    longest = np.maximum(
        np.maximum((a**2).sum(axis=-1), (b**2).sum(axis=-1)), ((a - b) ** 2).sum(axis=-1)
    )
    return np.asarray(twice_area <= FLATTEST * longest + 1e-14)
