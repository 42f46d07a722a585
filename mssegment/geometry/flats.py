"""Tracks as vectors: how far they spread, their principal components, robust affine flats."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.records import Floats

DIMENSIONS = 12
"""Principal components of the tracks."""
UNIT = 160.0
"""The tracks spread over so many units (pixels of a picture of 640, roughly)."""
FLAT_ROUNDS = 5
"""Rounds of the reweighted principal components."""


def extent(points: Floats) -> float:
    """How widely the tracks [P, F, 2] spread in a frame, pixels, whatever a few of them do.

    1.2 times the median distance from the median point: about the rms radius.
    """
    points = points[:, np.isfinite(points).all(axis=2).any(axis=0)]
    middle = np.nanmedian(points, axis=0)
    return max(1.2 * float(np.nanmedian(np.linalg.norm(points - middle, axis=-1))), 1e-9)


def principal_components(points: Floats) -> Floats:
    """The tracks [P, F, 2] in DIMENSIONS leading principal components, in units, [P, D]."""
    vectors = points.reshape(len(points), -1)
    vectors = (vectors - vectors.mean(axis=0)) * (UNIT / extent(points))
    _, directions = np.linalg.eigh(vectors.T @ vectors)
    return np.asarray(vectors @ directions[:, : -DIMENSIONS - 1 : -1])


def leave_one_out_residuals(vectors: Floats, dimension: int = 3) -> Floats:
    """Distance of each vector [n, d] from the robust affine flat of the *other* vectors, [n].

    Reweighted principal components; r / (1 - leverage) takes each vector's own pull away.
    """
    # far vectors start light: a lever would draw the flat to itself
    weights = _robust_weights(((vectors - np.median(vectors, axis=0)) ** 2).sum(axis=1))
    for _ in range(FLAT_ROUNDS):
        centred = vectors - weights @ vectors / weights.sum()
        directions = _principal(np.sqrt(weights)[:, None] * centred, dimension)
        along = centred @ directions
        squared = np.maximum((centred**2).sum(axis=1) - (along**2).sum(axis=1), 0.0)
        residual = np.sqrt(squared)
        weights = _robust_weights(squared)
    scatter = (weights[:, None] * along).T @ along
    leverage = weights * (
        np.einsum("ni,ni->n", along @ np.linalg.pinv(scatter), along) + 1 / weights.sum()
    )
    return np.asarray(residual / np.maximum(1 - leverage, 0.02))


def _robust_weights(squared: Floats) -> Floats:
    return geman_mcclure_weights(squared, 4 * float(np.median(squared)) + 1e-18)


def _principal(vectors: Floats, dimension: int) -> Floats:
    """The leading principal directions [d, k] of vectors [n, d], by the smaller Gram matrix."""
    tall = len(vectors) >= vectors.shape[1]
    values, axes = np.linalg.eigh(vectors.T @ vectors if tall else vectors @ vectors.T)
    count = max(1, min(dimension, int((values > 1e-9 * values[-1]).sum())))
    if tall:
        return np.asarray(axes[:, -count:])
    return np.asarray(vectors.T @ axes[:, -count:] / np.sqrt(np.maximum(values[-count:], 1e-30)))
