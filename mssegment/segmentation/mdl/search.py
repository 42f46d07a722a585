"""Search for the set of motions with the shortest description.

It starts greedily with the candidates that save most. Then, as long as the description becomes
shorter, it makes the best of a few moves (add, remove or exchange a motion), each followed by joint
refinement, without which a motion that includes two objects hides both of them. If none of these
moves helps, a motion is expressed in another model, or motions are split by the positions of their
tracks: a motion fitted to two objects is so good a compromise that no candidate for either of them
saves enough as long as it is in the set.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, combinations_with_replacement

import numpy as np

from mssegment.models import Flags
from mssegment.progress import track
from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates, concatenate
from mssegment.segmentation.mdl.contact import contacts
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.refinement import refine

MAX_PROPOSALS = 3
"""Candidates that are tried as an addition; each saves on other tracks than those before."""
MAX_LOOK_AHEAD = 8
"""Most motions that are added although none of them pays by itself."""
MAX_MOVES = 30
"""Maximum number of moves; each shortens the description."""
MAX_REFITS = 10
"""Maximum number of joint refits of a set that the search has accepted."""
GAP = 0.5
"""Contact below which two parts of a motion may be two bodies; half of that of a cut."""
K_MEANS_ROUNDS = 10
"""Maximum number of rounds of two-means."""
MIN_IMPROVEMENT = 1e-3
"""Smallest improvement in nats."""


def start(pool: Candidates, description: Description) -> Candidates:
    """Add candidates, the one that saves most first, as long as the description becomes shorter."""
    current = pool.take([])
    best = description.saved(current)
    while True:
        sets = [
            concatenate([current, pool.take([k])]) for k in proposals(current, pool, MAX_PROPOSALS)
        ]
        values = [description.saved(one) for one in sets]
        if not values or max(values) <= best + MIN_IMPROVEMENT:
            return current if len(current) else look_ahead(pool, description)
        current, best = sets[int(np.argmax(values))], max(values)


def look_ahead(pool: Candidates, description: Description) -> Candidates:
    """Add candidates although none shortens the description; the best refitted set that does.

    Of few tracks, no motion alone saves what its labels cost, but all of them together may: then no
    track is an outlier, and that costs nothing to say.
    """
    current = best = pool.take([])
    most = description.saved(current)
    for _ in range(MAX_LOOK_AHEAD):
        sets = [
            concatenate([current, pool.take([k])]) for k in proposals(current, pool, MAX_PROPOSALS)
        ]
        if not sets:
            break
        current = sets[int(np.argmax([description.saved(one) for one in sets]))]
        refined, value = refitted(current, description)
        if value > most + MIN_IMPROVEMENT:
            best, most = refined, value
    return best


def improve(current: Candidates, pool: Candidates, description: Description) -> Candidates:
    """Change the set by the best move until no move shortens the description."""
    current, best = refitted(current, description)
    for _ in track(iter(range(MAX_MOVES)), "changes"):
        better = best_of(neighbouring_sets(current, pool, description), best, description)
        if better is None:
            better = best_of(model_changes(current, description), best, description)
        if better is None:
            better = best_of(split_sets(current, description), best, description)
        if better is None:
            break
        current, best = refitted(better, description)
    return current


def best_of(
    sets: Sequence[Candidates], least: float, description: Description
) -> Candidates | None:
    """The one of ``sets`` that saves most after refinement, if that is more than ``least``."""
    sets = refine(description, sets)
    values = [description.saved(one) for one in sets]
    if not values or max(values) <= least + MIN_IMPROVEMENT:
        return None
    return sets[int(np.argmax(values))]


def refitted(current: Candidates, description: Description) -> tuple[Candidates, float]:
    """The set refitted until its description gets no shorter, and what it saves."""
    best = description.saved(current)
    for _ in range(MAX_REFITS):
        (updated,) = refine(description, [current])
        value = description.saved(updated)
        if value <= best + MIN_IMPROVEMENT:
            break
        current, best = updated, value
    return current, best


def neighbouring_sets(
    current: Candidates, pool: Candidates, description: Description
) -> list[Candidates]:
    """All sets that differ from ``current`` by one addition, removal or exchange."""
    labels = description.labels(current)
    sets = [
        with_addition(current, labels, pool.take([k]), description)
        for k in proposals(current, pool, MAX_PROPOSALS)
    ]
    sets += [concatenate([current, new]) for new in outlier_motions(labels, description)]
    for j in range(len(current)):
        rest = current.without(j)
        sets.append(rest)
        sets += [concatenate([rest, pool.take([k])]) for k in proposals(rest, pool, 1)]
    return sets + (merged_sets(current, labels, description) if description.shared_points else [])


def merged_sets(
    current: Candidates, labels: Integers, description: Description
) -> list[Candidates]:
    """All sets with two motions of a family replaced by one, fitted to the tracks of both.

    The tail of a structure may be another one beside it, and neither grows into the other.
    """
    sets = []
    for i, j in combinations(range(len(current)), 2):
        index = int(current.set_indices[i])
        if current.set_indices[j] == index:
            both = np.isin(labels, (i + 1, j + 1)).astype(np.float64)[None]
            rest = current.without(i, j)
            fitted = description.families[index].fitted(both, current.modes[[i]])
            sets += [concatenate([rest, one]) for one in fitted]
    return sets


def model_changes(current: Candidates, description: Description) -> list[Candidates]:
    """All sets with one motion expressed in another model, fitted to its tracks.

    The candidates that save most, before parameters are paid for, are of the model with most of
    them.
    """
    labels = description.labels(current)
    sets = []
    for j in range(len(current)):
        inliers = (labels == j + 1).astype(np.float64)
        rest = current.without(j)
        for family in description.families:
            if family.index != current.set_indices[j]:
                refits = family.fitted(inliers[None], current.modes[[j]])
                sets += [concatenate([rest, new]) for new in refits]
    return sets


def split_sets(current: Candidates, description: Description) -> list[Candidates]:
    """All sets with one motion split in two, or with the tracks of two motions split differently.

    The latter only for motions that leave parallax free, one of which may fit two objects well.
    """
    labels = description.labels(current)
    sets = split_at_gaps(current, labels, description)
    for i, j in combinations_with_replacement(range(len(current)), 2):
        family = description.families[int(current.set_indices[i])]
        if (
            not family.observed_set.model.leaves_parallax_free
            or current.set_indices[j] != current.set_indices[i]
        ):
            continue
        halves = split_tracks((labels == i + 1) | (labels == j + 1), description.positions)
        if halves.sum(axis=1).min() <= family.observed_set.model.subset_size:
            continue
        rest = current.without(i, j)
        for both in family.fitted(halves, current.modes[[i, j]]):
            if len(both) == 2:
                sets.append(concatenate([rest, both]))
    return sets


def split_at_gaps(
    current: Candidates, labels: Integers, description: Description
) -> list[Candidates]:
    """All sets with the tracks of one motion split in two parts of the matches that do not touch.

    In noise, or where tracks are few, one motion fits two bodies so well that no candidate for
    either of them saves enough.
    """
    if not description.by_contact or description.displacements is None:
        return []
    assert description.neighbours is not None
    positions = description.positions
    matches = np.concatenate([positions, positions + description.displacements], axis=1)
    sets = []
    for k in range(len(current)):
        halves = split_tracks(labels == k + 1, matches)
        parts = (halves[0] + 2 * halves[1]).astype(np.int64)
        if contacts(parts, description.neighbours, 2)[0, 1] > GAP:
            continue
        rest = current.without(k)
        for family in description.families:
            for both in family.fitted(halves, current.modes[[k, k]]):
                if len(both) == 2:
                    sets.append(concatenate([rest, both]))
    return sets


def split_tracks(tracks: Flags, positions: Floats) -> Floats:
    """Split tracks into two halves that are apart, by two-means of their positions.

    The halves are initially on either side of the mean along the first principal direction.

    Parameters
    ----------
    tracks : ndarray [P] of bool
        The tracks to split.
    positions : ndarray [P, d]
        Their positions, or matches.

    Returns
    -------
    ndarray [2, P]
        Membership of each half (0 or 1).
    """
    index = np.flatnonzero(tracks)
    centred = positions[index] - positions[index].sum(axis=0) / max(len(index), 1)
    second = centred @ np.linalg.eigh(centred.T @ centred)[1][:, -1] > 0
    for _ in range(K_MEANS_ROUNDS):
        if second.all() or not second.any():
            break
        square = [
            ((centred - centred[half].mean(axis=0)) ** 2).sum(axis=1) for half in (second, ~second)
        ]
        before, second = second, square[0] < square[1]
        if (second == before).all():
            break
    halves = np.zeros((2, len(tracks)))
    halves[0, index[~second]] = halves[1, index[second]] = 1.0
    return halves


def outlier_motions(labels: Integers, description: Description) -> list[Candidates]:
    """One motion of every family, fitted to all tracks without a motion.

    A small object among many tracks has few hypotheses, which a mode of the background absorbs.
    """
    outliers = (labels == 0).astype(np.float64)[None]
    found = []
    for family in description.families:
        found += family.fitted(outliers, np.array([-1]))
    return found


def with_addition(
    current: Candidates, labels: Integers, new: Candidates, description: Description
) -> Candidates:
    """Add ``new``, and refit the motion that loses most tracks to the remaining ones.

    A motion fitted to two objects has too large a scale for one of them to be added alone.
    """
    family = description.families[int(new.set_indices[0])]
    taken = family.explained(new.residuals, new.scales)[0] > 0
    losses = np.bincount(labels[taken], minlength=len(current) + 1)[1:]
    if losses.any():
        j = int(losses.argmax())
        remaining = ((labels == j + 1) & ~taken).astype(np.float64)
        loser = description.families[int(current.set_indices[j])]
        for refit in loser.fitted(remaining[None], current.modes[[j]]):
            return concatenate([current.without(j), new, refit])
    return concatenate([current, new])


def proposals(current: Candidates, pool: Candidates, count: int) -> list[int]:
    """Indices of the ``count`` candidates that save most in addition to ``current``.

    Each saves on other tracks than those before.
    """
    improvement = pool.gains - np.maximum(current.gains.max(axis=0, initial=0.0), 0.0)
    np.maximum(improvement, 0.0, out=improvement)
    remaining = np.ones(improvement.shape[1])
    found: list[int] = []
    for _ in range(min(count, len(pool))):
        saved = improvement @ remaining
        k = int(saved.argmax())
        if saved[k] <= 0:
            break
        found.append(k)
        remaining[improvement[k] > 0] = 0.0
    return found
