"""Translation in space seen by a calibrated camera: a line of R^3, G(3,1), equation (25)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from mssegment.geometry.epipolar import (
    cheirality_residual_sq,
    cross,
    translation_errors,
    translation_jacobian,
)
from mssegment.geometry.levenberg_marquardt import State, minimize
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import rotate_rays, step_on_sphere
from mssegment.manifolds import Grassmann
from mssegment.models.base import Flags, drop_unweighted
from mssegment.models.calibrated import CalibratedModel, epipole_in_pixels, seen_by_example
from mssegment.records import Floats, Integers, Normalization

MIN_SINE = 0.01
"""Smallest sine of the angle between the two rows; below it their cross product is noise."""
NEAR_AXIS_DEGREES = 15.0
"""A translation within this many degrees of the optical axis counts as along it."""
FIT_ROUNDS = 8
FIT_TOLERANCE = 1e-6
"""Relative change of the cost at which a fit has converged."""


class Translation(CalibratedModel):
    """The translation t of the camera relative to the object, with t . (x1 x x2) = 0.

    An elemental subset is two matches; the residual is the Sampson distance.

    Notes
    -----
    A point of G(3,1) has no sign, but a translation has one: depths are positive, so all points of
    a motion move away from the epipole, or all towards it. The fits choose the sign of t
    accordingly. A match that moves the other way has a residual of the size of its displacement:
    the Sampson distance across the epipolar line and the displacement along it.
    """

    name: ClassVar[str] = "translation"
    purpose: ClassVar[str] = "a camera and rigid objects that translate"
    assumes_no_rotation: ClassVar[bool] = True
    min_displacement: ClassVar[float] = 2.0

    def __init__(self) -> None:
        self.manifold = Grassmann(3, 1)
        self.subset_size = 2
        self.parameters = 2
        self.residual_dimension = 1

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points at several depths that translate in front of ``EXAMPLE_CAMERA``."""
        space = self.example_space(rng, count, 300.0, 250.0)
        moved = space + np.array([0.12, -0.08, 0.2]) * rng.uniform(0.8, 1.2, 3)
        return seen_by_example(space, moved)

    def observe(self, points: Floats, normalization: Normalization) -> Floats:
        """Normalized image coordinates [P, 2, 2], view 2 in the orientation of view 1."""
        observed = super().observe(points, normalization)
        if normalization.rotation is not None:
            observed[:, 1] = rotate_rays(_rays(observed)[1], normalization.rotation)[:, :2]
        return observed

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The cross product of the rows of two matches [B, 2, 2, 2]; invalid for parallel rows."""
        rows = constraint_rows(samples)
        lengths = np.linalg.norm(rows, axis=-1)
        axis = np.cross(rows[:, 0], rows[:, 1])
        length = np.linalg.norm(axis, axis=-1)
        valid = length > MIN_SINE * lengths[:, 0] * lengths[:, 1] + 1e-16
        axis = np.where(valid[:, None], axis, [0.0, 0.0, 1.0])
        axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
        return orient(axis, samples, np.ones(samples.shape[:2]))[..., None], valid

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the Sampson distance, by Levenberg-Marquardt from ``algebraic_fit``.

        Equation (25) alone is biased: it weights a match by its distance from the epipole.
        """
        weights, matches = drop_unweighted(weights, observed)
        points, valid = self.algebraic_fit(matches, weights)

        def linearize(state: State, rows: Integers) -> tuple[Floats, Floats]:
            selected = matches if matches.ndim == 3 else matches[rows]
            return translation_jacobian(state[0], *_rays(selected))

        def retract(state: State, steps: Floats) -> State:
            return (step_on_sphere(state[0], steps),)

        (direction,) = minimize(
            (points[..., 0],),
            linearize,
            retract,
            rounds=FIT_ROUNDS,
            weights=weights,
            tolerance=FIT_TOLERANCE,
        )
        return orient(direction, matches, weights)[..., None], valid

    def algebraic_fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The unit vector that minimizes the weighted squares of equation (25)."""
        rows = constraint_rows(observed)
        scatter = np.swapaxes(rows, -1, -2) @ (weights[..., None] * rows)
        values, vectors = np.linalg.eigh(scatter)
        valid = values[:, 1] > 1e-10 * values[:, 2]
        return vectors[:, :, :1], np.asarray(valid & (values[:, 2] > 0))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distance from the half of the epipolar line in the direction of t, in pixels [B, P]."""
        errors = translation_errors(points[..., 0], *_rays(observed))
        squares = cheirality_residual_sq(*errors)
        return np.asarray(np.sqrt(squares) * normalization.scale)

    def displacements(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats | None:
        """Displacement along the half of the epipolar line in the direction of t, in pixels [B, P].

        At least zero.
        """
        along = translation_errors(points[..., 0], *_rays(observed))[1]
        return np.maximum(along * normalization.scale, 0.0)

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|t . (x1 x x2)| of equation (25), in normalized coordinates."""
        return np.asarray(np.abs(points[:, :, 0] @ constraint_rows(observed).T))

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """The ``direction`` of the object, which is -t, and the ``epipole`` in the first view."""
        direction = -point[:, 0] / np.linalg.norm(point)
        return {"direction": direction, "epipole": epipole_in_pixels(direction, normalization)}

    def remarks(self, labels: Sequence[int], points: Floats) -> tuple[str, ...]:
        """A warning about translations along the optical axis.

        Objects that move along the optical axis, in the direction of the camera or against it, have
        the same direction of translation whatever their speed.
        """
        axial = [
            str(label)
            for label, direction in zip(labels, points[..., 0], strict=True)
            if _degrees_from_axis(direction) < NEAR_AXIS_DEGREES
        ]
        if not axial:
            return ()
        return (
            f"motion {', '.join(axial)} is along the optical axis: objects that also move along "
            "it, at any speed, have the same direction and cannot be separated by model "
            "translation; use model affine or factorization for them",
        )


def orient(directions: Floats, matches: Floats, weights: Floats) -> Floats:
    """Choose the sign of unit directions so that the tracks move away from the epipole.

    Parameters
    ----------
    directions : ndarray [B, 3]
        Unit vectors.
    matches : ndarray [n, 2, 2] or [B, n, 2, 2]
        Matches in normalized coordinates.
    weights : ndarray [B, n]
        Weights of the matches.

    Returns
    -------
    ndarray [B, 3]
        The directions or their negatives.
    """
    along = translation_errors(directions, *_rays(matches))[1]
    return np.where((weights * along).sum(axis=1, keepdims=True) < 0, -directions, directions)


def _degrees_from_axis(direction: Floats) -> float:
    """Angle between a direction [3] and the optical axis, in degrees."""
    cosine = abs(direction[2]) / np.linalg.norm(direction)
    return float(np.degrees(np.arccos(min(cosine, 1.0))))


def constraint_rows(observed: Floats) -> Floats:
    """x1 x x2 of equation (25) for matches [..., 2, 2] in normalized coordinates, [..., 3]."""
    return cross(*_rays(observed))


def _rays(observed: Floats) -> tuple[Floats, Floats]:
    """The rays (x, y, 1) [..., P, 3] of both views of matches [..., P, 2, 2]."""
    return homogeneous(observed[..., 0, :]), homogeneous(observed[..., 1, :])
