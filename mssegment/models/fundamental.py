"""Rigid motion under a perspective camera: a fundamental matrix up to scale, in G(9,1)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.epipolar import sampson, sampson_jacobian
from mssegment.geometry.levenberg_marquardt import State, minimize
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import rotation, step_on_sphere, tangent_basis
from mssegment.manifolds import Grassmann
from mssegment.models.base import Flags, MotionModel, drop_unweighted
from mssegment.records import Floats, Integers, Normalization

FIT_ROUNDS = 10
FIT_TOLERANCE = 1e-9
"""Relative change of the cost at which a fit has converged."""


class Fundamental(MotionModel):
    """The fundamental matrix F with x2' F x1 = 0.

    An elemental subset is eight matches; the residual is the Sampson distance. The nine entries of
    F are a line through the origin of R^9. Rank 2 is not enforced, so that a hypothesis is linear
    in its elemental subset.
    """

    name: ClassVar[str] = "fundamental"
    purpose: ClassVar[str] = "evidence: rigid motions between two frames of a long sequence"
    leaves_parallax_free: ClassVar[bool] = True
    sampling_neighbours: ClassVar[int] = 24

    def __init__(self) -> None:
        self.manifold = Grassmann(9, 1)
        self.subset_size = 8
        self.parameters = 8
        self.residual_dimension = 1

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points in space that rotate and move in front of a perspective camera."""
        shape = rng.normal(size=(count, 3)) * 0.5
        views = []
        for angle, shift in ((0.0, 0.0), (0.3, 0.5)):
            pose = rotation(angle * rng.normal(size=3))
            space = shape @ pose.T + [0.0, 0.0, 4.0] + shift * rng.uniform(-1.0, 1.0, 3)
            views.append(500.0 * space[:, :2] / space[:, 2:] + [320.0, 240.0])
        return np.stack(views, axis=1)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The eight-point algorithm: the vector orthogonal to the eight equations."""
        equations = _equations(samples)
        orthogonal, triangle = np.linalg.qr(np.swapaxes(equations, 1, 2), mode="complete")
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return orthogonal[:, :, -1:], np.asarray(sizes.min(axis=1) > 1e-9 * sizes.max(axis=1))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the Sampson distance, by Levenberg-Marquardt from ``algebraic_fit``."""
        weights, matches = drop_unweighted(weights, observed)
        points, valid = self.algebraic_fit(matches, weights)

        def linearize(state: State, rows: Integers) -> tuple[Floats, Floats]:
            selected = matches if matches.ndim == 3 else matches[rows]
            error, derivatives = sampson_jacobian(state[0].reshape(-1, 3, 3), *_rays(selected))
            return error, derivatives @ tangent_basis(state[0])

        def retract(state: State, steps: Floats) -> State:
            return (step_on_sphere(state[0], steps),)

        (vectors,) = minimize(
            (points[..., 0],),
            linearize,
            retract,
            rounds=FIT_ROUNDS,
            weights=weights,
            tolerance=FIT_TOLERANCE,
        )
        return vectors[..., None], valid

    def algebraic_fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The unit vector of nine entries that minimizes the weighted squares of x2' F x1."""
        equations = _equations(observed)
        scatter = np.swapaxes(equations, -1, -2) @ (weights[..., None] * equations)
        values, vectors = np.linalg.eigh(scatter)
        return vectors[:, :, :1], np.asarray(values[:, 1] > 1e-14 * values[:, 8])

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Sampson distance in pixels [B, P]."""
        error = sampson(points.reshape(-1, 3, 3), *_rays(observed)).error
        return np.abs(error) * normalization.scale

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|x2' F x1| with |F| = 1, in normalized coordinates."""
        return np.asarray(np.abs(points[..., 0] @ _equations(observed).T))


def _rays(observed: Floats) -> tuple[Floats, Floats]:
    """The rays (x, y, 1) [..., P, 3] of both views of matches [..., P, 2, 2]."""
    return homogeneous(observed[..., 0, :]), homogeneous(observed[..., 1, :])


def _equations(observed: Floats) -> Floats:
    """The coefficients [..., P, 9] of x2' F x1 in the entries of F, for matches [..., P, 2, 2]."""
    first, second = _rays(observed)
    products = second[..., :, None] * first[..., None, :]
    return np.asarray(products.reshape(*products.shape[:-2], 9))
