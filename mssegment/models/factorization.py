"""Tracks of one body under an affine camera: a k-dimensional subspace of R^2F, section 5.4."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.manifolds import Grassmann, Manifold
from mssegment.models.base import Flags, MotionModel, concentrated
from mssegment.records import Camera, Floats, Normalization

LEAST_SINGULAR_VALUE = 1e-3
"""Of a subset's vectors, over the largest one: below it they span fewer than k dimensions."""
CANCELLED = 1e-9
"""|w|^2 - |x'w|^2 over |w|^2 below which rounding would show in the residual."""


class Factorization(MotionModel):
    """Feature vectors of one motion span a subspace; its elemental subset is k tracks.

    ``rank`` k is 3 for planar bodies (the paper) and 4 in general. The residual is the distance
    to the subspace in pixels per frame.
    """

    name: ClassVar[str] = "factorization"
    purpose: ClassVar[str] = "sequences, tracks of your own tracker"
    in_auto: ClassVar[bool] = True
    has_ranks: ClassVar[bool] = True
    leaves_parallax_free: ClassVar[bool] = True
    marked_share: ClassVar[float] = 0.05
    min_frames: ClassVar[int] = 3
    max_frames: ClassVar[int | None] = None

    def __init__(
        self, frames: int, rank: int = 3, least_singular_value: float = LEAST_SINGULAR_VALUE
    ) -> None:
        """For ``frames`` frames; a subset is valid above ``least_singular_value``."""
        self.manifold = Grassmann(2 * frames, rank)
        self.frames = frames
        self.rank = rank
        self.least_singular_value = least_singular_value
        self.subset_size = rank
        self.parameters = rank * (2 * frames - rank)
        self.residual_dimension = 2 * frames - rank
        self.residual_terms = frames

    @classmethod
    def build(cls, frames: int, rank: int) -> Factorization:
        """Subspaces of dimension ``rank`` in R^(2 ``frames``)."""
        return cls(frames, rank)

    @classmethod
    def _for_manifold(cls, manifold: Manifold, frames: int) -> Factorization:
        return cls(frames, manifold.k if isinstance(manifold, Grassmann) else 3)

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """A body under an affine camera that turns at random from frame to frame."""
        shape = rng.uniform(-60.0, 60.0, (count, self.rank - 1))
        views = [shape @ rng.normal(size=(self.rank - 1, 2)) for _ in range(self.frames)]
        return np.stack([view + rng.uniform(100.0, 400.0, 2) for view in views], axis=1)

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """One origin for all frames, the middle of all tracks; divided by their rms radius.

        Centring each frame would take away the path that all tracks share: the subspace of a body
        that moves with the mean would lose a dimension.
        """
        del camera
        middle = points.mean(axis=(0, 1))
        radius = float(np.sqrt(((points - middle) ** 2).sum(axis=-1).mean()))
        return Normalization(np.tile(middle, (points.shape[1], 1)), max(radius, 1.0))

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The span of k feature vectors [B, k, F, 2] by an SVD; fewer dimensions are unsound."""
        vectors = np.swapaxes(samples.reshape(len(samples), self.rank, 2 * self.frames), 1, 2)
        basis, values, _ = np.linalg.svd(vectors, full_matrices=False)
        valid = values[:, -1] > self.least_singular_value * np.maximum(values[:, 0], 1e-12)
        return basis, np.asarray(valid)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The k leading principal directions of the weighted feature vectors."""
        if not weights.size:
            return np.zeros((0, *self.manifold.point_shape)), np.zeros(0, dtype=bool)
        # a hypothesis is fitted to a handful of tracks: the others have no weight
        weights, observed = concentrated(weights, observed)
        vectors = observed.reshape(*observed.shape[:-2], 2 * self.frames)
        if vectors.ndim == 3 and self.rank <= vectors.shape[1] < vectors.shape[2]:
            used = np.sqrt(weights)[..., None] * vectors
            values, axes = np.linalg.eigh(used @ np.swapaxes(used, 1, 2))
            leading = np.swapaxes(used, 1, 2) @ axes[:, :, : -self.rank - 1 : -1]
            directions = np.linalg.qr(leading).Q
        else:
            across = np.swapaxes(vectors, -1, -2) * weights[:, None]
            values, axes = np.linalg.eigh(across @ vectors)
            directions = axes[:, :, : -self.rank - 1 : -1]
        least = values[:, -self.rank]
        return directions, np.asarray(least > 1e-12 * np.maximum(values[:, -1], 1e-12))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distance to the subspace over sqrt(F), pixels [B, P]."""
        distance = self.algebraic_residuals(points, observed, normalization)
        return np.asarray(distance / np.sqrt(self.frames))

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """Distance of the feature vector to the subspace, pixels, as in the table of Fig. 3."""
        vectors = observed.reshape(*observed.shape[:-2], 2 * self.frames)
        along = vectors @ points
        whole = (vectors**2).sum(axis=-1)
        squared = whole - (along**2).sum(axis=2)
        # where this cancels, the rejected part itself is exact
        motion, track = np.nonzero(squared < CANCELLED * whole)
        across = vectors[track] if vectors.ndim == 2 else vectors[motion, track]
        across = across - (points[motion] @ along[motion, track, :, None])[..., 0]
        squared[motion, track] = (across**2).sum(axis=1)
        return np.asarray(np.sqrt(squared) * normalization.scale)

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared distances of the feature vectors to the subspaces, [P, B]."""
        vectors = observed.reshape(len(observed), -1)
        apart = np.repeat((vectors**2).sum(axis=1)[:, None], len(points), axis=1)
        for k in range(points.shape[2]):
            apart -= (vectors @ points[:, :, k].T) ** 2
        return np.asarray(np.maximum(apart, 0.0))

    def free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """The place of a track in the first frame, and k - 2 more coordinates in the subspace.

        Two of the k dimensions are where the track begins. The others say how it moves from frame
        to frame, so their extent is that of the displacements, not that of the picture.
        """
        points = observed * normalization.scale
        place = np.log(np.maximum(np.ptp(points[:, 0], axis=0), 1.0)).sum()
        displacement = np.ptp(np.diff(points, axis=1).reshape(-1, 2), axis=0).max()
        return float(place + (self.rank - 2) * np.log(max(displacement, 1.0)))
