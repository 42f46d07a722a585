"""How large a misfit is still noise: what ``segment.granularity`` means.

A motion that predicts points outright (affine, homography) is exact for a plane only. A body that
is not flat leaves a parallax, which grows with its displacement. Whether that is noise (``object``)
or makes two motions (``surface``) is the user's intent. Motions that leave parallax free
(translation, factorization) need no such choice. All scales are shares of lengths in the tracks
themselves, so that a picture twice as large gives the same labels.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.options import Granularity

LEAST_SCALE = 1e-6
"""Pixels; tracks that all lie in one place must not divide by zero."""
SURFACE = (0.00125, 0.006)
"""Floor and cap of the scale of a motion that predicts points, over the diagonal of the box that
holds them: 1 to 5 pixels in 640 x 480. No wall is quite flat."""
PARALLEL = (0.0003, 0.001)
"""The same for motions that leave parallax free under an affine camera, which is nearly true."""
EXACT = (0.00007, 0.001)
"""The same under a calibrated camera: the noise of corners, a good tracker's to a matcher's."""
PARALLAX = 0.03
"""Parallax inside a body that is noise, over its displacement."""


FLAT = 0.0009
"""Scale below which surfaces count as flat, over the same diagonal: where ``auto`` draws the line
between surfaces (walls) and objects, whose patches are never quite planes."""


def suggest(scales: Floats, inliers: Integers, points: Floats) -> Granularity:
    """What the surfaces found suggest: ``surface`` where they are flat, else ``object``.

    ``scales`` [m] pixels and numbers of ``inliers`` [m] of the homographies that were found with
    granularity ``surface`` in the tracks ``points`` [P, F, 2].
    """
    if not inliers.sum():
        return "object"
    mean = float((scales * inliers).sum() / inliers.sum())
    return "surface" if mean < FLAT * diagonal(points) else "object"


def diagonal(points: Floats) -> float:
    """Diagonal of the box that holds the points [P, F, 2], pixels."""
    return float(np.hypot(*np.ptp(points.reshape(-1, 2), axis=0))) if len(points) else 1.0


def scale_range(
    points: Floats, predicts_points: bool, calibrated: bool = False
) -> tuple[float, float]:
    """Least and largest scale of a motion's residuals, pixels, for the tracks [P, F, 2]."""
    extent = diagonal(points)
    floor, cap = SURFACE if predicts_points else EXACT if calibrated else PARALLEL
    return max(floor * extent, LEAST_SCALE), max(cap * extent, LEAST_SCALE)


def parallax_of(points: Floats, granularity: Granularity, predicts_points: bool) -> Floats:
    """The misfit of each track [P, F, 2] that is parallax inside its body, pixels [P]."""
    displacement = np.linalg.norm(points - points[:, :1], axis=-1).max(axis=1)
    share = PARALLAX if granularity == "object" and predicts_points else 0.0
    return np.asarray(share * displacement)
