"""Search for partitions: from the modes, by refinement and merging, down to one group."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from mssegment.geometry.robust import relabelled
from mssegment.records import Floats, Integers
from mssegment.segmentation.mixture.likelihood import Likelihood, membership
from mssegment.segmentation.mixture.mode_votes import ModeVotes
from mssegment.segmentation.selection import SelectionProblem

MODES_PER_START = 14
"""Modes of a set that a search starts from: those with most hypotheses."""
VOTE_WEIGHT = 3.0
"""Weight of the labels predicted by the modes. Values from 2 to 4 work equally well. With 1, the
Student t distributions split motions whose tracks share all modes; with 6, the modes merge motions
that the distributions separate."""
FIRST_VOTE_WEIGHT = 1.0
"""The weight in the first of two searches: with full weight, labels hardly change."""


def starts(
    problem: SelectionProblem, mode_votes: Sequence[ModeVotes], tracks: Integers
) -> list[Integers]:
    """Initial partitions of ``tracks``, two for each set.

    In the first, the label of a track is the mode that fits it best, among those with most
    hypotheses; in the second, the mode to which most of its hypotheses converge.
    """
    fitting = [_best_fitting(problem, index)[tracks] for index in range(len(problem.observed_sets))]
    voted = [votes.vote_shares[tracks].argmax(axis=1) for votes in mode_votes]
    return [relabelled(labels) for labels in fitting + voted]


def _best_fitting(problem: SelectionProblem, index: int) -> Integers:
    """The mode of a set that fits each track best, among those with most hypotheses."""
    modes = sorted(
        (mode for mode in problem.modes if mode.set_index == index),
        key=lambda mode: -mode.hypotheses,
    )[:MODES_PER_START]
    residuals = problem.observed_sets[index].residuals(np.stack([mode.point for mode in modes]))
    return np.asarray(residuals.argmin(axis=0))


def partitions(likelihood: Likelihood, initial: Sequence[Integers]) -> dict[int, Integers]:
    """The partition of least cost for each number of groups, with labels 0, 1, ... [P]."""
    best: dict[int, tuple[float, Integers]] = {}
    for labels in initial:
        candidates = [
            candidate
            for weight in (FIRST_VOTE_WEIGHT, VOTE_WEIGHT)
            for candidate in _merge_down(likelihood, labels, weight)
        ]
        for candidate in candidates:
            refined = likelihood.refine(candidate, VOTE_WEIGHT)
            groups, cost = int(refined.max()) + 1, likelihood.cost(refined, VOTE_WEIGHT)
            if groups not in best or cost < best[groups][0]:
                best[groups] = (cost, refined)
    return {groups: labels for groups, (_, labels) in best.items()}


def _merge_down(likelihood: Likelihood, labels: Integers, weight: float) -> list[Integers]:
    """Refined partitions down to one group; the pair whose union costs least is merged."""
    found = []
    while True:
        labels = likelihood.refine(labels, weight)
        found.append(labels)
        if not labels.any():
            return found
        pairs, saved = split_savings(likelihood, labels, weight)
        i, j = pairs[int(saved.argmin())]
        labels = np.where(labels == j, i, labels - (labels > j))


def split_savings(
    likelihood: Likelihood, labels: Integers, weight: float
) -> tuple[list[tuple[int, int]], Floats]:
    """All pairs of groups, and by how much the union of each costs more than both, in nats."""
    members = membership(labels)
    pairs = list(combinations(range(len(members)), 2))
    first, second = np.array(pairs).T
    separate = likelihood.group_costs(members, weight)
    union = likelihood.group_costs(members[first] + members[second], weight)
    return pairs, union - separate[first] - separate[second]
