"""A planar patch under an affine camera: an affine 2-flat of R^4, a point of G(5,3)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.affine_flats import foot_and_directions
from mssegment.geometry.projective import homogeneous
from mssegment.manifolds import Grassmann
from mssegment.models.base import Flags, MotionModel, drop_unweighted
from mssegment.records import Floats, Normalization

MIN_DIAGONAL_RATIO = 1e-6
"""Smallest diagonal entry of the triangular factor of a subset, relative to the largest; below
it the matches are collinear."""


class Flat(MotionModel):
    """The matches (x, y, x', y') of a planar patch lie on a 2-flat of R^4.

    In homogeneous coordinates an affine k-flat of R^n is a (k + 1)-dimensional subspace of R^(n +
    1), so three matches determine a point of G(5,3). The residual is the distance to the flat over
    sqrt(2), in pixels per frame, which treats both views alike.
    """

    name: ClassVar[str] = "flat"
    purpose: ClassVar[str] = "evidence: patches between two frames of a long sequence"
    leaves_parallax_free: ClassVar[bool] = True
    is_local: ClassVar[bool] = True

    def __init__(self) -> None:
        self.manifold = Grassmann(5, 3)
        self.subset_size = 3
        self.parameters = 6
        self.residual_dimension = 2
        self.residual_terms = 2

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points under a random affine map."""
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        linear = np.eye(2) + rng.uniform(-0.2, 0.2, (2, 2))
        return np.stack([x, x @ linear.T + rng.uniform(-15.0, 15.0, 2)], axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Orthonormal bases of the spans of three homogeneous matches [B, 3, 2, 2]."""
        raised = homogeneous(samples.reshape(len(samples), 3, 4))
        basis, triangle = np.linalg.qr(np.swapaxes(raised, 1, 2))
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return basis, np.asarray(sizes.min(axis=1) > MIN_DIAGONAL_RATIO * sizes.max(axis=1))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The weighted mean match and the two leading principal directions about it."""
        weights, observed = drop_unweighted(weights, observed)
        matches = np.broadcast_to(observed.reshape(*observed.shape[:-2], 4), (*weights.shape, 4))
        total = np.maximum(weights.sum(axis=1), 1e-300)
        mean = (weights[:, None] @ matches)[:, 0] / total[:, None]
        away = matches - mean[:, None]
        scatter = np.swapaxes(away, 1, 2) @ (weights[..., None] * away)
        values, axes = np.linalg.eigh(scatter)
        level = np.concatenate([axes[:, :, :1:-1], np.zeros((len(axes), 1, 2))], axis=1)
        basis, _ = np.linalg.qr(np.concatenate([homogeneous(mean)[..., None], level], axis=2))
        return basis, np.asarray(values[:, 2] > 1e-12 * np.maximum(values[:, 3], 1e-12))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distance to the flat over sqrt(2), in pixels [B, P]."""
        foot, directions = foot_and_directions(points)
        offset = observed.reshape(*observed.shape[:-2], 4) - foot[:, None]
        rejected = offset - offset @ directions @ np.swapaxes(directions, 1, 2)
        distance = np.linalg.norm(rejected, axis=-1)
        return np.asarray(distance * (normalization.scale / np.sqrt(2)))

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared distances to the flats in R^4, [P, B], by matrix products alone."""
        matches = observed.reshape(len(observed), 4)
        foot, directions = foot_and_directions(points)
        apart = (matches**2).sum(axis=1)[:, None] + (foot**2).sum(axis=1) - 2 * matches @ foot.T
        for k in range(directions.shape[2]):
            axis = directions[:, :, k]
            along = matches @ axis.T - (foot * axis).sum(axis=1)
            apart -= along**2
        return np.asarray(np.maximum(apart, 0.0))
