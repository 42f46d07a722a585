"""How far the tracks of one motion move in the direction that the motion leaves free.

A translation leaves a track free along its half of the epipolar line; how far it moves depends on
its depth. The points of one object have similar or continuous depths (those of a car are nearly
equal, those of a street range from near to far), so the displacements of the other tracks of a
motion predict that of a track. A distribution for each motion is no reason to split an object by
depth: what that saves on the displacements equals the cost of the additional labels.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats
from mssegment.segmentation.mdl.likelihood import Noise

DISPLACEMENT_BINS = 12
"""Number of bins, equally wide in the logarithm of displacements beyond the largest noise."""
PREDICTION_WEIGHT = 0.5
"""Weight of the prediction by the other tracks, relative to the uniform code. An object that
rotates slightly has residuals that depend on depth; with full weight it would be split by depth."""
BIN_PRIOR = 0.5
"""Initial count of each bin (Krichevsky and Trofimov)."""


def displacement_gains(displacements: Floats, inliers: Floats, noise: Noise) -> Floats:
    """Nats saved on displacements, relative to a uniform code.

    Parameters
    ----------
    displacements : ndarray [B, P]
        Displacement of each track in the direction that each motion leaves free, in pixels.
    inliers : ndarray [B, P]
        Inliers of each motion (0 or 1), the others of which predict the displacement of a track.
    noise : Noise
        The noise of the model.

    Returns
    -------
    ndarray [B, P]
    """
    longest, unit = np.exp(noise.log_free_extent), noise.cap
    edges = unit * np.expm1(np.linspace(0.0, np.log1p(longest / unit), DISPLACEMENT_BINS + 1))
    bins = np.searchsorted(edges, displacements, side="right") - 1
    bins = np.clip(bins, 0, DISPLACEMENT_BINS - 1)
    counts = [((bins == k) * inliers).sum(axis=1) for k in range(DISPLACEMENT_BINS)]
    count = np.stack(counts, axis=1)
    padded = np.pad(count, ((0, 0), (1, 1)))
    smooth = (padded[:, :-2] + 2 * count + padded[:, 2:]) / 4
    # a track does not predict itself
    itself = inliers / 2
    others = np.take_along_axis(smooth, bins, axis=1) - itself
    total = smooth.sum(axis=1, keepdims=True) - itself
    share = (np.maximum(others, 0.0) + BIN_PRIOR) / (total + BIN_PRIOR * DISPLACEMENT_BINS)
    return np.asarray(PREDICTION_WEIGHT * (np.log(share) + np.log(longest / np.diff(edges))[bins]))
