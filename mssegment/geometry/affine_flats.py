"""Affine flats of R^d, points, lines, planes and so on, as subspaces of R^(d + 1).

In homogeneous coordinates a k-flat is a subspace of dimension k + 1. A hyperplane is stated by the
normal of that subspace, (n, -c) for n'x = c, any other flat by an orthonormal basis.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats


def hyperplane(normals: Floats, on_it: Floats) -> Floats:
    """Unit vectors [B, d + 1, 1] of hyperplanes, from normals and a point on each, both [B, d]."""
    offset = -(normals * on_it).sum(axis=1, keepdims=True)
    vectors = np.concatenate([normals, offset], axis=1)
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.asarray((vectors / np.where(length > 0, length, 1.0))[..., None])


def distance_to_hyperplane(planes: Floats, vectors: Floats) -> Floats:
    """Distances [B, P] of vectors [P, d] or [B, P, d] from hyperplanes [B, d + 1, 1]."""
    normals, offsets = planes[:, :-1, 0], planes[:, -1, 0]
    steepness = np.maximum(np.linalg.norm(normals, axis=1), 1e-300)
    heights = normals @ vectors.T if vectors.ndim == 2 else (vectors @ normals[:, :, None])[..., 0]
    return np.asarray(np.abs(heights + offsets[:, None]) / steepness[:, None])


def flat(on_it: Floats, directions: Floats) -> Floats:
    """Orthonormal bases [B, d + 1, k + 1] of k-flats.

    ``on_it`` [B, d] is a point of each, ``directions`` [B, d, k] span it.
    """
    count, k = len(on_it), directions.shape[2]
    level = np.concatenate([directions, np.zeros((count, 1, k))], axis=1)
    raised = np.concatenate([on_it, np.ones((count, 1))], axis=1)[..., None]
    return np.asarray(np.linalg.qr(np.concatenate([raised, level], axis=2))[0])


def foot_and_directions(flats: Floats) -> tuple[Floats, Floats]:
    """The point nearest to the origin [B, d] and orthonormal directions [B, d, k] of k-flats."""
    heights = flats[:, -1]
    square = np.maximum((heights**2).sum(axis=1), 1e-30)
    foot = np.einsum("bik,bk->bi", flats[:, :-1], heights) / square[:, None]
    # combinations of the basis with last coordinate zero are directions
    level, _ = np.linalg.qr(heights[:, :, None], mode="complete")
    directions, _ = np.linalg.qr(flats[:, :-1] @ level[:, :, 1:])
    return foot, directions


def distance_to_flat(flats: Floats, vectors: Floats) -> Floats:
    """Distances [B, P] of vectors [P, d] or [B, P, d] from k-flats [B, d + 1, k + 1]."""
    foot, directions = foot_and_directions(flats)
    offset = vectors - foot[:, None]
    rejected = offset - (offset @ directions) @ np.swapaxes(directions, 1, 2)
    return np.asarray(np.linalg.norm(rejected, axis=-1))
