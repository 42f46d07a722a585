"""Groups of matches that a larger group explains as well: windows that were matched one off.

Where a pattern repeats, matches that are off by one repetition confirm each other, and look like a
body that moves by itself. Matches that predict each other are a group. A group gives way to the
larger group beside it if most of its matches at their border may be wrong by what that one
predicts: their corner in view 1 looks like the place of view 2 where it should be, or their place
in view 2 looks like the place of view 1 where it should come from. The texture of a body that moves
does neither.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.imaging.corners import select_apart
from mssegment.imaging.matching.local_maps import (
    MATCH_DISTANCE,
    PREDICTED_DRIFT,
    AffineMatches,
    credible,
    inside_picture,
    matching_level,
    plausible_maps,
)
from mssegment.imaging.matching.lucas_kanade import Windows, register
from mssegment.imaging.matching.pyramid_corners import PyramidCorners
from mssegment.imaging.matching.resampling import Indices
from mssegment.imaging.matching.support import predict, supporting_pairs
from mssegment.imaging.pyramid import size_unit
from mssegment.neighbours import nearest
from mssegment.records import Floats, Record
from mssegment.special import distinct

Flags = npt.NDArray[np.bool_]
SPACINGS = (0.0, 20.0, 40.0, 80.0)
"""Pixels, in a picture of 640 x 480, between matches that may confirm each other: all of them, and
so few that the nearest ones are in other windows of a facade."""
PREDICTING = 12
"""Nearest matches of a group whose affine map predicts; four times what determines it."""
PREDICTING_APART = 10.0
"""Pixels, in a picture of 640 x 480, between these matches, so that they span an area."""
ROUNDS = 3
"""Rounds in which groups give way; the matches that are moved predict further on."""
BORDER = 0.25
"""Share of the matches of a group, those nearest to the larger one, that decide."""
LEAST_BORDER = 5
"""The same as a number: fewer are no majority."""
MAJORITY = 0.5
"""Share of these matches that may be wrong from which on the group gives way."""


def without_rivals(
    first: PyramidCorners, second: PyramidCorners, found: AffineMatches, correlation: float
) -> AffineMatches:
    """The matches without groups that a larger one explains as well.

    Parameters
    ----------
    first, second : PyramidCorners
        The two views.
    found : AffineMatches
        Matches, the best ones first.
    correlation : float
        Least correlation of a match after registration.

    Returns
    -------
    AffineMatches
        Those of groups that gave way are left out, or moved to where the larger group predicts
        them if they match there.
    """
    for _ in range(ROUNDS):
        lost, moved = _given_way(first, second, found, correlation)
        if not lost.any():
            break
        found = found[~lost].joined_with(moved)
    return found


def groups(found: AffineMatches, unit: float) -> Indices:
    """The group [n] of each match: matches that predict each other, directly or through others.

    ``unit`` is the size of the picture in those of 640 x 480.
    """
    pairs = []
    for spacing in SPACINGS:
        rows = select_apart(found.first, spacing * unit)
        one, other = supporting_pairs(found.first[rows], found.second[rows], found.affines[rows])
        pairs.append(np.stack([rows[one], rows[other]], axis=1))
    edges = np.concatenate(pairs)
    part = np.arange(len(found.first))
    while True:
        lowest = part.copy()
        np.minimum.at(lowest, edges[:, 0], part[edges[:, 1]])
        np.minimum.at(lowest, edges[:, 1], part[edges[:, 0]])
        lowest = lowest[lowest]
        if np.array_equal(lowest, part):
            return np.asarray(np.searchsorted(distinct(part), part), dtype=np.intp)
        part = lowest


def _given_way(
    first: PyramidCorners, second: PyramidCorners, found: AffineMatches, correlation: float
) -> tuple[Flags, AffineMatches]:
    """Which matches [n] belong to groups that give way, and those that are moved instead."""
    unit = size_unit(first.pyramid[0].grey)
    part = groups(found, unit)
    size = np.bincount(part)
    rival, distance = _rivals(found, part, size)
    tested, contested = np.zeros((2, len(part)), bool)
    moved = [found[np.zeros(0, np.intp)]]
    sources = []
    for group in distinct(rival[rival >= 0]):
        rows = np.flatnonzero(rival == group)
        own = np.flatnonzero(part == group)
        basis = found[own[select_apart(found.first[own], PREDICTING_APART * unit)]]
        forth = _forth(first, second, found[rows], basis, correlation)
        back = _back(first, second, found[rows], basis, correlation)
        tested[rows] = forth.tested | back.tested
        contested[rows] = forth.matched | back.matched
        moved.append(forth.matches)
        sources.append(rows[forth.matched])
    near = _border(part, tested, distance)
    most = [
        np.bincount(part, weights=near & one, minlength=len(size)) for one in (tested, contested)
    ]
    lost = (most[1] > MAJORITY * most[0])[part]
    alternatives = moved[0]
    for matches, rows in zip(moved[1:], sources, strict=True):
        alternatives = alternatives.joined_with(matches[lost[rows]])
    return lost, alternatives


def _border(part: Indices, tested: Flags, distance: Floats) -> Flags:
    """The tested matches [n] of each group that are nearest to the larger one.

    What is predicted far from the larger group is not precise.
    """
    near = np.zeros(len(part), bool)
    rows = np.flatnonzero(tested)
    rows = rows[np.lexsort((distance[rows], part[rows]))]
    count = np.bincount(part[rows], minlength=int(part.max(initial=0)) + 1)
    rank = np.arange(len(rows)) - (np.cumsum(count) - count)[part[rows]]
    size = np.maximum(np.ceil(BORDER * count), LEAST_BORDER)
    near[rows[rank < size[part[rows]]]] = True
    return near


class _Test(Record, frozen=True):
    """Which of some matches could be tested and which matched elsewhere, and those matches."""

    tested: Flags
    matched: Flags
    matches: AffineMatches


def _rivals(found: AffineMatches, part: Indices, size: Indices) -> tuple[Indices, Floats]:
    """The larger group [n] that has a match nearest to each match; -1 for the largest group."""
    rival = np.full(len(part), -1, dtype=np.intp)
    distance = np.zeros(len(part))
    for group in range(len(size)):
        larger = np.flatnonzero(size[part] > size[group])
        if len(larger):
            rows = np.flatnonzero(part == group)
            apart, at = nearest(found.first[larger], found.first[rows])
            rival[rows], distance[rows] = part[larger[at[:, 0]]], apart[:, 0]
    return rival, distance


def _forth(
    first: PyramidCorners,
    second: PyramidCorners,
    found: AffineMatches,
    basis: AffineMatches,
    correlation: float,
) -> _Test:
    """Whether corners of view 1 match in view 2 where the ``basis`` predicts them."""
    places, affines = _extrapolated(found.first, basis.first, basis.second)
    tested = inside_picture(places, second) & plausible_maps(affines)
    return _test(first, second, found, found.first, places, affines, tested, correlation)


def _back(
    first: PyramidCorners,
    second: PyramidCorners,
    found: AffineMatches,
    basis: AffineMatches,
    correlation: float,
) -> _Test:
    """Whether places of view 2 match in view 1 where the ``basis`` says that they come from."""
    places, inverse = _extrapolated(found.second, basis.second, basis.first)
    tested = inside_picture(places, first) & plausible_maps(inverse)
    affines = np.tile(np.eye(2), (len(inverse), 1, 1))
    affines[tested] = np.linalg.inv(inverse[tested])
    return _test(first, second, found, places, found.second, affines, tested, correlation)


def _test(
    first: PyramidCorners,
    second: PyramidCorners,
    found: AffineMatches,
    one: Floats,
    other: Floats,
    affines: Floats,
    tested: Flags,
    correlation: float,
) -> _Test:
    """Register windows at ``one`` [n, 2] in view 1 and ``other`` in view 2 with these maps."""
    rows = np.flatnonzero(tested)
    scales = np.array([level.scale for level in first.pyramid])[found.levels[rows]]
    windows = Windows(
        first=one[rows],
        second=other[rows],
        affines=affines[rows],
        levels=found.levels[rows],
        levels_second=matching_level(second, scales, affines[rows]),
    )
    refined = register(first.pyramid, second.pyramid, windows)
    good = credible(windows, refined, second, PREDICTED_DRIFT, correlation)
    own = predict(one[rows], found.first[rows], found.second[rows], found.affines[rows])
    good &= np.linalg.norm(refined.second - own, axis=1) > MATCH_DISTANCE
    matched = np.zeros(len(tested), bool)
    matched[rows[good]] = True
    return _Test(tested, matched, AffineMatches.of(windows, refined, 0)[good])


def _extrapolated(places: Floats, one: Floats, other: Floats) -> tuple[Floats, Floats]:
    """Where ``places`` [n, 2] go, and the affine maps [n, 2, 2], by the nearest matches."""
    count = min(PREDICTING, len(one))
    index = nearest(one, places, count)[1]
    before, after = one[index], other[index]
    middle, image = before.mean(axis=1), after.mean(axis=1)
    before, after = before - middle[:, None], after - image[:, None]
    moments = np.einsum("nki,nkj->nij", before, before)
    # few matches, or matches on a line, say nothing across it
    regular = 1.0 + 1e-3 * np.trace(moments, axis1=1, axis2=2)
    moments += regular[:, None, None] * np.eye(2)
    mixed = np.einsum("nki,nkj->nij", after, before) + regular[:, None, None] * np.eye(2)
    maps = mixed @ np.linalg.inv(moments)
    return image + np.einsum("nij,nj->ni", maps, places - middle), maps
