"""How large a misfit is still noise: what ``segment.granularity`` means.

A motion that predicts points outright (affine, homography) is exact for a plane only. A body that
is not flat leaves a parallax, which grows with its displacement. Whether that is noise (``object``)
or makes two motions (``surface``) is the user's intent. Motions that leave parallax free
(translation, factorization) need no such choice. All scales are shares of lengths in the tracks
themselves, so that a picture twice as large gives the same labels.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats
from mssegment.segmentation.selection import Granularity

MEASUREMENT = (0.0008, 0.006)
"""Floor and cap of the scale of measured points, over the diagonal of the box that holds them:
0.6 to 5 pixels in 640 x 480."""
PARALLAX = 0.025
"""Parallax inside a body that is noise, over its displacement."""


def measurement_scales(points: Floats) -> tuple[float, float]:
    """Least and largest scale of measured points, pixels, for the tracks [P, F, 2]."""
    extent = float(np.hypot(*np.ptp(points.reshape(-1, 2), axis=0))) if len(points) else 1.0
    return MEASUREMENT[0] * extent, MEASUREMENT[1] * extent


def parallax_of(points: Floats, granularity: Granularity, predicts_points: bool) -> Floats:
    """The misfit of each track [P, F, 2] that is parallax inside its body, pixels [P]."""
    displacement = np.linalg.norm(points - points[:, :1], axis=-1).max(axis=1)
    share = PARALLAX if granularity == "object" and predicts_points else 0.0
    return np.asarray(share * displacement)
