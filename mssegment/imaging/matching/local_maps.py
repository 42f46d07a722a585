"""Matches with local affine maps, and which registered windows are credible as such."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.lucas_kanade import Registered, Windows
from mssegment.imaging.matching.pyramid_corners import PyramidCorners
from mssegment.imaging.matching.resampling import Indices
from mssegment.imaging.pyramid import FACTOR
from mssegment.records import Floats, Record

SINGULAR_VALUES = (0.35, 2.8)
"""Range of the singular values of a credible local affine map."""
MAX_ANISOTROPY = 3.0
"""Largest ratio of the two singular values."""
MATCH_DISTANCE = 3.0
"""Pixels; of matches nearer to each other only the best is kept."""
PREDICTED_DRIFT = 5.0
"""Pixels of the level by which registration may move a match from where others predict it."""


class AffineMatches(Record, frozen=True):
    """Matches: positions [n, 2] in both views, local affine maps, correlation.

    ``levels`` [n] are those of view 1; ``grown_in`` [n] is the round of growth that found each, 0
    for those of the descriptors.
    """

    first: Floats
    second: Floats
    affines: Floats
    correlation: Floats
    levels: Indices
    grown_in: Indices

    def __getitem__(self, rows: Indices | npt.NDArray[np.bool_]) -> AffineMatches:
        return AffineMatches(
            self.first[rows],
            self.second[rows],
            self.affines[rows],
            self.correlation[rows],
            self.levels[rows],
            self.grown_in[rows],
        )

    def joined_with(self, other: AffineMatches) -> AffineMatches:
        """These matches and the ``other`` ones."""
        return AffineMatches(
            np.concatenate([self.first, other.first]),
            np.concatenate([self.second, other.second]),
            np.concatenate([self.affines, other.affines]),
            np.concatenate([self.correlation, other.correlation]),
            np.concatenate([self.levels, other.levels]),
            np.concatenate([self.grown_in, other.grown_in]),
        )

    @classmethod
    def of(cls, windows: Windows, refined: Registered, grown_in: int) -> AffineMatches:
        """Registered windows as matches of one round."""
        return cls(
            windows.first,
            refined.second,
            refined.affines,
            refined.correlation,
            windows.levels,
            np.full(len(windows.first), grown_in),
        )


def credible(
    windows: Windows,
    refined: Registered,
    second: PyramidCorners,
    max_drift: float,
    correlation: float,
) -> npt.NDArray[np.bool_]:
    """Which registrations stayed close, correlate, and have a map that a surface can have.

    ``max_drift`` is in pixels of the level in view 2.
    """
    scales = np.array([level.scale for level in second.pyramid])[windows.levels_second]
    moved = np.linalg.norm(refined.second - windows.second, axis=1)
    inside = inside_picture(refined.second, second)
    close = moved < max_drift * scales
    plausible = plausible_maps(refined.affines)
    return np.asarray(plausible & inside & close & (refined.correlation > correlation))


def plausible_maps(affines: Floats) -> npt.NDArray[np.bool_]:
    """Which affine maps [n, 2, 2] a surface can have."""
    values = np.linalg.svd(affines, compute_uv=False)
    low, high = SINGULAR_VALUES
    return np.asarray(
        (values[:, 1] > low)
        & (values[:, 0] < high)
        & (values[:, 0] < MAX_ANISOTROPY * values[:, 1])
    )


def inside_picture(points: Floats, view: PyramidCorners) -> npt.NDArray[np.bool_]:
    """Which points [n, 2] are in the picture of a view."""
    height, width = view.pyramid[0].grey.shape
    return np.asarray(((points >= 0) & (points <= (width - 1, height - 1))).all(axis=1))


def matching_level(second: PyramidCorners, scales: Floats, affines: Floats) -> Indices:
    """The level of view 2 on which a window of that scale has about the same number of pixels."""
    grown = scales * np.sqrt(np.maximum(np.abs(np.linalg.det(affines)), 1e-6))
    level = np.rint(np.log(grown) / np.log(FACTOR)).astype(np.intp)
    return np.asarray(np.clip(level, 0, len(second.pyramid) - 1))
