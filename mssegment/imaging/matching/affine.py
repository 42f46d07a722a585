"""Matcher ``affine``: two views that differ by rotation, scale, slant and brightness.

Corners of a pyramid are compared by oriented normalised patches. Distinctive mutual pairs are
registered by affine Lucas-Kanade, which verifies them, refines their position below a pixel and
gives each match a local affine map. By these maps matches confirm each other, and predict the
positions of corners that are still unmatched.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.imaging.corners import select_apart
from mssegment.imaging.matching.descriptors import compressed, describe
from mssegment.imaging.matching.local_maps import (
    MATCH_DISTANCE,
    PREDICTED_DRIFT,
    AffineMatches,
    credible,
    matching_level,
)
from mssegment.imaging.matching.lucas_kanade import Windows, correlations, register
from mssegment.imaging.matching.nearest import Pairs, mutual
from mssegment.imaging.matching.orientation import dominant_directions
from mssegment.imaging.matching.pyramid_corners import PyramidCorners, two_views
from mssegment.imaging.matching.resampling import Indices
from mssegment.imaging.matching.rivals import without_rivals
from mssegment.imaging.matching.support import (
    distance_to_matches,
    has_support,
    nearest_matches,
    predict,
)
from mssegment.imaging.pictures import GreyPicture
from mssegment.imaging.pyramid import size_unit
from mssegment.neighbours import pairs_within
from mssegment.progress import track
from mssegment.records import Corners, Floats, Tracks

RATIO = 0.85
"""Of the ratio test (Lowe, IJCV 2004)."""
SAME_CORNER_DISTANCE = 4.0
"""Pixels; descriptors nearer to each other describe the same corner."""
MAX_DRIFT = 8.0
"""Pixels of the level by which registration may move a match of two descriptors."""
MIN_CORRELATION = 0.8
PAIRS_PER_PLACE = 2
"""Pairs of patches that are registered at one place in view 1."""
SUPPORT = (2, 4)
"""Neighbours that must confirm a match: first while many neighbours are wrong, then finally."""
GROWTH_ROUNDS = 3
GROWTH_NEIGHBOURS = 3
"""Nearest matches that predict the position of an unmatched corner."""
GROWTH_RADIUS = 40.0
"""Pixels, in a picture of 640 x 480, within which a match predicts."""
PROMISING_CORRELATION = 0.4
"""Correlation at a predicted position that makes registration worthwhile."""


def match(
    pictures: Sequence[GreyPicture],
    corners: Sequence[Corners],
    *,
    ratio: float = RATIO,
    correlation: float = MIN_CORRELATION,
    rounds: int = GROWTH_ROUNDS,
) -> Tracks:
    """Match two views by oriented patches and affine Lucas-Kanade.

    Parameters
    ----------
    pictures : sequence of two float32 arrays [height, width]
        Grey values 0 to 255.
    corners : sequence of two Corners
        The corners of each picture.
    ratio : float
        Largest ratio of the distances to the nearest patch and to the nearest at another place.
    correlation : float
        Least correlation after registration.
    rounds : int
        Largest number of rounds in which matches predict further ones.

    Returns
    -------
    Tracks
        Matches [P, 2, 2] in pixels, best correlation first; ``affines`` [P, 2, 2] are their local
        affine maps from view 1 to view 2.

    Raises
    ------
    ValueError
        For other than two pictures.
    """
    first, second = two_views(pictures, corners)
    found = _confirmed(_descriptor_matches(first, second, ratio, correlation))
    for number in track(range(1, rounds + 1), "rounds"):
        found = _confirmed(found.joined_with(_grow(first, second, found, number, correlation)))
        if not (found.grown_in == number).any():
            break
    kept = without_rivals(first, second, found, correlation)
    found = _best_first(found if kept is found else _confirmed(kept))
    return Tracks(points=np.stack([found.first, found.second], axis=1), affines=found.affines)


def _descriptor_matches(
    first: PyramidCorners, second: PyramidCorners, ratio: float, correlation: float
) -> AffineMatches:
    """Distinctive mutual pairs of patches that registration confirms."""
    corner1, angle1 = dominant_directions(first)
    corner2, angle2 = dominant_directions(second)
    one = compressed(describe(first.take(corner1), angle1))
    two = compressed(describe(second.take(corner2), angle2))
    pairs = mutual(
        one, two, 0.0, ratio=ratio, places=second.points[corner2], apart=SAME_CORNER_DISTANCE
    )
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
    good = credible(windows, refined, second, MAX_DRIFT, correlation)
    return AffineMatches.of(windows, refined, 0)[good]


def _uncrowded(pairs: Pairs, places: Floats) -> Pairs:
    """The pairs with fewer than PAIRS_PER_PLACE better ones at their place in view 1.

    ``places`` are those of all patches of view 1. Only one pair of a place survives in the end, but
    candidates may differ in scale or direction, and only registration tells which is right.
    """
    one, two = pairs_within(places[pairs.first], MATCH_DISTANCE).T
    worse = np.where(pairs.correlation[one] < pairs.correlation[two], one, two)
    kept = np.bincount(worse, minlength=len(pairs.first)) < PAIRS_PER_PLACE
    return Pairs(pairs.first[kept], pairs.second[kept], pairs.correlation[kept])


def _best_first(found: AffineMatches) -> AffineMatches:
    """The matches in the order of their correlation."""
    return found[np.argsort(-found.correlation, kind="stable")]


def _confirmed(found: AffineMatches) -> AffineMatches:
    """The best match of every place, and of these the ones that their neighbours confirm."""
    found = _best_first(found)
    found = found[select_apart(found.first, MATCH_DISTANCE)]
    for min_support in SUPPORT:
        found = found[has_support(found.first, found.second, found.affines, min_support)]
    return found


def _grow(
    first: PyramidCorners,
    second: PyramidCorners,
    found: AffineMatches,
    number: int,
    correlation: float,
) -> AffineMatches:
    """Matches for unmatched corners, at the positions that their neighbours predict.

    Round ``number`` uses the neighbours found in the round before: older ones have been tried.
    """
    if not len(found.first):
        return found
    free = np.flatnonzero(distance_to_matches(first.points, found.first) >= MATCH_DISTANCE)
    if not len(free):
        return found[free]
    radius = GROWTH_RADIUS * size_unit(first.pyramid[0].grey)
    rows, near = nearest_matches(first.points[free], found.first, GROWTH_NEIGHBOURS, radius)
    untried = found.grown_in[near] == number - 1
    rows, near = rows[untried], near[untried]
    corner = free[rows]
    affines = found.affines[near]
    windows = Windows(
        first=first.points[corner],
        second=predict(first.points[corner], found.first[near], found.second[near], affines),
        affines=affines,
        levels=first.levels[corner],
        levels_second=matching_level(second, first.scales[corner], affines),
    )
    likely = correlations(first.pyramid, second.pyramid, windows)
    best = _best_of_each(corner, likely)
    best = best[likely[best] > PROMISING_CORRELATION]
    windows, corner = windows[best], corner[best]
    refined = register(first.pyramid, second.pyramid, windows)
    good = credible(windows, refined, second, PREDICTED_DRIFT, correlation)
    return AffineMatches.of(windows, refined, number)[good]


def _best_of_each(group: Indices, score: Floats) -> Indices:
    """The row with the greatest score of each group."""
    order = np.lexsort((-score, group))
    first = np.ones(len(order), bool)
    first[1:] = group[order][1:] != group[order][:-1]
    return np.asarray(order[first])
