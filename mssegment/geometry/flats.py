"""Trajectories as vectors: their spread, principal components, and robust affine flats."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.neighbours import nearest_others
from mssegment.records import Floats

COMPONENTS = 12
"""Number of principal components of the tracks."""
SPREAD = 160.0
"""``extent`` of the tracks after scaling: about that in pixels in a 640 x 480 image."""
LOCAL_TRACKS = 14
"""Nearest tracks to which a local flat is fitted, some more than its dimension needs."""
FLAT_ROUNDS = 5
"""Rounds of reweighting of the principal components."""


def extent(points: Floats) -> float:
    """Robust spread of tracks [P, F, 2] within a frame, in pixels.

    1.2 times the median distance from the median point, which is about the rms radius.
    """
    seen = np.isfinite(points).all(axis=2)
    points = points[:, seen.any(axis=0)]
    # twice as fast where nothing is missing
    median = np.median if seen.all() else np.nanmedian
    middle = median(points, axis=0)
    return max(1.2 * float(median(np.linalg.norm(points - middle, axis=-1))), 1e-9)


def principal_components(points: Floats) -> Floats:
    """The leading principal components of the tracks [P, F, 2], scaled to ``SPREAD``, [P, D].

    D is ``COMPONENTS``, or less for few frames.
    """
    vectors = points.reshape(len(points), -1)
    vectors = (vectors - vectors.mean(axis=0)) * (SPREAD / extent(points))
    _, directions = np.linalg.eigh(vectors.T @ vectors)
    return np.asarray(vectors @ directions[:, : -COMPONENTS - 1 : -1])


def local_residuals(vectors: Floats, around: int = LOCAL_TRACKS, dimension: int = 3) -> Floats:
    """Residual vectors from the affine flats of the nearest other vectors.

    Parameters
    ----------
    vectors : ndarray [n, d]
        The vectors, for instance tracks.
    around : int
        Number of nearest other vectors to which each flat is fitted, by principal components.
    dimension : int
        Dimension of the flats.

    Returns
    -------
    ndarray [n, d]
        Residuals over sqrt(1 + leverage), so that each coordinate has the variance of the noise.
    """
    near = nearest_others(vectors, around)
    others = vectors[near]
    mean = others.mean(axis=1)
    centred = others - mean[:, None]
    values, axes = np.linalg.eigh(centred @ np.swapaxes(centred, 1, 2))
    values, axes = values[:, -dimension:], axes[:, :, -dimension:]
    known = np.maximum(values, 1e-12 * values[:, -1:] + 1e-300)
    directions = np.swapaxes(centred, 1, 2) @ axes / np.sqrt(known)[:, None]
    gap = vectors - mean
    along = (gap[:, None] @ directions)[:, 0]
    leverage = 1 / near.shape[1] + (along**2 / known).sum(axis=1)
    residuals = gap - (directions @ along[..., None])[..., 0]
    return np.asarray(residuals / np.sqrt(1 + leverage)[:, None])


def leave_one_out_residuals(vectors: Floats, dimension: int = 3) -> Floats:
    """Distance of each vector from the affine flat that is fitted robustly to all other vectors.

    Iteratively reweighted principal components with Geman-McClure weights; division by
    1 - leverage removes the influence of a vector on its own residual.

    Parameters
    ----------
    vectors : ndarray [n, d]
        The vectors, for instance tracks.
    dimension : int
        Dimension of the flat.

    Returns
    -------
    ndarray [n]
        Residuals in the units of the vectors.
    """
    # start with small weights for distant vectors, which would attract the flat
    weights = _robust_weights(((vectors - np.median(vectors, axis=0)) ** 2).sum(axis=1))
    for _ in range(FLAT_ROUNDS):
        centred = vectors - weights @ vectors / weights.sum()
        directions = _principal(np.sqrt(weights)[:, None] * centred, dimension)
        projection = centred @ directions
        squared = np.maximum((centred**2).sum(axis=1) - (projection**2).sum(axis=1), 0.0)
        residuals = np.sqrt(squared)
        weights = _robust_weights(squared)
    scatter = (weights[:, None] * projection).T @ projection
    leverage = weights * (
        np.einsum("ni,ni->n", projection @ np.linalg.pinv(scatter), projection) + 1 / weights.sum()
    )
    return np.asarray(residuals / np.maximum(1 - leverage, 0.02))


def _robust_weights(squared: Floats) -> Floats:
    """Geman-McClure weights with twice the median residual as scale."""
    return geman_mcclure_weights(squared, 4 * float(np.median(squared)) + 1e-18)


def _principal(vectors: Floats, dimension: int) -> Floats:
    """The leading principal directions [d, k] of vectors [n, d], by the smaller Gram matrix."""
    tall = len(vectors) >= vectors.shape[1]
    values, axes = np.linalg.eigh(vectors.T @ vectors if tall else vectors @ vectors.T)
    count = max(1, min(dimension, int((values > 1e-9 * values[-1]).sum())))
    if tall:
        return np.asarray(axes[:, -count:])
    return np.asarray(vectors.T @ axes[:, -count:] / np.sqrt(np.maximum(values[-count:], 1e-30)))
