"""Similarity between two views: rotation, translation and scale, a point of Sim(2)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.manifolds.sim2 import Sim2
from mssegment.models.affine import Affine
from mssegment.models.base import Flags, drop_unweighted
from mssegment.records import Floats

SHORTEST = 0.02
"""Least distance between the two points of a subset, over the rms radius of all points."""


class Similarity(Affine):
    """x2 = s R x1 + t; an elemental subset is two matches, the residual is the transfer error."""

    name: ClassVar[str] = "similarity"
    purpose: ClassVar[str] = "objects that move in the picture plane, or towards the camera"
    in_auto: ClassVar[bool] = False

    def __init__(self) -> None:
        super().__init__()
        self.manifold = Sim2()
        self.subset_size = 2
        self.parameters = 4

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points under a similarity, 50 to 300 pixels from the origin."""
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        factor = rng.uniform(0.8, 1.2) * np.exp(1j * rng.uniform(-0.3, 0.3))
        turn = self.linear_part(self.restricted(np.asarray(factor)))
        return np.stack([x, x @ turn.T + rng.uniform(-15.0, 15.0, 2)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Least squares of two matches [B, 2, 2, 2]; invalid where the points are too near."""
        points, valid = self.fit(samples, np.ones(samples.shape[:2]))
        lengths = np.linalg.norm(samples[:, 1] - samples[:, 0], axis=-1)
        return points, valid & (lengths.min(axis=1) > SHORTEST)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Weighted least squares of the transfer error, in closed form.

        With points of the plane as complex numbers the motion is x2 = z x1 + t, z = s exp(i angle)
        (Umeyama, PAMI 1991, for two dimensions).
        """
        weights, own = drop_unweighted(weights, observed)
        views = np.broadcast_to(own[..., 0] + 1j * own[..., 1], (*weights.shape, 2))
        total = np.maximum(weights.sum(axis=1), 1e-300)
        means = (weights[:, None] @ views)[:, 0] / total[:, None]
        first, second = np.moveaxis(views - means[:, None], -1, 0)
        spread = (weights * np.abs(first) ** 2).sum(axis=1)
        size = (weights * np.abs(views[..., 0]) ** 2).sum(axis=1)
        valid = np.asarray(spread > 1e-12 * np.maximum(size, 1e-12))
        cross = (weights * np.conj(first) * second).sum(axis=1)
        factor = self.restricted(np.where(valid, cross, 1.0) / np.where(valid, spread, 1.0))
        shift = means[:, 1] - factor * means[:, 0]
        return self._checked(
            self.linear_part(factor), np.stack([shift.real, shift.imag], axis=-1), valid
        )

    def restricted(self, factors: np.ndarray) -> np.ndarray:
        """The complex factors s exp(i angle) [B] that the model allows: all of them."""
        return factors

    @staticmethod
    def linear_part(factors: np.ndarray) -> Floats:
        """The matrices s R [..., 2, 2] of complex factors s exp(i angle) [...]."""
        rows = [[factors.real, -factors.imag], [factors.imag, factors.real]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
