"""Translation in space seen by a calibrated camera, a line of R^3: G(3,1), equation (25)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment import manifolds
from mssegment.geometry.epipolar import cheirality_residual_sq, cross, distances
from mssegment.models.base import Flags, MotionModel, concentrated
from mssegment.records import Camera, Floats, Integers, Normalization

LEAST_SINE = 0.01
"""Sine of the angle between the two rows below which their cross product is noise."""
GAUSS_NEWTON_ROUNDS = 8
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
    needs_camera: ClassVar[bool] = True
    min_displacement: ClassVar[float] = 2.0

    def __init__(self) -> None:
        self.manifold = manifolds.from_name("grassmann(3,1)")
        self.subset_size = 2
        self.parameters = 2
        self.residual_dimension = 1

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
            turned = rays(observed[:, 1]) @ normalization.rotation.T
            observed[:, 1] = turned[:, :2] / turned[:, 2:]
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
        """Least squares of the Sampson distance: (25) first, then Gauss-Newton on the sphere.

        (25) weighs a match by its distance from the epipole and is biased; a damped step that
        would raise the error is not taken.
        """
        weights, matches = concentrated(weights, observed)
        points, valid = self.algebraic_fit(matches, weights)
        direction = points[..., 0]
        damping = np.full(len(weights), 1e-3)
        error, jacobian = sampson(direction, matches)
        cost = (weights * error**2).sum(axis=1)
        moving = np.arange(len(weights))
        for _ in range(GAUSS_NEWTON_ROUNDS):
            own, here = weights[moving], _of(matches, moving)
            step = _sphere_step(direction[moving], own, error, jacobian, damping[moving])
            proposed = direction[moving] + step
            proposed /= np.linalg.norm(proposed, axis=1, keepdims=True)
            new_error, new_jacobian = sampson(proposed, here)
            new_cost = (own * new_error**2).sum(axis=1)
            better = new_cost < cost[moving]
            settled = np.abs(new_cost - cost[moving]) <= CONVERGED * cost[moving]
            direction[moving[better]] = proposed[better]
            cost[moving[better]] = new_cost[better]
            damping[moving] *= np.where(better, 0.1, 10.0)
            error = np.where(better[:, None], new_error, error)[~settled]
            jacobian = np.where(better[:, None, None], new_jacobian, jacobian)[~settled]
            moving = moving[~settled]
            if not len(moving):
                break
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
        first, second = rays(observed[..., 0, :]), rays(observed[..., 1, :])
        squares = cheirality_residual_sq(*distances(points[..., 0], first, second))
        return np.asarray(np.sqrt(squares) * normalization.scale)

    def displacements(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats | None:
        """Along the half of the epipolar line on the side of t, pixels [B, P], at least zero."""
        first, second = rays(observed[:, 0]), rays(observed[:, 1])
        along = distances(points[..., 0], first, second)[1]
        return np.maximum(along * normalization.scale, 0.0)

    def orientations(self, points: Floats) -> Floats:
        """t and -t: a mode is a line without a sign."""
        return np.concatenate([points, -points])

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|t . (x1 x x2)| of equation (25), normalised coordinates."""
        return np.asarray(np.abs(points[:, :, 0] @ constraint_rows(observed).T))

    def free_extent(self, observed: Floats, normalization: Normalization) -> float:
        """Along its half of the epipolar line a match may move as far as any match does."""
        shift = (observed[:, 1] - observed[:, 0]) * normalization.scale
        return float(np.log(max(np.linalg.norm(shift, axis=1).max(initial=0.0), 1.0)))


def oriented(directions: Floats, matches: Floats, weights: Floats) -> Floats:
    """The unit directions [B, 3], signed so that the ``weights`` [B, n] move away from the epipole.

    ``matches`` are [n, 2, 2] or [B, n, 2, 2].
    """
    first, second = rays(matches[..., 0, :]), rays(matches[..., 1, :])
    along = distances(directions, first, second)[1]
    return np.where((weights * along).sum(axis=1, keepdims=True) < 0, -directions, directions)


def constraint_rows(observed: Floats) -> Floats:
    """x1 x x2 of equation (25) for matches [..., 2, 2] in normalised coordinates, [..., 3]."""
    return cross(rays(observed[..., 0, :]), rays(observed[..., 1, :]))


def _gradient_square(directions: Floats, observed: Floats) -> Floats:
    """Squared gradient of (25) by the four coordinates of a match, [B, P]."""
    t = directions[:, None, :]
    total = np.zeros((len(directions), observed.shape[-3]))
    for view in (0, 1):
        x, y = observed[..., view, 0], observed[..., view, 1]
        total += (t[..., 2] * y - t[..., 1]) ** 2 + (t[..., 2] * x - t[..., 0]) ** 2
    return total


def sampson(directions: Floats, observed: Floats) -> tuple[Floats, Floats]:
    """Signed Sampson distances [B, P] and their derivatives by the unit directions [B, P, 3].

    ``observed``, [P, 2, 2] or [B, P, 2, 2], and the distances are in normalised coordinates.
    """
    rows = constraint_rows(observed)
    square = np.maximum(_gradient_square(directions, observed), 1e-18)
    length = np.sqrt(square)
    error = (rows @ directions[:, :, None])[..., 0] / length
    t = directions[:, None, :]
    half_slope = np.zeros((*square.shape, 3))
    for view in (0, 1):
        x, y = observed[..., view, 0], observed[..., view, 1]
        across, down = t[..., 2] * x - t[..., 0], t[..., 2] * y - t[..., 1]
        half_slope[..., 0] -= across
        half_slope[..., 1] -= down
        half_slope[..., 2] += across * x + down * y
    jacobian = rows / length[..., None] - (error / square)[..., None] * half_slope
    return error, jacobian


def _of(matches: Floats, index: Integers) -> Floats:
    """The matches of the fits ``index`` where each fit has its own."""
    return matches if matches.ndim == 3 else matches[index]


def _sphere_step(
    directions: Floats, weights: Floats, error: Floats, jacobian: Floats, damping: Floats
) -> Floats:
    """The damped Gauss-Newton step [B, 3] in the tangent planes of the ``directions``."""
    outwards = directions[:, :, None] * directions[:, None, :]
    project = np.eye(3) - outwards
    weighted = np.swapaxes(jacobian * weights[..., None], 1, 2)
    normal = project @ (weighted @ jacobian) @ project
    side = project @ (weighted @ error[..., None])
    trace = np.trace(normal, axis1=1, axis2=2)[:, None, None] + 1e-300
    # the direction itself is a null vector: give it any curvature
    normal = normal + trace * (damping[:, None, None] * np.eye(3) + outwards)
    return np.asarray(-np.linalg.solve(normal, side)[..., 0])


def rays(observed: Floats) -> Floats:
    """Normalised coordinates [..., 2] as (x, y, 1)."""
    return np.concatenate([observed, np.ones((*observed.shape[:-1], 1))], axis=-1)
