"""The second test for outliers: complete tracks against the affine flat of their group."""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.sampling.validation import extent

SECOND_OF_EXTENT, RESIDUALS_OF_MEDIAN, SECOND_OF_MEDIAN = 0.1, 6.0, 4.0
"""Second test: (misfit over extent) x (residual over the motion's median residual) above the
first, the residual above so many medians, and the misfit above so many median misfits."""
FLAT_ROUNDS = 5


def second_test(points: Floats, misfit: Floats, labels: Integers, sparing: float) -> Flags:
    """Which of the tracks [P, F, 2] belong nowhere although they have a label (1, 2, ...).

    Only complete tracks are judged: the distance from the affine 3-flat (rank 4) that is fitted
    robustly to the other tracks of the group, against the group's median. ``sparing`` is what
    ``spared`` gives.
    """
    outside = np.zeros(len(points), dtype=bool)
    complete = np.isfinite(points).all(axis=(1, 2))
    usual = float(np.median(misfit[labels > 0])) if (labels > 0).any() else 0.0
    for label in range(1, labels.max(initial=0) + 1):
        members = np.flatnonzero((labels == label) & complete)
        if len(members) < 6:
            continue
        vectors = points[members].reshape(len(members), -1)
        residual = leave_one_out_residuals(vectors)
        relative = residual / max(float(np.median(residual)), 1e-12)
        product = misfit[members] / extent(points) * relative
        outside[members] = (
            (product > sparing * SECOND_OF_EXTENT)
            & (relative > RESIDUALS_OF_MEDIAN)
            & (misfit[members] > SECOND_OF_MEDIAN * usual)
        )
    return outside


def leave_one_out_residuals(vectors: Floats, dimension: int = 3) -> Floats:
    """Distance of each vector [n, d] from the robust affine flat of the *other* vectors, [n].

    Reweighted principal components; r / (1 - leverage) takes each vector's own pull away.
    """
    # far vectors start light: a lever would draw the flat to itself
    weights = _weights(((vectors - np.median(vectors, axis=0)) ** 2).sum(axis=1))
    for _ in range(FLAT_ROUNDS):
        centred = vectors - weights @ vectors / weights.sum()
        directions = _principal(np.sqrt(weights)[:, None] * centred, dimension)
        along = centred @ directions
        squared = np.maximum((centred**2).sum(axis=1) - (along**2).sum(axis=1), 0.0)
        residual = np.sqrt(squared)
        weights = _weights(squared)
    scatter = (weights[:, None] * along).T @ along
    leverage = weights * (
        np.einsum("ni,ni->n", along @ np.linalg.pinv(scatter), along) + 1 / weights.sum()
    )
    return np.asarray(residual / np.maximum(1 - leverage, 0.02))


def _weights(squared: Floats) -> Floats:
    return np.asarray((1 + squared / (4 * np.median(squared) + 1e-18)) ** -2.0)


def _principal(vectors: Floats, dimension: int) -> Floats:
    """The leading principal directions [d, k] of vectors [n, d], by the smaller Gram matrix."""
    tall = len(vectors) >= vectors.shape[1]
    values, axes = np.linalg.eigh(vectors.T @ vectors if tall else vectors @ vectors.T)
    count = max(1, min(dimension, int((values > 1e-9 * values[-1]).sum())))
    if tall:
        return np.asarray(axes[:, -count:])
    return np.asarray(vectors.T @ axes[:, -count:] / np.sqrt(np.maximum(values[-count:], 1e-30)))
