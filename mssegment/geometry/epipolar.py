"""A translation seen by a camera that also turns: five parameters, and how they fit matches.

The rays of the second view are turned by R before equation (25): t . (x1 x R x2) = 0. Everything is
batched over B pairs (t, R); rays are (x, y, 1) [P, 3], or [B, P, 3] where every pair has its own.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats

TINY = 1e-18
DAMPING = 1e-3


def distances(directions: Floats, first: Floats, turned: Floats) -> tuple[Floats, Floats]:
    """Signed Sampson distances [B, P] of matches from translations, and how far they moved.

    ``directions`` are [B, 3], the rays ``first`` and ``turned`` [P, 3] or [B, P, 3]; the second
    array is the displacement away from the epipole. Normalised coordinates.
    """
    t = np.swapaxes(directions[:, None, :], 1, 2)
    error = (cross(first, turned) @ t)[..., 0]
    square, away = 0.0, 0.0
    for view in (first, turned):
        # |t_z x - t_xy|^2, the gradient by the other view
        length = (view**2).sum(axis=-1) - 1
        beside = (view[..., :2] @ t[:, :2])[..., 0]
        part = t[:, 2] ** 2 * length - 2 * t[:, 2] * beside + (t[:, :2] ** 2).sum(axis=1)
        part = np.maximum(part, 0.0)
        square = square + part
        away = away if view is turned else np.sqrt(part) + TINY
    shift = (turned - first)[..., :2]
    outwards = t[:, 2] * (shift * first[..., :2]).sum(axis=-1) - (shift @ t[:, :2])[..., 0]
    return error / np.sqrt(square + TINY), outwards / away


def cheirality_residual_sq(error: Floats, along: Floats, sign: Floats | float = 1.0) -> Floats:
    """Squared distances [B, P] from the half of the epipolar line in front of the camera.

    A point in front of the camera moves away from the epipole, or towards it where ``sign`` is
    -1, never the other way: depths are positive.
    """
    # the Sampson distance shares the noise among both views, a displacement has it twice
    return np.asarray(error**2 + np.minimum(along * sign, 0.0) ** 2 / 2)


def linearized(
    directions: Floats, rotations: Floats, first: Floats, second: Floats
) -> tuple[Floats, Floats]:
    """Signed Sampson distances [B, P] from the pairs, and their derivatives [B, P, 5].

    The derivatives are by the tangent plane of t (``tangent_basis``) and by a further turn; the
    gradient in the denominator is taken as constant under that turn, which only scales small
    distances.
    """
    turned = turn(second, rotations)
    t = directions[:, None, :]
    from_first = t[..., 2:] * first[..., :2] - t[..., :2]
    from_second = t[..., 2:] * turned[..., :2] - t[..., :2]
    square = (from_first**2).sum(axis=-1) + (from_second**2).sum(axis=-1) + TINY
    length = np.sqrt(square)[..., None]
    normals = cross(t, first)
    error = (turned * normals).sum(axis=-1, keepdims=True) / length
    last = from_first * first[..., :2] + from_second * turned[..., :2]
    slope = np.concatenate([-(from_first + from_second), last.sum(-1, keepdims=True)], axis=-1)
    by_direction = (cross(first, turned) - error / length * slope) @ tangent_basis(directions)
    by_turn = cross(turned, normals)
    return error[..., 0], np.concatenate([by_direction, by_turn], axis=-1) / length


def solve(directions: Floats, first: Floats, second: Floats, rounds: int) -> tuple[Floats, Floats]:
    """Least squares of (t, R) from the ``directions`` [B, 3] and no turn: Levenberg-Marquardt."""
    rotations = np.tile(np.eye(3), (len(directions), 1, 1))
    damping = np.full(len(directions), DAMPING)
    error, jacobian = linearized(directions, rotations, first, second)
    for _ in range(rounds):
        moved, turned = step(directions, rotations, damped_step(jacobian, error, damping))
        proposed, slopes = linearized(moved, turned, first, second)
        better = (proposed**2).sum(axis=1) < (error**2).sum(axis=1)
        damping *= np.where(better, 0.2, 8.0)
        keep = better[:, None]
        directions = np.where(keep, moved, directions)
        rotations = np.where(keep[..., None], turned, rotations)
        error = np.where(keep, proposed, error)
        jacobian = np.where(keep[..., None], slopes, jacobian)
    return directions, rotations


def damped_step(jacobian: Floats, error: Floats, damping: Floats) -> Floats:
    """The step [B, n] of Levenberg and Marquardt."""
    normal = np.swapaxes(jacobian, 1, 2) @ jacobian
    side = np.swapaxes(jacobian, 1, 2) @ error[..., None]
    diagonal = np.diagonal(normal, axis1=1, axis2=2) + TINY
    normal = normal + np.eye(normal.shape[-1]) * (damping[:, None] * diagonal)[:, None, :]
    return np.asarray(-np.linalg.solve(normal, side)[..., 0])


def step(directions: Floats, rotations: Floats, steps: Floats) -> tuple[Floats, Floats]:
    """The pairs (t, R) after ``steps`` [B, 5]: in the tangent plane of t, then a turn."""
    moved = directions + (tangent_basis(directions) @ steps[:, :2, None])[..., 0]
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    return moved, rotation(steps[:, 2:]) @ rotations


def turn(points: Floats, rotations: Floats) -> Floats:
    """The rays [..., P, 3] turned by R [B, 3, 3] and scaled to (x, y, 1) again, [B, P, 3]."""
    turned = points @ np.swapaxes(rotations, -1, -2)
    return np.asarray(turned / turned[..., 2:])


def rotation(vectors: Floats) -> Floats:
    """Rotation matrices [..., 3, 3] of rotation vectors [..., 3] (radians; Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    skew = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + np.sinc(angle / np.pi) * skew + versine * (skew @ skew))


def degrees(rotations: Floats) -> Floats:
    """Angles of rotation matrices [..., 3, 3]."""
    half_sine = np.linalg.norm(rotations - np.eye(3), axis=(-2, -1)) / np.sqrt(8.0)
    return np.asarray(np.degrees(2 * np.arcsin(np.minimum(half_sine, 1.0))))


def tangent_basis(directions: Floats) -> Floats:
    """Two unit vectors orthogonal to each unit direction [B, 3] and each other, [B, 3, 2]."""
    axes = np.eye(3)[np.abs(directions).argmin(axis=-1)]
    across = cross(directions, axes)
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, cross(directions, across)], axis=-1)


def cross(a: Floats, b: Floats) -> Floats:
    """Cross product over the last axis; four times faster than numpy's on short batches."""
    return np.stack(
        [
            a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1],
            a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2],
            a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0],
        ],
        axis=-1,
    )
