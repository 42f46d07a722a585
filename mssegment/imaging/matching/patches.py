"""Matcher ``patches``: mutually nearest upright patches of two views, refined below a pixel.

For views without rotation or large changes of scale; ``affine`` handles those.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.imaging.matching.descriptors import describe
from mssegment.imaging.matching.lucas_kanade import Windows, register
from mssegment.imaging.matching.nearest import mutual
from mssegment.imaging.matching.pyramid_corners import two_views
from mssegment.imaging.pictures import GreyPicture
from mssegment.records import Corners, Tracks

MAX_REFINEMENT = 2.0
"""Pixels of the corner's level that refinement may move a corner; farther, it found another."""


def match(
    pictures: Sequence[GreyPicture], corners: Sequence[Corners], *, correlation: float = 0.8
) -> Tracks:
    """Match corners whose normalised patches are each other's nearest.

    Positions in view 2 are refined by Lucas-Kanade (translation only). Gain and offset between the
    views are projected out.

    Parameters
    ----------
    pictures : sequence of two float32 arrays [height, width]
        Grey values 0 to 255.
    corners : sequence of two Corners
        The corners of each picture.
    correlation : float
        Least correlation of two patches, before and after refinement.

    Returns
    -------
    Tracks
        Matches [P, 2, 2] in pixels, best correlation first, with ``affines`` [P, 2, 2].

    Raises
    ------
    ValueError
        For other than two pictures.
    """
    first, second = two_views(pictures, corners)
    pairs = mutual(describe(first), describe(second), correlation)
    scale = first.scales[pairs.first] / second.scales[pairs.second]
    windows = Windows(
        first=first.points[pairs.first],
        second=second.points[pairs.second],
        affines=np.eye(2) / scale[:, None, None],
        levels=first.levels[pairs.first],
        levels_second=second.levels[pairs.second],
    )
    refined = register(first.pyramid, second.pyramid, windows, affine=False)
    moved = np.linalg.norm(refined.second - windows.second, axis=1)
    moved /= second.scales[pairs.second]
    good = np.flatnonzero((refined.correlation >= correlation) & (moved <= MAX_REFINEMENT))
    good = good[np.argsort(-refined.correlation[good], kind="stable")]
    points = np.stack([windows.first[good], refined.second[good]], axis=1)
    return Tracks(points=points, affines=windows.affines[good])
