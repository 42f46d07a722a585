"""The search for the set of motions with the shortest description.

It starts with the candidates that save most, one after the other; then, as long as the description
gets shorter, it changes the set by the best of a few moves (add, remove, exchange a motion), each
followed by joint refitting, without which a motion that has swallowed another hides what it hides.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Integers
from mssegment.segmentation.candidates import Candidates, join
from mssegment.segmentation.description import Description
from mssegment.segmentation.refinement import refine

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
        sets = refine(description, neighbouring_sets(chosen, pool, description))
        values = [description.saved(one) for one in sets]
        if not values or max(values) <= best + IMPROVEMENT:
            break
        chosen, best = refitted(sets[int(np.argmax(values))], description)
    return chosen


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


def leftovers(labels: Integers, description: Description) -> list[Candidates]:
    """One motion of every calibrated family fitted to all tracks without a motion.

    A small body among many tracks has few hypotheses, which a mode of the static world swallows.
    """
    left = (labels == 0).astype(np.float64)[None]
    found = []
    for family in description.families:
        if family.view.model.needs_camera:
            found += family.fitted(left, np.array([-1]))
    return found


def addition(
    chosen: Candidates, labels: Integers, new: Candidates, description: Description
) -> Candidates:
    """The set with ``new``, and with the motion that loses most fitted to what is left.

    A motion fitted to two bodies is too wide to let one of them go by itself.
    """
    family = description.families[int(new.views[0])]
    taken = family.explained(new.residuals, new.scales)[0] > 0
    losses = np.bincount(labels[taken], minlength=len(chosen) + 1)[1:]
    if losses.any():
        j = int(losses.argmax())
        left = ((labels == j + 1) & ~taken).astype(np.float64)
        loser = description.families[int(chosen.views[j])]
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
