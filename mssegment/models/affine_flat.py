"""What lines, planes and hyperplanes have in common: they are affine flats of R^d."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.affine_flats import (
    distance_to_flat,
    distance_to_hyperplane,
    flat,
    foot_and_directions,
    hyperplane,
)
from mssegment.manifolds import Grassmann
from mssegment.models.base import Flags, drop_unweighted
from mssegment.models.data import DataModel, no_fits, vectors_of
from mssegment.records import Floats, Normalization

MIN_DIAGONAL_RATIO = 1e-9
"""Smallest diagonal entry of the triangular factor of a subset, relative to the largest; below it
the points span fewer dimensions, but for rounding errors."""


class AffineFlat(DataModel):
    """A flat of k dimensions in R^d; the residual is the distance from it.

    The hypotheses are points of G(d + 1, k + 1), or for hyperplanes, whose normals say the same
    with fewer numbers, of G(d + 1, 1).
    """

    def __init__(self, dimension: int, k: int) -> None:
        self.dimension, self.k = dimension, k
        self.is_hyperplane = k == dimension - 1
        self.manifold = Grassmann(dimension + 1, 1 if self.is_hyperplane else k + 1)
        self.subset_size = k + 1
        self.parameters = (k + 1) * (dimension - k)
        self.residual_dimension = dimension - k

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points of a random flat."""
        axes, _ = np.linalg.qr(rng.standard_normal((self.dimension, self.k)))
        on_it = rng.uniform(-1.0, 1.0, (count, self.k)) @ axes.T + rng.uniform(-1, 1, axes.shape[0])
        return np.asarray(100.0 * on_it[:, None])

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The flats through k + 1 points [B, k + 1, 1, d]."""
        vectors = vectors_of(samples)
        first = vectors[:, 0]
        away = np.swapaxes(vectors[:, 1:] - first[:, None], 1, 2)
        axes, triangle = np.linalg.qr(away, mode="complete")
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        reach = np.abs(vectors).max(axis=(1, 2)) if vectors.size else np.zeros(len(vectors))
        valid = sizes.min(axis=1) > MIN_DIAGONAL_RATIO * np.maximum(sizes.max(axis=1), reach)
        return self._points(first, axes), np.asarray(valid)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The weighted mean and the k leading principal directions about it."""
        if not len(weights):
            return no_fits(self.manifold.point_shape)
        weights, observed = drop_unweighted(weights, observed)
        vectors = vectors_of(observed)
        total = np.maximum(weights.sum(axis=1), 1e-300)
        if vectors.ndim == 2:
            mean = (weights @ vectors) / total[:, None]
        else:
            mean = (weights[:, None] @ vectors)[:, 0] / total[:, None]
        away = vectors - mean[:, None]
        scatter = np.swapaxes(away, 1, 2) @ (weights[..., None] * away)
        values, axes = np.linalg.eigh(scatter)
        spread = values[:, -self.k] if self.k else values[:, -1]
        valid = spread > 1e-18 * np.maximum(total * (mean**2).sum(axis=1), values[:, -1])
        return self._points(mean, axes[:, :, ::-1]), np.asarray(valid)

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distances from the flats [B, P], in the unit of the data."""
        distance = distance_to_hyperplane if self.is_hyperplane else distance_to_flat
        return np.asarray(distance(points, vectors_of(observed)) * normalization.scale)

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """``coefficients`` (n, -c) of n'x = c with |n| = 1, or ``basis`` and ``origin``."""
        centre, unit = normalization.centres[0], normalization.scale
        if self.is_hyperplane:
            normal = point[:-1, 0] / np.linalg.norm(point[:-1, 0])
            offset = unit * point[-1, 0] / np.linalg.norm(point[:-1, 0]) - normal @ centre
            sign = -1.0 if normal[np.argmax(np.abs(normal))] < 0 else 1.0
            return {"coefficients": sign * np.append(normal, offset)}
        foot, directions = foot_and_directions(point[None])
        origin = centre + unit * foot[0]
        return {"basis": directions, "origin": origin[None]}

    def _points(self, on_it: Floats, axes: Floats) -> Floats:
        """The flats through points [B, d] along the first k of the orthonormal ``axes``."""
        if self.is_hyperplane:
            return hyperplane(axes[:, :, self.k], on_it)
        return flat(on_it, axes[:, :, : self.k])
