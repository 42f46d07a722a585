"""The search for the set of motions with the shortest description.

It starts with the candidates that save most, one after the other; then, as long as the description
gets shorter, it changes the set by the best of a few moves (add, remove, exchange a motion), each
followed by joint refitting, without which a motion that has swallowed another hides what it hides.
Where none of them helps, bodies are cut by where their tracks lie: a motion fitted to two bodies
is too good a compromise for either of them to enter while it is there, whatever the candidates.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates, join
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.refinement import refine

PROPOSALS = 3
"""Candidates that are tried as an addition; each saves on other tracks than those before."""
MOST_MOVES = 30
"""Bound on the changes of the set; each shortens the description."""
MOST_REFITS = 10
"""Bound on the joint refits of a set that the search has chosen."""
IMPROVEMENT = 1e-3
"""Nats below which a change is no improvement."""


def start(pool: Candidates, description: Description) -> Candidates:
    """Candidates one after the other, the one that saves most first, as long as one saves."""
    chosen = pool.take([])
    best = description.saved(chosen)
    while True:
        tried = [join([chosen, pool.take([k])]) for k in proposals(chosen, pool, PROPOSALS)]
        values = [description.saved(one) for one in tried]
        if not values or max(values) <= best + IMPROVEMENT:
            return chosen
        chosen, best = tried[int(np.argmax(values))], max(values)


def improve(chosen: Candidates, pool: Candidates, description: Description) -> Candidates:
    """Changes the set by the best move until no move shortens the description."""
    chosen, best = refitted(chosen, description)
    for _ in range(MOST_MOVES):
        better = best_of(neighbouring_sets(chosen, pool, description), best, description)
        if better is None:
            better = best_of(restated_sets(chosen, description), best, description)
        if better is None:
            better = best_of(cut_sets(chosen, description), best, description)
        if better is None:
            break
        chosen, best = refitted(better, description)
    return chosen


def best_of(
    sets: Sequence[Candidates], least: float, description: Description
) -> Candidates | None:
    """The one of ``sets`` that saves most once refitted, if that is more than ``least``."""
    sets = refine(description, sets)
    values = [description.saved(one) for one in sets]
    if not values or max(values) <= least + IMPROVEMENT:
        return None
    return sets[int(np.argmax(values))]


def refitted(chosen: Candidates, description: Description) -> tuple[Candidates, float]:
    """The set refitted until its description gets no shorter, and what it saves."""
    best = description.saved(chosen)
    for _ in range(MOST_REFITS):
        (again,) = refine(description, [chosen])
        value = description.saved(again)
        if value <= best + IMPROVEMENT:
            break
        chosen, best = again, value
    return chosen, best


def neighbouring_sets(
    chosen: Candidates, pool: Candidates, description: Description
) -> list[Candidates]:
    """All sets that one addition, removal or exchange makes of ``chosen``."""
    labels = description.labels(chosen)
    sets = [
        addition(chosen, labels, pool.take([k]), description)
        for k in proposals(chosen, pool, PROPOSALS)
    ]
    sets += [join([chosen, one]) for one in leftovers(labels, description)]
    for j in range(len(chosen)):
        rest = chosen.take([k for k in range(len(chosen)) if k != j])
        sets.append(rest)
        sets += [join([rest, pool.take([k])]) for k in proposals(rest, pool, 1)]
    return sets


def restated_sets(chosen: Candidates, description: Description) -> list[Candidates]:
    """All sets with one motion stated in another model, fitted to the tracks that it has.

    The candidates that save most are of the model with most parameters, before these are paid for.
    """
    labels = description.labels(chosen)
    sets = []
    for j in range(len(chosen)):
        own = (labels == j + 1).astype(np.float64)
        rest = chosen.take([k for k in range(len(chosen)) if k != j])
        for family in description.families:
            if family.index != chosen.set_indices[j]:
                sets += [join([rest, one]) for one in family.fitted(own[None], chosen.modes[[j]])]
    return sets


def cut_sets(chosen: Candidates, description: Description) -> list[Candidates]:
    """All sets with one motion cut in two, or with two motions of one model cut afresh.

    Only of motions that leave their tracks something free: such a one may fit two bodies well.
    """
    labels = description.labels(chosen)
    sets = []
    for i, j in combinations_with_replacement(range(len(chosen)), 2):
        family = description.families[int(chosen.set_indices[i])]
        if (
            not family.observed_set.model.leaves_parallax_free
            or chosen.set_indices[j] != chosen.set_indices[i]
        ):
            continue
        halves = cut((labels == i + 1) | (labels == j + 1), description.places)
        if halves.sum(axis=1).min() <= family.observed_set.model.subset_size:
            continue
        rest = chosen.take([k for k in range(len(chosen)) if k not in (i, j)])
        for both in family.fitted(halves, chosen.modes[[i, j]]):
            if len(both) == 2:
                sets.append(join([rest, both]))
    return sets


def cut(tracks: Flags, places: Floats) -> Floats:
    """The ``tracks`` [P] in two halves, [2, P] (0 or 1), that lie apart: two means of ``places``.

    They start on either side of the mean, along the direction in which the tracks spread most.
    """
    own = np.flatnonzero(tracks)
    away = places[own] - places[own].sum(axis=0) / max(len(own), 1)
    far = away @ np.linalg.eigh(away.T @ away)[1][:, -1] > 0
    for _ in range(MOST_REFITS):
        if far.all() or not far.any():
            break
        square = [((away - away[half].mean(axis=0)) ** 2).sum(axis=1) for half in (far, ~far)]
        before, far = far, square[0] < square[1]
        if (far == before).all():
            break
    halves = np.zeros((2, len(tracks)))
    halves[0, own[~far]] = halves[1, own[far]] = 1.0
    return halves


def leftovers(labels: Integers, description: Description) -> list[Candidates]:
    """One motion of every calibrated family fitted to all tracks without a motion.

    A small body among many tracks has few hypotheses, which a mode of the static world swallows.
    """
    left = (labels == 0).astype(np.float64)[None]
    found = []
    for family in description.families:
        if family.observed_set.model.needs_camera:
            found += family.fitted(left, np.array([-1]))
    return found


def addition(
    chosen: Candidates, labels: Integers, new: Candidates, description: Description
) -> Candidates:
    """The set with ``new``, and with the motion that loses most fitted to what is left.

    A motion fitted to two bodies is too wide to let one of them go by itself.
    """
    family = description.families[int(new.set_indices[0])]
    taken = family.explained(new.residuals, new.scales)[0] > 0
    losses = np.bincount(labels[taken], minlength=len(chosen) + 1)[1:]
    if losses.any():
        j = int(losses.argmax())
        left = ((labels == j + 1) & ~taken).astype(np.float64)
        loser = description.families[int(chosen.set_indices[j])]
        for one in loser.fitted(left[None], chosen.modes[[j]]):
            return join([chosen.take([k for k in range(len(chosen)) if k != j]), new, one])
    return join([chosen, new])


def proposals(chosen: Candidates, pool: Candidates, count: int) -> list[int]:
    """The ``count`` candidates that save most beside ``chosen``, each on other tracks."""
    better = pool.gains - np.maximum(chosen.gains.max(axis=0, initial=0.0), 0.0)
    np.maximum(better, 0.0, out=better)
    open_tracks = np.ones(better.shape[1])
    found: list[int] = []
    for _ in range(min(count, len(pool))):
        saves = better @ open_tracks
        k = int(saves.argmax())
        if saves[k] <= 0:
            break
        found.append(k)
        open_tracks[better[k] > 0] = 0.0
    return found
