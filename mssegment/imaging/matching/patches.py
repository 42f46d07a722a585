"""Plain matching of two views: upright normalised patches, mutual, then sub-pixel.

For pictures without rotation or large change of scale; ``affine`` is for the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.imaging.matching.descriptors import describe
from mssegment.imaging.matching.lucas_kanade import Windows, register
from mssegment.imaging.matching.nearest import mutual
from mssegment.imaging.matching.views import two_views
from mssegment.imaging.pictures import Grey
from mssegment.records import Corners, Tracks

DRIFT = 2.0


def match(
    pictures: Sequence[Grey], corners: Sequence[Corners], *, correlation: float = 0.8
) -> Tracks:
    """Match corners whose normalised patches are each other's best, correlated by at least
    ``correlation``; gain and offset of the light do not matter.

    Positions in view 2 are refined to a fraction of a pixel by Lucas-Kanade (translation) with
    gain and offset projected out. Tracks [P, 2, 2] in pixels, best correlation first; raises
    ``UsageError`` for other than two pictures.
    """
    first, second = two_views("patches", pictures, corners)
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
    drift = np.linalg.norm(refined.second - windows.second, axis=1)
    drift /= second.scales[pairs.second]
    good = np.flatnonzero((refined.correlation >= correlation) & (drift <= DRIFT))
    good = good[np.argsort(-refined.correlation[good], kind="stable")]
    points = np.stack([windows.first[good], refined.second[good]], axis=1)
    return Tracks(points=points, affines=windows.affines[good])
