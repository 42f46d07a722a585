"""Long sequences after mean shift: modes, then groups, then a likelihood that refines them.

Over tens of frames one body's perspective spreads its hypotheses, and bodies that move alike share
a subspace, so modes alone say too little. They start the search: every track joins the mode that
fits it best; then groups are Student-t clouds in the leading principal components of the tracks,
refined by hard expectation maximization and merged, the pair that costs least first.
"""

from __future__ import annotations

from itertools import combinations
from typing import Literal

import numpy as np

from mssegment.hypotheses import hypothesize
from mssegment.motions import Flags
from mssegment.records import Floats, HypothesisSet, Integers
from mssegment.segmentation.consensus.bodies import (
    FEWEST,
    cloud_cost,
    partition_cost,
    principal_components,
    refine,
)
from mssegment.segmentation.consensus.outliers import leave_one_out_residuals
from mssegment.segmentation.selection import Choice, Chosen, Problem, View

HYPOTHESES = 200
"""Hypotheses of each rank: more change nothing, since they only start the search."""
STARTS = 14
"""Modes of one set that the search starts from, those with most hypotheses."""
DISTINCT = 95.0
"""Two groups are two bodies if (cost of the union - cost apart) / sqrt(tracks) is above this."""
OUTLYING = 20.0
"""A track is an outlier if its residual, over its group's median, is above this."""
PLANAR = 1.25
"""A body is planar if rank 3 leaves at most so many times the residual of rank 4."""
MOST_MOTIONS = 8


def draw_long_sets(
    points: Floats,
    *,
    count: int | Literal["auto"],
    sampling: Literal["local", "uniform"],
    eligible: Flags,
    rank: int | Literal["auto"],
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    """One set of hypotheses per rank (3 planar, 4 general; ``auto``: both), as ``hypothesize``.

    ``count`` is per set; ``auto`` means HYPOTHESES.
    """
    ranks = (3, 4) if rank == "auto" else (rank,)
    wanted = HYPOTHESES if count == "auto" else count
    return [
        entry
        for own in ranks
        for entry in hypothesize(
            points,
            model="factorization",
            count=wanted,
            sampling=sampling,
            eligible=eligible,
            rank=own,
            rng=rng,
        )
    ]


def clouds(problem: Problem) -> Choice:
    """The selection for ``factorization`` over many frames: a motion per group of tracks."""
    components = principal_components(problem.points)
    best: dict[int, Integers] = {}
    for index in range(len(problem.views)):
        _descend(components, _start(problem, index), best)
    groups = _count(problem, components, best)
    labels = best[groups]
    chosen = [_chosen(problem, labels == group) for group in range(groups)]
    taken: set[int] = set()
    motions = []
    for motion in chosen:
        mode = _mode_of(problem, motion, taken)
        if mode is not None:
            taken.add(mode)
        motions.append(Chosen(motion.set, motion.point, motion.inliers, mode, motion.scale))
    return Choice(tuple(motions))


def _start(problem: Problem, index: int) -> Integers:
    """The mode of set ``index`` that fits each track best, among those with most hypotheses."""
    modes = sorted(
        (mode for mode in problem.modes if mode.set == index), key=lambda mode: -mode.hypotheses
    )[:STARTS]
    residuals = problem.views[index].residuals(np.stack([mode.point for mode in modes]))
    return np.unique(residuals.argmin(axis=0), return_inverse=True)[1].ravel()


def _descend(components: Floats, labels: Integers, best: dict[int, Integers]) -> None:
    """Refines and merges down to one group; ``best`` keeps the cheapest partition of each count."""
    while True:
        labels = refine(components, labels)
        count = int(labels.max()) + 1
        known = best.get(count)
        if known is None or partition_cost(components, labels) < partition_cost(components, known):
            best[count] = labels
        if count == 1:
            return
        members = [np.flatnonzero(labels == group) for group in range(count)]
        saved = {pair: saved_by_parting(components, members, pair) for pair in _pairs(count)}
        i, j = min(saved, key=lambda pair: saved[pair])
        labels = np.where(labels == j, i, labels - (labels > j))


def saved_by_parting(components: Floats, members: list[Integers], pair: tuple[int, int]) -> float:
    """What two groups cost less apart than as one (nats)."""
    first, second = members[pair[0]], members[pair[1]]
    total = len(components)
    union = cloud_cost(components[np.concatenate([first, second])], total)
    return union - sum(cloud_cost(components[group], total) for group in (first, second))


def _count(problem: Problem, components: Floats, best: dict[int, Integers]) -> int:
    """The number given; else groups are added as long as all of them are distinct."""
    given = problem.motions
    if given:
        return min(best, key=lambda count: (abs(count - given), count))
    groups = max(1, min(problem.min_motions, max(best)))
    while groups + 1 in best and groups < MOST_MOTIONS:
        labels = best[groups + 1]
        members = [np.flatnonzero(labels == group) for group in range(groups + 1)]
        apart = min(
            saved_by_parting(components, members, (i, j))
            / np.sqrt(len(members[i]) + len(members[j]))
            for i, j in _pairs(groups + 1)
        )
        if apart < DISTINCT:
            break
        groups += 1
    return groups


def _chosen(problem: Problem, members: Flags) -> Chosen:
    """The motion of a group: the lowest rank that explains it, without the group's outliers."""
    vectors = problem.points[members].reshape(int(members.sum()), -1)
    inliers = members.copy()
    if len(vectors) > FEWEST:
        residual = leave_one_out_residuals(vectors)
        inliers[np.flatnonzero(members)[residual > OUTLYING * np.median(residual)]] = False
    fits = [_fit(view, inliers) for view in problem.views]
    least = min(rms for _, rms in fits)
    ranks = [view.hypotheses.points.shape[-1] for view in problem.views]
    index = min(
        (i for i, (_, rms) in enumerate(fits) if rms <= PLANAR * least), key=lambda i: ranks[i]
    )
    point, rms = fits[index]
    return Chosen(index, point, inliers, None, rms)


def _fit(view: View, inliers: Flags) -> tuple[Floats, float]:
    points, sound = view.fit(inliers[None].astype(np.float64))
    if not sound[0]:
        return points[0], np.inf
    return points[0], float(np.sqrt(np.mean(view.residuals(points)[0, inliers] ** 2)))


def _mode_of(problem: Problem, motion: Chosen, taken: set[int]) -> int | None:
    """The mode of the motion's set that is nearest to it on the manifold, if still free."""
    free = [i for i, mode in enumerate(problem.modes) if mode.set == motion.set and i not in taken]
    if not free:
        return None
    manifold = problem.views[motion.set].model.manifold
    gaps = [float(manifold.dist(motion.point[None], problem.modes[i].point[None])[0]) for i in free]
    return free[int(np.argmin(gaps))]


def _pairs(count: int) -> list[tuple[int, int]]:
    return list(combinations(range(count), 2))
