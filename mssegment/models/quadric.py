"""Quadrics: spheres, cylinders and cones in a range image; circles and ellipses in the plane."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.levenberg_marquardt import State, minimize
from mssegment.geometry.rotations import step_on_sphere, tangent_basis
from mssegment.manifolds import Grassmann
from mssegment.models.base import Flags, drop_unweighted
from mssegment.models.data import DataModel, no_fits, vectors_of
from mssegment.records import Floats, Integers, Normalization

FIT_ROUNDS = 8
FIT_TOLERANCE = 1e-9
"""Relative change of the cost at which a fit has converged."""
MIN_SECOND_VALUE = 1e-14
"""Smallest second eigenvalue of the equations, relative to the largest; below it the points lie on
more than one quadric, as those of a plane do."""


class Quadric(DataModel):
    """x'Ax + b'x + c = 0; in homogeneous coordinates z'Qz = 0, a point of G(m, 1).

    An elemental subset is as many points as a quadric has degrees of freedom, m - 1: five in the
    plane, nine in space. The residual is the value of the equation over its gradient, the distance
    to first order.

    References
    ----------
    G. Taubin, "Estimation of planar curves, surfaces, and nonplanar space curves defined by
    implicit equations", PAMI 13, 1991.
    """

    name: ClassVar[str] = "quadric"
    purpose: ClassVar[str] = "spheres, cylinders and cones in a range image; circles in the plane"
    is_local: ClassVar[bool] = True

    def __init__(self, dimension: int) -> None:
        self.dimension = dimension
        self._rows, self._columns = np.triu_indices(dimension + 1)
        count = len(self._rows)
        self.manifold = Grassmann(count, 1)
        self.subset_size = self.parameters = count - 1
        self.residual_dimension = 1

    @classmethod
    def build(cls, frames: int, rank: int, dimension: int = 2) -> Quadric:
        """Quadrics of R^``dimension``."""
        del frames, rank
        return cls(dimension)

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points of a random ellipsoid."""
        on_sphere = rng.standard_normal((count, self.dimension))
        on_sphere /= np.linalg.norm(on_sphere, axis=1, keepdims=True)
        axes, _ = np.linalg.qr(rng.standard_normal((self.dimension, self.dimension)))
        stretched = on_sphere * rng.uniform(40.0, 90.0, self.dimension)
        centre = rng.uniform(-50.0, 50.0, self.dimension)
        return np.asarray((stretched @ axes.T + centre)[:, None])

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The quadric through m - 1 points, the vector orthogonal to their equations."""
        equations = self._monomials(vectors_of(samples))
        orthogonal, triangle = np.linalg.qr(np.swapaxes(equations, 1, 2), mode="complete")
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return orthogonal[:, :, -1:], np.asarray(sizes.min(axis=1) > 1e-9 * sizes.max(axis=1))

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the distance, by Levenberg-Marquardt from Taubin's fit."""
        if not len(weights):
            return no_fits(self.manifold.point_shape)
        weights, observed = drop_unweighted(weights, observed)
        vectors = vectors_of(observed)
        start, valid = self._taubin(vectors, weights)

        def linearize(state: State, rows: Integers) -> tuple[Floats, Floats]:
            selected = vectors if vectors.ndim == 2 else vectors[rows]
            error, derivatives = self._distance_and_derivatives(state[0], selected)
            return error, derivatives @ tangent_basis(state[0])

        def retract(state: State, steps: Floats) -> State:
            return (step_on_sphere(state[0], steps),)

        (found,) = minimize(
            (start,),
            linearize,
            retract,
            rounds=FIT_ROUNDS,
            weights=weights,
            tolerance=FIT_TOLERANCE,
        )
        return found[..., None], valid

    def algebraic_fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Taubin's fit: the generalized eigenvector of the equations and their gradients."""
        found, valid = self._taubin(vectors_of(observed), weights)
        return found[..., None], valid

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distances to first order [B, P], in the unit of the data."""
        vectors = vectors_of(observed)
        values, gradient = self._values(points[..., 0], vectors)
        steepness = np.sqrt(np.maximum((gradient**2).sum(axis=-1), 1e-300))
        return np.asarray(np.abs(values) / steepness * normalization.scale)

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """``matrix`` Q [d + 1, d + 1] with z'Qz = 0 for z = (x, 1), of norm 1."""
        upper = np.zeros((self.dimension + 1, self.dimension + 1))
        upper[self._rows, self._columns] = point[:, 0]
        own = (upper + upper.T) / 2.0
        to_own = np.eye(self.dimension + 1) / normalization.scale
        to_own[:-1, -1] = -normalization.centres[0] / normalization.scale
        to_own[-1, -1] = 1.0
        matrix = to_own.T @ own @ to_own
        return {"matrix": matrix / np.linalg.norm(matrix)}

    def _monomials(self, vectors: Floats) -> Floats:
        """The products z_i z_j, i <= j, of homogeneous coordinates [..., m]."""
        raised = np.concatenate([vectors, np.ones((*vectors.shape[:-1], 1))], axis=-1)
        return np.asarray(raised[..., self._rows] * raised[..., self._columns])

    def _gradients(self, vectors: Floats) -> Floats:
        """The derivatives of the monomials [..., d, m]."""
        raised = np.concatenate([vectors, np.ones((*vectors.shape[:-1], 1))], axis=-1)
        unit = np.eye(self.dimension, self.dimension + 1)
        left = unit[:, self._rows] * raised[..., None, self._columns]
        return np.asarray(left + unit[:, self._columns] * raised[..., None, self._rows])

    def _values(self, coefficients: Floats, vectors: Floats) -> tuple[Floats, Floats]:
        """The equations [B, P] and their gradients [B, P, d], from z'Qz."""
        size = self.dimension + 1
        symmetric = np.zeros((len(coefficients), size, size))
        symmetric[:, self._rows, self._columns] = coefficients
        symmetric = symmetric + np.swapaxes(symmetric, 1, 2)
        raised = np.concatenate([vectors, np.ones((*vectors.shape[:-1], 1))], axis=-1)
        gradient = raised @ symmetric
        return 0.5 * (gradient * raised).sum(axis=-1), gradient[..., :-1]

    def _distance_and_derivatives(
        self, coefficients: Floats, vectors: Floats
    ) -> tuple[Floats, Floats]:
        """Signed distances [B, P], and their derivatives in the coefficients [B, P, m]."""
        monomials, gradients = self._monomials(vectors), self._gradients(vectors)
        values, gradient = self._values(coefficients, vectors)
        length = np.sqrt(np.maximum((gradient**2).sum(axis=-1), 1e-300))
        along = np.einsum(
            "bpd,...pdm->bpm" if vectors.ndim == 2 else "bpd,bpdm->bpm", gradient, gradients
        )
        error = values / length
        return error, (monomials - (error / length)[..., None] * along) / length[..., None]

    def _taubin(self, vectors: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Unit vectors [B, m] that minimize the squared values over the squared gradients."""
        monomials, gradients = self._monomials(vectors), self._gradients(vectors)
        m = monomials.shape[-1]
        scatter = np.swapaxes(monomials, -1, -2) @ (weights[..., None] * monomials)
        if vectors.ndim == 2:
            outer = np.einsum("pdm,pdn->pmn", gradients, gradients).reshape(len(vectors), -1)
            slopes = (weights @ outer).reshape(len(weights), m, m)
        else:
            slopes = np.einsum("bp,bpdm,bpdn->bmn", weights, gradients, gradients, optimize=True)
        # the constant has no gradient, so the problem is turned round: largest slope over value
        values, axes = np.linalg.eigh(scatter)
        whitened = axes / np.sqrt(np.maximum(values, 1e-12 * values[:, -1:]) + 1e-300)[:, None]
        steepest = np.linalg.eigh(np.swapaxes(whitened, 1, 2) @ slopes @ whitened)[1][:, :, -1:]
        found = (whitened @ steepest)[..., 0]
        found /= np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300)
        return found, np.asarray(values[:, 1] > MIN_SECOND_VALUE * values[:, -1])
