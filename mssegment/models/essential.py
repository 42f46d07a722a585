"""Rigid motion before a calibrated camera: an essential matrix, rotation and translation."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from mssegment.geometry.epipolar import cheirality_residual_sq, sampson, sampson_jacobian
from mssegment.geometry.five_point import five_point
from mssegment.geometry.levenberg_marquardt import State, minimize
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import rotation, skew, step_on_sphere, tangent_basis
from mssegment.manifolds import Essential as EssentialManifold
from mssegment.models.base import Flags, drop_unweighted
from mssegment.models.calibrated import CalibratedModel, epipole_in_pixels, seen_by_example
from mssegment.models.translation import Translation
from mssegment.records import Floats, Integers, Normalization

FIT_ROUNDS = 10
SCREENING_ROUNDS = 2
"""Rounds after which the best of several starts is chosen."""
FIT_TOLERANCE = 1e-9
"""Relative change of the cost at which a fit has converged."""
MIN_DETERMINATION = 1e-12
"""Least eigenvalue of the normal matrix of a fit, relative to the largest: the square of the
precision with which the Jacobian is known. Below it the matches do not determine the motion."""


class Essential(CalibratedModel):
    """The essential matrix E with x2' E x1 = 0.

    The object moves by t and then turns with R relative to the camera, X2 = R (X1 + t) and
    E = R [t]x. An elemental subset is six matches: five have up to ten solutions, of which the
    sixth chooses one. The residual is the Sampson distance.

    Notes
    -----
    E and -E, with t and -t, are one point of the manifold, but only one of them has its points in
    front of the camera. The fits choose the sign with which more of them are. Of the two rotations
    that E may stand for, the smaller is taken; they differ by half a turn about t, and what turns
    by more than a right angle is not matched.
    """

    name: ClassVar[str] = "essential"
    purpose: ClassVar[str] = "rigid objects that translate and rotate before a calibrated camera"
    in_auto: ClassVar[bool] = True

    def __init__(self) -> None:
        self.manifold = EssentialManifold()
        self.subset_size = 6
        self.parameters = 5
        self.residual_dimension = 1

    def example_tracks(self, rng: np.random.Generator, count: int) -> Floats:
        """Points at several depths that move and turn in front of ``EXAMPLE_CAMERA``."""
        space = self.example_space(rng, count, 600.0, 430.0)
        turn = rotation(0.1 * rng.uniform(-1.0, 1.0, 3))
        moved = (space + np.array([0.4, -0.25, 0.3]) * rng.uniform(0.8, 1.2, 3)) @ turn.T
        return seen_by_example(space, moved)

    def minimal_fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Least squares on six matches [B, 6, 2, 2], from the best solution for the first five."""
        weights = np.ones(samples.shape[:2])
        start, real = _best_of_five(samples[:, :5], samples, weights)
        points = _refined(_poses(start), samples, weights)
        valid = real & _determined(points, samples, weights)
        return _oriented(points, samples, weights), np.asarray(valid)

    def fit(self, observed: Floats, weights: Floats) -> tuple[Floats, Flags]:
        """Least squares of the Sampson distance, by Levenberg-Marquardt from three motions.

        They are a translation without rotation, the eight-point algorithm, which fails for planes,
        and the best solution for five matches that are far apart.
        """
        weights, matches = drop_unweighted(weights, observed)
        valid = (weights > 0).sum(axis=1) > self.parameters
        whole = np.broadcast_to(matches, (len(weights), *matches.shape[-3:]))
        five = np.take_along_axis(whole, _far_apart(whole, weights)[..., None, None], axis=1)
        direction, _ = Translation().algebraic_fit(matches, weights)
        still = np.broadcast_to(np.eye(3), (len(weights), 3, 3))
        starts = [
            (direction[..., 0], still),
            _poses(_eight_point(matches, weights)),
            _poses(_best_of_five(five, matches, weights)[0]),
        ]
        found = np.stack([_refined(start, matches, weights, SCREENING_ROUNDS) for start in starts])
        costs = np.stack([_cost(points, matches, weights) for points in found])
        best = np.take_along_axis(found, costs.argmin(axis=0)[None, :, None, None], axis=0)[0]
        points = _refined(_poses(best), matches, weights)
        valid &= _determined(points, matches, weights)
        return _oriented(points, matches, weights), np.asarray(valid)

    def residuals(self, points: Floats, observed: Floats, normalization: Normalization) -> Floats:
        """Distance from the half of the epipolar line in front of the camera, in pixels [B, P]."""
        squares = _sq_errors(points, *_rays(observed))
        return np.asarray(np.sqrt(squares) * normalization.scale)

    def displacements(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats | None:
        """Displacement along the half of the epipolar line, without the rotation, in pixels [B, P].

        At least zero.
        """
        along = _along(points, *_rays(observed))
        return np.maximum(along * normalization.scale, 0.0)

    def algebraic_residuals(
        self, points: Floats, observed: Floats, normalization: Normalization
    ) -> Floats:
        """|x2' E x1|, in normalized coordinates."""
        first, second = _rays(observed)
        lines = points @ np.swapaxes(first, -1, -2)
        return np.asarray(np.abs((lines * np.swapaxes(second, -1, -2)).sum(axis=-2)))

    def in_pixels(self, point: Floats, normalization: Normalization) -> dict[str, Floats]:
        """``direction`` t and ``rotation`` R, and the ``epipole`` of t in the first view."""
        (direction,), (turn,) = _poses(point[None])
        epipole = epipole_in_pixels(direction, normalization)
        return {"direction": direction, "rotation": turn, "epipole": epipole}


_SIDEWAYS = skew(np.array([1.0, 0.0, 0.0]))
"""The motion in place of one that is not valid."""


def _rays(observed: Floats) -> tuple[Floats, Floats]:
    """The rays (x, y, 1) [..., P, 3] of both views of matches [..., P, 2, 2]."""
    return homogeneous(observed[..., 0, :]), homogeneous(observed[..., 1, :])


def _poses(points: Floats) -> tuple[Floats, Floats]:
    """t [B, 3] and R [B, 3, 3] with E = R [t]x, of the two solutions that with the smaller turn.

    E [t]x' = R (I - t t') is R but for the image of t, which completes it to a rotation. Of a
    matrix that is not quite essential, such as a multiple root, the nearest that is.
    """
    left, _, right = np.linalg.svd(points)
    t, image = right[:, 2], left[:, :, 2]
    across = left[..., :2] @ right[..., :2, :] @ np.swapaxes(skew(t), 1, 2)
    sign = np.where(np.trace(across, axis1=1, axis2=2) < 0, -1.0, 1.0)
    t, across = sign[:, None] * t, sign[:, None, None] * across
    along = image[:, :, None] * right[:, None, 2]
    flip = np.where(np.linalg.det(across + along) < 0, -1.0, 1.0)
    return t, across + flip[:, None, None] * along


def _along(points: Floats, first: Floats, second: Floats) -> Floats:
    """Displacements [B, P] along the epipolar lines, positive where t moves points in front.

    They are in view 2 turned back by R. Minus infinity where a point would be behind the camera.
    """
    t, turn = _poses(points)
    turned = second @ turn
    depth = turned[..., 2]
    in_front = depth > 0
    shift = turned[..., :2] / np.where(in_front, depth, 1.0)[..., None] - first[..., :2]
    direction = t[:, None, :2] - t[:, None, 2:] * first[..., :2]
    length = np.linalg.norm(direction, axis=-1)
    along = (direction * shift).sum(axis=-1) / (length + 1e-18)
    return np.where(in_front, along, -np.inf)


def _sq_errors(points: Floats, first: Floats, second: Floats) -> Floats:
    """Squared distances [B, P] from the halves of the epipolar lines."""
    error = sampson(points, first, second).error
    return cheirality_residual_sq(error, _along(points, first, second))


def _oriented(points: Floats, matches: Floats, weights: Floats) -> Floats:
    """E or -E, so that the weighted matches are in front of the camera."""
    along = np.maximum(_along(points, *_rays(matches)), -1.0)
    behind = (weights * along).sum(axis=1) < 0
    return np.where(behind[:, None, None], -points, points)


def _cost(points: Floats, matches: Floats, weights: Floats) -> Floats:
    """Weighted sums [B] of squared Sampson distances."""
    return np.asarray((weights * sampson(points, *_rays(matches)).error ** 2).sum(axis=1))


def _best_of_five(five: Floats, matches: Floats, weights: Floats) -> tuple[Floats, Flags]:
    """Of the solutions for five matches [B, 5, 2, 2] that of least cost, and whether one is real.

    Parameters
    ----------
    matches, weights : ndarray
        What the cost is a sum over, as in ``MotionModel.fit``.
    """
    solutions = five_point(*_rays(five))
    count = solutions.shape[1]
    real = np.asarray(np.isfinite(solutions).all(axis=(2, 3)))
    solutions = np.where(real[..., None, None], solutions, _SIDEWAYS)
    columns = (solutions[:, k] for k in range(count))
    costs = np.stack([_cost(points, matches, weights) for points in columns], axis=1)
    best = np.where(real, costs, np.inf).argmin(axis=1)
    return solutions[np.arange(len(five)), best], np.asarray(real.any(axis=1))


def _far_apart(matches: Floats, weights: Floats) -> Integers:
    """Five of the matches [B, n, 2, 2] of positive weight, far from one another, [B, 5].

    The first is the farthest from the origin of the first view; each other the farthest from those
    before.
    """
    places = matches[..., 0, :]
    distance = (places**2).sum(axis=-1)
    chosen = np.zeros((len(matches), 5), dtype=np.int64)
    for k in range(5):
        chosen[:, k] = np.where(weights > 0, distance, -1.0).argmax(axis=1)
        last = np.take_along_axis(places, chosen[:, k, None, None], axis=1)
        to_last = ((places - last) ** 2).sum(axis=-1)
        distance = np.minimum(distance, to_last) if k else to_last
    return chosen


def _eight_point(matches: Floats, weights: Floats) -> Floats:
    """The essential matrix nearest to that of least squares of x2' E x1."""
    first, second = _rays(matches)
    products = second[..., :, None] * first[..., None, :]
    equations = products.reshape(*products.shape[:-2], 9)
    scatter = np.swapaxes(equations, -1, -2) @ (weights[..., None] * equations)
    _, vectors = np.linalg.eigh(scatter)
    left, _, right = np.linalg.svd(vectors[..., 0].reshape(-1, 3, 3))
    return np.asarray(left[..., :2] @ right[..., :2, :])


def _refined(
    start: tuple[Floats, Floats], matches: Floats, weights: Floats, rounds: int = FIT_ROUNDS
) -> Floats:
    """Essential matrices [B, 3, 3] of least weighted Sampson distances, from t and R."""

    def linearize(state: State, rows: Integers) -> tuple[Floats, Floats]:
        selected = matches if matches.ndim == 3 else matches[rows]
        return _jacobian(state[0], state[1], selected)

    def retract(state: State, steps: Floats) -> State:
        turn = rotation(steps[:, 2:]) @ state[1]
        return step_on_sphere(state[0], steps[:, :2]), turn

    t, turn = minimize(
        start, linearize, retract, rounds=rounds, weights=weights, tolerance=FIT_TOLERANCE
    )
    return np.asarray(turn @ skew(t))


def _jacobian(t: Floats, turn: Floats, matches: Floats) -> tuple[Floats, Floats]:
    """Sampson distances [B, P] and derivatives [B, P, 5] by steps of t and a further rotation."""
    points = turn @ skew(t)
    error, by_entries = sampson_jacobian(points, *_rays(matches))
    basis = np.swapaxes(tangent_basis(t), -1, -2)
    by_direction = turn[:, None] @ skew(basis)
    by_rotation = skew(np.eye(3)) @ points[:, None]
    entries = np.concatenate([by_direction, by_rotation], axis=1).reshape(len(t), 5, 9)
    return error, by_entries @ np.swapaxes(entries, 1, 2)


def _determined(points: Floats, matches: Floats, weights: Floats) -> Flags:
    """Whether the weighted matches determine all five parameters."""
    t, turn = _poses(points)
    _, jacobian = _jacobian(t, turn, matches)
    normal = np.swapaxes(jacobian, 1, 2) @ (weights[..., None] * jacobian)
    values = np.linalg.eigvalsh(normal)
    return np.asarray(values[:, 0] > MIN_DETERMINATION * values[:, -1])
