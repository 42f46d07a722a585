"""Rotations of space, and unit vectors."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats


def rotation(vectors: Floats) -> Floats:
    """Rotation matrices [..., 3, 3] of rotation vectors [..., 3] in radians (Rodrigues)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    cross_product = skew(vectors)
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    rotated = np.sinc(angle / np.pi) * cross_product + versine * (cross_product @ cross_product)
    return np.asarray(np.eye(3) + rotated)


def skew(vectors: Floats) -> Floats:
    """The matrices [v]x [..., 3, 3] with [v]x w = v x w, for vectors [..., 3]."""
    matrices = np.zeros((*vectors.shape, 3))
    for axis, (row, column) in enumerate(((2, 1), (0, 2), (1, 0))):
        matrices[..., row, column] = vectors[..., axis]
        matrices[..., column, row] = -vectors[..., axis]
    return matrices


def degrees(rotations: Floats) -> Floats:
    """Angles of rotation matrices [..., 3, 3], in degrees."""
    half_sine = np.linalg.norm(rotations - np.eye(3), axis=(-2, -1)) / np.sqrt(8.0)
    return np.asarray(np.degrees(2 * np.arcsin(np.minimum(half_sine, 1.0))))


def rotate_rays(rays: Floats, rotations: Floats) -> Floats:
    """Rotate rays (x, y, 1) [..., P, 3] by R [B, 3, 3] and scale them to z = 1, [B, P, 3]."""
    rotated = rays @ np.swapaxes(rotations, -1, -2)
    return np.asarray(rotated / rotated[..., 2:])


def tangent_basis(directions: Floats) -> Floats:
    """Orthonormal bases [..., n, n - 1] of the tangent spaces of a sphere at unit vectors [..., n].

    The last columns of the Householder reflection that maps the unit vector to the first axis.
    """
    sign = np.where(directions[..., :1] < 0, -1.0, 1.0)
    normal = np.concatenate([directions[..., :1] + sign, directions[..., 1:]], axis=-1)
    scale = 2.0 / (normal**2).sum(axis=-1)[..., None, None]
    outer = normal[..., :, None] * normal[..., None, 1:]
    return np.asarray(np.eye(directions.shape[-1])[:, 1:] - scale * outer)


def step_on_sphere(directions: Floats, steps: Floats) -> Floats:
    """Move unit vectors [B, n] by ``steps`` [B, n - 1] in the coordinates of ``tangent_basis``."""
    moved = directions + (tangent_basis(directions) @ steps[..., None])[..., 0]
    return np.asarray(moved / np.linalg.norm(moved, axis=-1, keepdims=True))
