"""From modes to motions over many frames: groups, their number, their outliers, their rank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.geometry.flats import leave_one_out_residuals, principal_components
from mssegment.models import Flags
from mssegment.records import OUTLIER, Floats, Integers
from mssegment.sampling.observed import ObservedSet
from mssegment.sampling.validation import first_test, limit_factor
from mssegment.segmentation.mixture.likelihood import FEWEST, Likelihood
from mssegment.segmentation.mixture.mode_votes import ModeVotes
from mssegment.segmentation.mixture.search import VOTE_WEIGHT, partitions, saved_by_parting, starts
from mssegment.segmentation.selection import SelectedMotion, SelectionProblem, SelectionResult

DISTINCT = 38.0
"""Two groups are two bodies if (cost of the union - cost apart) / sqrt(tracks) is above this."""
OUTLYING = 20.0
"""A track is an outlier if its residual, over its group's median, is above this; more than that
(``limit_factor``) where hardly any tracks are."""
PASSES = 2
"""The groups are sought again where tracks that fit nothing around them were no outliers."""
PLANAR = 1.25
"""A body is planar if rank 3 leaves at most so many times the residual of rank 4."""
MOST_MOTIONS = 8


def mixture(problem: SelectionProblem) -> SelectionResult:
    """The selection for ``factorization`` over many frames: a motion per group of tracks."""
    mode_votes = [ModeVotes.of_set(problem, index) for index in range(len(problem.observed_sets))]
    misfit = np.min([one.misfit for one in mode_votes], axis=0)
    kept = np.flatnonzero(first_test(problem.points, misfit))
    for _ in range(PASSES):
        labels = _joined(problem, _groups(problem, mode_votes, kept))
        relative = _relative_residuals(problem.points, labels)
        outlying = relative > OUTLYING * limit_factor(relative, OUTLYING)
        before, kept = kept, np.flatnonzero(~outlying)
        if np.isin(kept, before).all():
            break
    labels[outlying] = OUTLIER
    taken: set[int] = set()
    motions = []
    for label in range(1, int(labels.max()) + 1):
        motion = _chosen(problem, labels == label)
        mode = _mode_of(problem, motion, taken)
        if mode is not None:
            taken.add(mode)
        motions.append(
            SelectedMotion(motion.set_index, motion.point, motion.inliers, mode, motion.scale)
        )
    return SelectionResult(tuple(motions))


def _groups(problem: SelectionProblem, mode_votes: Sequence[ModeVotes], kept: Integers) -> Integers:
    """Labels 1.. of the tracks ``kept``, the others OUTLIER [P]."""
    # the hypotheses of planes are the purest: most tracks near each other lie in one
    purest = min(range(len(mode_votes)), key=lambda i: problem.observed_sets[i].model.subset_size)
    components = principal_components(problem.points[kept])
    likelihood = Likelihood(components, mode_votes[purest].vote_shares[kept])
    best = partitions(likelihood, starts(problem, mode_votes, kept))
    labels = np.full(len(problem.points), OUTLIER, dtype=np.int64)
    labels[kept] = best[_count(problem, likelihood, best)] + 1
    return labels


def _joined(problem: SelectionProblem, labels: Integers) -> Integers:
    """Tracks without a label join the group whose subspace is nearest, to be tested there.

    Where a body is not rigid, many of its tracks fit nothing around them.
    """
    observed_set = max(
        problem.observed_sets, key=lambda observed_set: observed_set.model.subset_size
    )
    names = np.unique(labels[labels > 0])
    points, _ = observed_set.fit((labels == names[:, None]).astype(np.float64))
    return np.where(labels > 0, labels, names[observed_set.residuals(points).argmin(axis=0)])


def _relative_residuals(points: Floats, labels: Integers) -> Floats:
    """Of each track from the others of its group, over the group's median [P]."""
    relative = np.zeros(len(points))
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        if len(members) > FEWEST:
            residual = leave_one_out_residuals(points[members].reshape(len(members), -1))
            relative[members] = residual / max(float(np.median(residual)), 1e-12)
    return relative


def _count(problem: SelectionProblem, likelihood: Likelihood, best: dict[int, Integers]) -> int:
    """The number given; else groups are added as long as all of them are distinct."""
    given = problem.options.motions
    if given:
        return min(best, key=lambda count: (abs(count - given), count))
    groups = max(1, min(problem.options.min_motions, max(best)))
    while groups + 1 in best and groups < MOST_MOTIONS:
        if distinctness(likelihood, best[groups + 1]) < DISTINCT:
            break
        groups += 1
    return groups


def distinctness(likelihood: Likelihood, labels: Integers) -> float:
    """Of the two groups that are most like one body (nats over the root of their tracks)."""
    sizes = np.bincount(labels)
    pairs, saved = saved_by_parting(likelihood, labels, VOTE_WEIGHT)
    return min(
        float(amount / np.sqrt(sizes[i] + sizes[j]))
        for (i, j), amount in zip(pairs, saved, strict=True)
    )


def _chosen(problem: SelectionProblem, inliers: Flags) -> SelectedMotion:
    """The motion of a group: the lowest rank that explains it."""
    fits = [_fit(observed_set, inliers) for observed_set in problem.observed_sets]
    least = min(rms for _, rms in fits)
    ranks = [observed_set.model.subset_size for observed_set in problem.observed_sets]
    index = min(
        (i for i, (_, rms) in enumerate(fits) if rms <= PLANAR * least), key=lambda i: ranks[i]
    )
    point, rms = fits[index]
    return SelectedMotion(index, point, inliers, None, rms)


def _fit(observed_set: ObservedSet, inliers: Flags) -> tuple[Floats, float]:
    points, valid = observed_set.fit(inliers[None].astype(np.float64))
    if not valid[0]:
        return points[0], np.inf
    return points[0], float(np.sqrt(np.mean(observed_set.residuals(points)[0, inliers] ** 2)))


def _mode_of(problem: SelectionProblem, motion: SelectedMotion, taken: set[int]) -> int | None:
    """The mode of the motion's set that is nearest to it on the manifold, if still free."""
    free = [
        i
        for i, mode in enumerate(problem.modes)
        if mode.set_index == motion.set_index and i not in taken
    ]
    if not free:
        return None
    manifold = problem.observed_sets[motion.set_index].model.manifold
    gaps = [float(manifold.dist(motion.point[None], problem.modes[i].point[None])[0]) for i in free]
    return free[int(np.argmin(gaps))]
