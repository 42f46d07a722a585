"""The matcher for two views that may lie far apart: oriented patches, affine Lucas-Kanade, growing.

Corners of a pyramid are compared by oriented normalised patches; what is distinctive and mutual is
registered by affine Lucas-Kanade, which verifies it, places it to a fraction of a pixel and gives
each match its local affine map. Matches confirm each other by these maps, and predict where the
corners that found no partner should be.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from mssegment.imaging.corners import spread
from mssegment.imaging.matching.descriptors import compressed, describe
from mssegment.imaging.matching.lucas_kanade import Registered, Windows, likeness, register
from mssegment.imaging.matching.nearest import Pairs, mutual
from mssegment.imaging.matching.orientation import dominant
from mssegment.imaging.matching.support import (
    distance_to,
    nearest_matches,
    predict,
    supported,
)
from mssegment.imaging.matching.views import Indices, View, two_views
from mssegment.imaging.pictures import Grey
from mssegment.imaging.pyramid import FACTOR, size_unit
from mssegment.neighbours import pairs_within
from mssegment.records import Corners, Floats, Record, Tracks

RATIO = 0.85
SAME_PLACE = 4.0
DRIFT = 8.0
CORRELATION = 0.8
SINGULAR_VALUES = (0.35, 2.8)
ANISOTROPY = 3.0
THINNING = 3.0
"""Pixels; matches nearer to each other say the same thing."""
PER_PLACE = 2
"""Pairs of patches that are registered at one place in view 1."""
CONFIRMING = (2, 4)
"""Support asked for at first, among neighbours many of which are wrong, and then."""
GROWTH_ROUNDS = 3
GROWTH_NEIGHBOURS = 3
GROWTH_RADIUS = 40.0
GROWTH_DRIFT = 5.0
PROMISING = 0.4
"""Correlation that a predicted place must have before registration to be worth it."""


class _Matches(Record, frozen=True):
    """Matches: positions [n, 2] in both pictures, local affines, correlation.

    ``born`` [n] is the round of growth that found each, 0 for the patches.
    """

    first: Floats
    second: Floats
    affines: Floats
    correlation: Floats
    born: Indices

    def __getitem__(self, rows: Indices | npt.NDArray[np.bool_]) -> _Matches:
        return _Matches(
            self.first[rows],
            self.second[rows],
            self.affines[rows],
            self.correlation[rows],
            self.born[rows],
        )

    def and_(self, other: _Matches) -> _Matches:
        return _Matches(
            np.concatenate([self.first, other.first]),
            np.concatenate([self.second, other.second]),
            np.concatenate([self.affines, other.affines]),
            np.concatenate([self.correlation, other.correlation]),
            np.concatenate([self.born, other.born]),
        )


def match(
    pictures: Sequence[Grey],
    corners: Sequence[Corners],
    *,
    ratio: float = RATIO,
    correlation: float = CORRELATION,
    rounds: int = GROWTH_ROUNDS,
) -> Tracks:
    """Match two views under rotation, scale, slant and change of light.

    ``ratio`` is the greatest allowed ratio of the distances to the nearest patch and to the
    nearest at another place; ``correlation`` the least correlation after registration; ``rounds``
    how often the matches may grow. Tracks [P, 2, 2] in pixels with ``affines`` [P, 2, 2], best
    correlation first; raises ``UsageError`` for other than two pictures.
    """
    first, second = two_views("affine", pictures, corners)
    found = _seeds(first, second, ratio, correlation)
    found = _confirmed(found)
    for number in range(1, rounds + 1):
        found = _confirmed(found.and_(_grow(first, second, found, number, correlation)))
        if not (found.born == number).any():
            break
    found = found[np.argsort(-found.correlation, kind="stable")]
    return Tracks(points=np.stack([found.first, found.second], axis=1), affines=found.affines)


def _seeds(first: View, second: View, ratio: float, correlation: float) -> _Matches:
    """Distinctive mutual pairs of patches that registration confirms."""
    corner1, angle1 = dominant(first)
    corner2, angle2 = dominant(second)
    one = compressed(describe(first.take(corner1), angle1))
    two = compressed(describe(second.take(corner2), angle2))
    pairs = mutual(one, two, 0.0, ratio=ratio, places=second.points[corner2], apart=SAME_PLACE)
    pairs = _uncrowded(pairs, first.points[corner1])
    c1, c2 = corner1[pairs.first], corner2[pairs.second]
    turn = angle2[pairs.second] - angle1[pairs.first]
    scale = second.scales[c2] / first.scales[c1]
    c, s = np.cos(turn) * scale, np.sin(turn) * scale
    windows = Windows(
        first=first.points[c1],
        second=second.points[c2],
        affines=np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2),
        levels=first.levels[c1],
        levels_second=second.levels[c2],
    )
    refined = register(first.pyramid, second.pyramid, windows)
    good = _credible(windows, refined, second, DRIFT, correlation)
    return _as_matches(windows, refined, 0)[good]


def _uncrowded(pairs: Pairs, places: Floats) -> Pairs:
    """The pairs with fewer than PER_PLACE better ones at their place in view 1.

    ``places`` are those of all patches there. Only one of a place stays in the end, but two may
    differ in scale or direction, and which is right is seen when they are registered.
    """
    one, two = pairs_within(places[pairs.first], THINNING).T
    worse = np.where(pairs.correlation[one] < pairs.correlation[two], one, two)
    kept = np.bincount(worse, minlength=len(pairs.first)) < PER_PLACE
    return Pairs(pairs.first[kept], pairs.second[kept], pairs.correlation[kept])


def _credible(
    windows: Windows, refined: Registered, second: View, drift: float, correlation: float
) -> npt.NDArray[np.bool_]:
    """Which registrations stayed near, look alike, and have a map that a surface can have."""
    scales = np.array([level.scale for level in second.pyramid])[windows.levels_second]
    moved = np.linalg.norm(refined.second - windows.second, axis=1)
    values = np.linalg.svd(refined.affines, compute_uv=False)
    low, high = SINGULAR_VALUES
    sane = (values[:, 1] > low) & (values[:, 0] < high) & (values[:, 0] < ANISOTROPY * values[:, 1])
    height, width = second.pyramid[0].grey.shape
    inside = ((refined.second >= 0) & (refined.second <= (width - 1, height - 1))).all(axis=1)
    near = moved < drift * scales
    return np.asarray(sane & inside & near & (refined.correlation > correlation))


def _as_matches(windows: Windows, refined: Registered, born: int) -> _Matches:
    return _Matches(
        windows.first,
        refined.second,
        refined.affines,
        refined.correlation,
        np.full(len(windows.first), born),
    )


def _confirmed(found: _Matches) -> _Matches:
    """One match per few pixels, the best, and only what its neighbours confirm, twice over."""
    found = found[np.argsort(-found.correlation, kind="stable")]
    found = found[spread(found.first, THINNING)]
    for least in CONFIRMING:
        found = found[supported(found.first, found.second, found.affines, least)]
    return found


def _grow(first: View, second: View, found: _Matches, number: int, correlation: float) -> _Matches:
    """Matches for corners that have none yet, at the places that their neighbours predict.

    Round ``number`` asks only neighbours that the round before has found: the others have spoken.
    """
    if not len(found.first):
        return found
    gap = distance_to(first.points, found.first)
    free = np.flatnonzero(gap >= THINNING)
    if not len(free):
        return found[free]
    radius = GROWTH_RADIUS * size_unit(first.pyramid[0].grey)
    rows, near = nearest_matches(first.points[free], found.first, GROWTH_NEIGHBOURS, radius)
    news = found.born[near] == number - 1
    rows, near = rows[news], near[news]
    corner = free[rows]
    affines = found.affines[near]
    windows = Windows(
        first=first.points[corner],
        second=predict(first.points[corner], found.first[near], found.second[near], affines),
        affines=affines,
        levels=first.levels[corner],
        levels_second=_level_for(second, first.scales[corner], affines),
    )
    likely = likeness(first.pyramid, second.pyramid, windows)
    best = _best_of_each(corner, likely)
    best = best[likely[best] > PROMISING]
    windows, corner = windows[best], corner[best]
    refined = register(first.pyramid, second.pyramid, windows)
    good = _credible(windows, refined, second, GROWTH_DRIFT, correlation)
    return _as_matches(windows, refined, number)[good]


def _level_for(second: View, scales: Floats, affines: Floats) -> Indices:
    """The level of view 2 on which a window of that scale has about as many pixels."""
    grown = scales * np.sqrt(np.maximum(np.abs(np.linalg.det(affines)), 1e-6))
    level = np.rint(np.log(grown) / np.log(FACTOR)).astype(np.intp)
    return np.asarray(np.clip(level, 0, len(second.pyramid) - 1))


def _best_of_each(group: Indices, score: Floats) -> Indices:
    """The row with the greatest score of each group."""
    order = np.lexsort((-score, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    return np.asarray(order[first])
