"""Tracks of one motion under an affine camera: a k-dimensional subspace of R^2F, section 5.4."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.subspaces import leading_directions, rejections
from mssegment.manifolds import Grassmann, Manifold
from mssegment.models.base import Flags, MotionModel, drop_unweighted
from mssegment.records import Camera, Floats, Normalization

MIN_SINGULAR_VALUE_RATIO = 1e-3
"""Smallest singular value of the vectors of a subset, relative to the largest; below it they span
fewer than k dimensions."""


class Factorization(MotionModel):
    """The trajectories of one motion span a subspace of dimension ``rank`` in R^2F.

    An elemental subset is k tracks, where the rank k is 3 for planar motions (as in the paper) and
    4 in general. The residual is the distance to the subspace in pixels per frame.
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
        self, frames: int, rank: int = 3, min_singular_value_ratio: float = MIN_SINGULAR_VALUE_RATIO
    ) -> None:
        """For ``frames`` frames; a subset is valid above ``min_singular_value_ratio``."""
        self.manifold = Grassmann(2 * frames, rank)
        self.frames = frames
        self.rank = rank
        self.min_singular_value_ratio = min_singular_value_ratio
        self.subset_size = rank
        self.parameters = rank * (2 * frames - rank)
        self.residual_dimension = 2 * frames - rank
        self.residual_terms = frames

    @classmethod
    def build(cls, frames: int, rank: int, dimension: int = 2) -> Factorization:
        """Subspaces of dimension ``rank`` in R^(2 ``frames``)."""
        del dimension
        return cls(frames, rank)

    @classmethod
    def _for_manifold(cls, manifold: Manifold, frames: int, dimension: int) -> Factorization:
        del dimension
        return cls(frames, manifold.k if isinstance(manifold, Grassmann) else 3)

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """A rigid object under an affine camera in a new random pose in each frame."""
        shape = rng.uniform(-60.0, 60.0, (count, self.rank - 1))
        views = [shape @ rng.normal(size=(self.rank - 1, 2)) for _ in range(self.frames)]
        return np.stack([view + rng.uniform(100.0, 400.0, 2) for view in views], axis=1)

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """One origin for all frames, the mean of all positions; divided by their rms radius.

        Centring each frame would subtract the path that all tracks share, and the subspace of a
        motion along the mean path would lose a dimension.
        """
        del camera
        middle = points.mean(axis=(0, 1))
        radius = float(np.sqrt(((points - middle) ** 2).sum(axis=-1).mean()))
        return Normalization(np.tile(middle, (points.shape[1], 1)), max(radius, 1.0))

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The span of k trajectories [B, k, F, 2] by an SVD; invalid below dimension k."""
        vectors = np.swapaxes(samples.reshape(len(samples), self.rank, 2 * self.frames), 1, 2)
        basis, values, _ = np.linalg.svd(vectors, full_matrices=False)
        valid = values[:, -1] > self.min_singular_value_ratio * np.maximum(values[:, 0], 1e-12)
        return basis, np.asarray(valid)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The k leading principal directions of the weighted trajectories."""
        if not weights.size:
            return np.zeros((0, *self.manifold.point_shape)), np.zeros(0, dtype=bool)
        # most tracks have no weight when a hypothesis is fitted to a few of them
        weights, observed = drop_unweighted(weights, observed)
        vectors = observed.reshape(*observed.shape[:-2], 2 * self.frames)
        directions, values = leading_directions(vectors, weights, self.rank)
        least, most = values[:, -1], values[:, 0]
        return directions, np.asarray(least > 1e-12 * np.maximum(most, 1e-12))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distance to the subspace over sqrt(F), in pixels [B, P]."""
        distance = self.algebraic_residuals(points, observed, normalization)
        return np.asarray(distance / np.sqrt(self.frames))

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """Distance of the trajectory to the subspace, in pixels, as in the table of Fig. 3."""
        vectors = observed.reshape(*observed.shape[:-2], 2 * self.frames)
        squared = rejections(vectors, points)
        return np.asarray(np.sqrt(squared) * normalization.scale)

    def ranking_sq_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared distances of the trajectories to the subspaces, normalized, [P, B]."""
        vectors = observed.reshape(len(observed), -1)
        apart = np.repeat((vectors**2).sum(axis=1)[:, None], len(points), axis=1)
        for k in range(points.shape[2]):
            apart -= (vectors @ points[:, :, k].T) ** 2
        return np.asarray(np.maximum(apart, 0.0))

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """``basis`` and ``origin``: the subspace in pixels."""
        basis = point.reshape(self.frames, 2, self.rank) * normalization.scale
        return {"basis": basis, "origin": normalization.centres}

    def log_free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """The position of a track in the first frame, and k - 2 more coordinates in the subspace.

        Two of the k dimensions are the position in the first frame. The others describe the motion
        from frame to frame, so their extent is that of the displacements, not that of the image.
        """
        points = observed * normalization.scale
        position = np.log(np.maximum(np.ptp(points[:, 0], axis=0), 1.0)).sum()
        displacement = np.ptp(np.diff(points, axis=1).reshape(-1, 2), axis=0).max()
        return float(position + (self.rank - 2) * np.log(max(displacement, 1.0)))
