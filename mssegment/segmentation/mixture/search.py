"""The search for partitions: from the modes, by refinement and merging, down to one group."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from mssegment.geometry.robust import relabelled
from mssegment.records import Floats, Integers
from mssegment.segmentation.mixture.likelihood import Likelihood, membership
from mssegment.segmentation.mixture.mode_votes import ModeVotes
from mssegment.segmentation.selection import SelectionProblem

STARTS = 14
"""Modes of one set that a search starts from, those with most hypotheses."""
VOTE_WEIGHT = 3.0
"""Weight of the labels as the modes predict them: 2 to 4 do equally well; with 1 the clouds part
bodies that every mode holds together, with 6 the modes join bodies that the clouds keep apart."""
LOOSE = 1.0
"""The weight of the first search: at full weight labels hold each other fast."""


def starts(
    problem: SelectionProblem, mode_votes: Sequence[ModeVotes], kept: Integers
) -> list[Integers]:
    """Partitions of the tracks ``kept`` to begin with, two of each set.

    The mode that fits a track best, among those with most hypotheses; and the mode to which most
    hypotheses of the track climb.
    """
    fitting = [_best_fitting(problem, index)[kept] for index in range(len(problem.observed_sets))]
    climbing = [one.vote_shares[kept].argmax(axis=1) for one in mode_votes]
    return [relabelled(labels) for labels in fitting + climbing]


def _best_fitting(problem: SelectionProblem, index: int) -> Integers:
    modes = sorted(
        (mode for mode in problem.modes if mode.set_index == index),
        key=lambda mode: -mode.hypotheses,
    )[:STARTS]
    residuals = problem.observed_sets[index].residuals(np.stack([mode.point for mode in modes]))
    return np.asarray(residuals.argmin(axis=0))


def partitions(likelihood: Likelihood, begin: Sequence[Integers]) -> dict[int, Integers]:
    """The cheapest partition found, labels 0.. [P], for each number of groups."""
    best: dict[int, tuple[float, Integers]] = {}
    for labels in begin:
        found = [*_descend(likelihood, labels, LOOSE), *_descend(likelihood, labels, VOTE_WEIGHT)]
        for candidate in found:
            refined = likelihood.refine(candidate, VOTE_WEIGHT)
            groups, cost = int(refined.max()) + 1, likelihood.cost(refined, VOTE_WEIGHT)
            if groups not in best or cost < best[groups][0]:
                best[groups] = (cost, refined)
    return {groups: labels for groups, (_, labels) in best.items()}


def _descend(likelihood: Likelihood, labels: Integers, weight: float) -> list[Integers]:
    """Refined partitions on the way to one group; the pair whose union costs least is merged."""
    found = []
    while True:
        labels = likelihood.refine(labels, weight)
        found.append(labels)
        if not labels.any():
            return found
        pairs, saved = saved_by_parting(likelihood, labels, weight)
        i, j = pairs[int(saved.argmin())]
        labels = np.where(labels == j, i, labels - (labels > j))


def saved_by_parting(
    likelihood: Likelihood, labels: Integers, weight: float
) -> tuple[list[tuple[int, int]], Floats]:
    """All pairs of groups, and what each pair costs less apart than as one (nats)."""
    members = membership(labels)
    pairs = list(combinations(range(len(members)), 2))
    first, second = np.array(pairs).T
    apart = likelihood.group_costs(members, weight)
    union = likelihood.group_costs(members[first] + members[second], weight)
    return pairs, union - apart[first] - apart[second]
