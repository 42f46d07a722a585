"""How large a misfit is still noise: what ``segment.granularity`` means.

A motion that predicts points outright (affine, homography) is exact for a plane only. Whether the
parallax inside one body is noise (``object``) or makes two motions (``surface``) is the user's
intent. Motions that leave parallax free (translation, factorization) need no such choice. All
scales are shares of the diagonal of the box that holds the points, so that a picture twice as
large gives the same labels.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats
from mssegment.segmentation.selection import Granularity

SURFACE = (0.0008, 0.006)
"""Floor and cap of the scale of a surface: 0.6 to 5 pixels in 640 x 480."""
OBJECT = (0.0075, 0.02)
"""Floor and cap of the scale of an object: 6 to 16 pixels in 640 x 480."""


def scale_range(extent: float, granularity: Granularity, predicts_points: bool) -> Floats:
    """Least and largest scale of a motion's residuals, pixels, [2]."""
    coarse = granularity == "object" and predicts_points
    return extent * np.array(OBJECT if coarse else SURFACE)


def extent_of(points: Floats) -> float:
    """Diagonal of the box that holds the points [P, F, 2], pixels."""
    return float(np.hypot(*np.ptp(points.reshape(-1, 2), axis=0))) if len(points) else 0.0
