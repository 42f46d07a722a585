"""How far the tracks of one motion move where the motion leaves them free.

A translation leaves a track free along its half of the epipolar line: how far it moves is a matter
of its depth. But the points of one body have depths of their own kind (those of a car are nearly
the same, those of a street go from near to far), so that the displacements of its other tracks
predict a track's. A distribution of its own for every motion is no reason to split a body by depth:
what that saves on the displacements is what the frequencies of the two labels cost.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats
from mssegment.segmentation.mdl.likelihood import Noise

BINS = 12
"""Of the displacements, equally wide in their logarithm from the largest noise up."""
TRUST = 0.5
"""How far a displacement is predicted by those of its motion, how far by the uniform code. A body
that turns a little misfits by depth: all of the prediction would split it there."""
PRIOR = 0.5
"""Count that each bin has before anything is seen (Krichevsky and Trofimov)."""


def displacement_gains(moved: Floats, inliers: Floats, noise: Noise) -> Floats:
    """Nats saved against a uniform code on the displacements ``moved`` [B, P] (pixels).

    Each track is predicted by the displacements of the other ``inliers`` [B, P] (0 or 1).
    """
    longest, unit = np.exp(noise.free), noise.cap
    edges = unit * np.expm1(np.linspace(0.0, np.log1p(longest / unit), BINS + 1))
    place = np.clip(np.searchsorted(edges, moved, side="right") - 1, 0, BINS - 1)
    count = np.stack([((place == k) * inliers).sum(axis=1) for k in range(BINS)], axis=1)
    padded = np.pad(count, ((0, 0), (1, 1)))
    smooth = (padded[:, :-2] + 2 * count + padded[:, 2:]) / 4
    own = inliers / 2
    seen = np.take_along_axis(smooth, place, axis=1) - own
    total = smooth.sum(axis=1, keepdims=True) - own
    share = (np.maximum(seen, 0.0) + PRIOR) / (total + PRIOR * BINS)
    return np.asarray(TRUST * (np.log(share) + np.log(longest / np.diff(edges))[place]))
