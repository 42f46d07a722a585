"""Translation in space seen by a calibrated camera, a line of R^3: G(3,1), equation (25)."""

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
from mssegment.models.base import EXAMPLE_CAMERA, Flags, MotionModel, concentrated
from mssegment.records import Camera, Floats, Integers, Normalization

LEAST_SINE = 0.01
"""Sine of the angle between the two rows below which their cross product is noise."""
NEAR_AXIS = 15.0
"""Degrees from the optical axis within which a translation counts as along it."""
FIT_ROUNDS = 8
CONVERGED = 1e-6
"""Relative change of the error at which a fit is done."""


class Translation(MotionModel):
    """t . (x1 x x2) = 0; two matches span a hypothesis, the residual is the Sampson distance.

    A point on G(3,1) has no sign, a body has: its points lie in front of the camera, so that all
    of them move away from the epipole, or all towards it. The fits orient t to say which, and a
    match that goes the other way is as far from the motion as it moved (Sampson distance across
    the epipolar line, displacement along it).
    """

    name: ClassVar[str] = "translation"
    purpose: ClassVar[str] = "a camera and rigid objects that translate"
    needs_camera: ClassVar[bool] = True
    assumes_no_rotation: ClassVar[bool] = True
    leaves_parallax_free: ClassVar[bool] = True
    min_displacement: ClassVar[float] = 2.0

    def __init__(self) -> None:
        self.manifold = Grassmann(3, 1)
        self.subset_size = 2
        self.parameters = 2
        self.residual_dimension = 1

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points at several depths that translate in front of ``EXAMPLE_CAMERA``."""
        camera = EXAMPLE_CAMERA
        focal, middle = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
        x = rng.uniform([50.0, 50.0], [300.0, 250.0], (count, 2))
        space = homogeneous((x - middle) / focal) * rng.uniform(3.0, 5.0, (count, 1))
        moved = space + np.array([0.12, -0.08, 0.2]) * rng.uniform(0.8, 1.2, 3)
        return np.stack([s[:, :2] / s[:, 2:] * focal + middle for s in (space, moved)], axis=1)

    def normalization(self, points: Floats, camera: Camera | None = None) -> Normalization:
        """Calibrated rays (x, y, 1): the principal point is the origin, the focal length 1.

        Raises ValueError without a camera.
        """
        if camera is None:
            raise ValueError("translation needs a camera")
        centres = np.tile([camera.cx, camera.cy], (points.shape[1], 1))
        return Normalization(centres, camera.fx, camera.fy / camera.fx)

    def observe(self, points: Floats, normalization: Normalization) -> Floats:
        """Normalised image coordinates [P, 2, 2], the second view in the first's orientation."""
        focal = normalization.scale * np.array([1.0, normalization.aspect])
        observed = np.asarray((points - normalization.centres) / focal)
        if normalization.rotation is not None:
            observed[:, 1] = rotate_rays(_rays(observed)[1], normalization.rotation)[:, :2]
        return observed

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The cross product of the rows of two matches [B, 2, 2, 2]; parallel rows are unsound."""
        rows = constraint_rows(samples)
        lengths = np.linalg.norm(rows, axis=-1)
        axis = np.cross(rows[:, 0], rows[:, 1])
        length = np.linalg.norm(axis, axis=-1)
        valid = length > LEAST_SINE * lengths[:, 0] * lengths[:, 1] + 1e-16
        axis = np.where(valid[:, None], axis, [0.0, 0.0, 1.0])
        axis = axis / np.linalg.norm(axis, axis=-1, keepdims=True)
        return oriented(axis, samples, np.ones(samples.shape[:2]))[..., None], valid

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the Sampson distance, by Levenberg-Marquardt from that of (25).

        (25) weighs a match by its distance from the epipole and is biased.
        """
        weights, matches = concentrated(weights, observed)
        points, valid = self.algebraic_fit(matches, weights)

        def linearize(state: State, rows: Integers) -> tuple[Floats, Floats]:
            own = matches if matches.ndim == 3 else matches[rows]
            return translation_jacobian(state[0], *_rays(own))

        def retract(state: State, steps: Floats) -> State:
            return (step_on_sphere(state[0], steps),)

        (direction,) = minimize(
            (points[..., 0],),
            linearize,
            retract,
            rounds=FIT_ROUNDS,
            weights=weights,
            tolerance=CONVERGED,
        )
        return oriented(direction, matches, weights)[..., None], valid

    def algebraic_fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """The direction that minimizes the weighted square of (25)."""
        rows = constraint_rows(observed)
        scatter = np.swapaxes(rows, -1, -2) @ (weights[..., None] * rows)
        values, vectors = np.linalg.eigh(scatter)
        valid = values[:, 1] > 1e-10 * values[:, 2]
        return vectors[:, :, :1], np.asarray(valid & (values[:, 2] > 0))

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distance from the half of the epipolar line on the side of t, pixels [B, P]."""
        errors = translation_errors(points[..., 0], *_rays(observed))
        squares = cheirality_residual_sq(*errors)
        return np.asarray(np.sqrt(squares) * normalization.scale)

    def displacements(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats | None:
        """Along the half of the epipolar line on the side of t, pixels [B, P], at least zero."""
        along = translation_errors(points[..., 0], *_rays(observed))[1]
        return np.maximum(along * normalization.scale, 0.0)

    def orientations(self, points: Floats) -> Floats:
        """t and -t: a mode is a line without a sign."""
        return np.concatenate([points, -points])

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|t . (x1 x x2)| of equation (25), normalised coordinates."""
        return np.asarray(np.abs(points[:, :, 0] @ constraint_rows(observed).T))

    def remarks(self, labels: Sequence[int], points: Floats) -> tuple[str, ...]:
        """A warning where directions lie along the optical axis.

        Bodies that move along the optical axis with the camera, or against it, all have the same
        direction of translation, however fast.
        """
        axial = [
            str(label)
            for label, direction in zip(labels, points[..., 0], strict=True)
            if _degrees_from_axis(direction) < NEAR_AXIS
        ]
        if not axial:
            return ()
        return (
            f"motion {', '.join(axial)} lies along the optical axis: bodies that move along it "
            "too, at any speed, have the same direction and cannot be told apart by model "
            "translation; choose model affine or factorization for them",
        )

    def free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """Along its half of the epipolar line a match may move as far as any match does."""
        shift = (observed[:, 1] - observed[:, 0]) * normalization.scale
        return float(np.log(max(np.linalg.norm(shift, axis=1).max(initial=0.0), 1.0)))


def oriented(directions: Floats, matches: Floats, weights: Floats) -> Floats:
    """The unit directions [B, 3], signed so that the ``weights`` [B, n] move away from the epipole.

    ``matches`` are [n, 2, 2] or [B, n, 2, 2].
    """
    along = translation_errors(directions, *_rays(matches))[1]
    return np.where((weights * along).sum(axis=1, keepdims=True) < 0, -directions, directions)


def _degrees_from_axis(direction: Floats) -> float:
    cosine = abs(direction[2]) / np.linalg.norm(direction)
    return float(np.degrees(np.arccos(min(cosine, 1.0))))


def constraint_rows(observed: Floats) -> Floats:
    """x1 x x2 of equation (25) for matches [..., 2, 2] in normalized coordinates, [..., 3]."""
    return cross(*_rays(observed))


def _rays(observed: Floats) -> tuple[Floats, Floats]:
    """The rays (x, y, 1) [..., P, 3] of both views of matches [..., P, 2, 2]."""
    return homogeneous(observed[..., 0, :]), homogeneous(observed[..., 1, :])
