"""Subspaces of R^d: several principal component analyses at once."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.subspaces import leading_directions, rejections
from mssegment.manifolds import Grassmann, Manifold
from mssegment.models.base import Flags, drop_unweighted
from mssegment.models.data import DataModel, no_fits, vectors_of
from mssegment.records import Floats, Normalization

MIN_SINGULAR_VALUE_RATIO = 1e-9
"""Smallest singular value of a subset, relative to the largest; below it the vectors span fewer
dimensions, but for rounding errors."""


class Subspace(DataModel):
    """A linear subspace of dimension ``rank`` of R^d, a point of G(d, rank).

    An elemental subset is as many vectors; the residual is the distance from the subspace.
    """

    name: ClassVar[str] = "subspace"
    purpose: ClassVar[str] = "vectors that lie on several subspaces through the origin"
    has_ranks: ClassVar[bool] = True
    through_origin: ClassVar[bool] = True

    def __init__(self, dimension: int, rank: int) -> None:
        self.dimension, self.rank = dimension, rank
        self.manifold = Grassmann(dimension, rank)
        self.subset_size = rank
        self.parameters = rank * (dimension - rank)
        self.residual_dimension = dimension - rank

    @classmethod
    def build(cls, frames: int, rank: int, dimension: int = 2) -> Subspace:
        """Subspaces of dimension ``rank`` of R^``dimension``."""
        del frames
        return cls(dimension, rank)

    @classmethod
    def _for_manifold(cls, manifold: Manifold, frames: int, dimension: int) -> Subspace:
        del frames
        return cls(dimension, manifold.k if isinstance(manifold, Grassmann) else 1)

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Vectors of a random subspace."""
        axes, _ = np.linalg.qr(rng.standard_normal((self.dimension, self.rank)))
        return np.asarray(100.0 * (rng.uniform(-1.0, 1.0, (count, self.rank)) @ axes.T)[:, None])

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The span of as many vectors [B, rank, 1, d] as it has dimensions."""
        vectors = np.swapaxes(vectors_of(samples), 1, 2)
        basis, values, _ = np.linalg.svd(vectors, full_matrices=False)
        least = MIN_SINGULAR_VALUE_RATIO * np.maximum(values[:, 0], 1e-300)
        return basis, np.asarray(values[:, -1] > least)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The leading principal directions of the weighted vectors."""
        if not len(weights):
            return no_fits(self.manifold.point_shape)
        weights, observed = drop_unweighted(weights, observed)
        directions, values = leading_directions(vectors_of(observed), weights, self.rank)
        return directions, np.asarray(values[:, -1] > 1e-18 * np.maximum(values[:, 0], 1e-300))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distances from the subspaces [B, P], in the unit of the data."""
        squared = rejections(vectors_of(observed), points)
        return np.asarray(np.sqrt(squared) * normalization.scale)

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """``basis``: orthonormal columns, and ``origin``, which is that of the data."""
        del normalization
        return {"basis": point[None], "origin": np.zeros((1, self.dimension))}
