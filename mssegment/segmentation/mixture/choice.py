"""From modes to motions over many frames: groups, their number, their outliers, their rank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.geometry.flats import leave_one_out_residuals, principal_components
from mssegment.models import Flags
from mssegment.records import OUTLIER, Floats, Integers, replace
from mssegment.sampling.observed import ObservedSet
from mssegment.sampling.validation import first_test, limit_factor
from mssegment.segmentation.mixture.likelihood import MIN_GROUP_SIZE, Likelihood
from mssegment.segmentation.mixture.mode_votes import ModeVotes
from mssegment.segmentation.mixture.search import VOTE_WEIGHT, partitions, split_savings, starts
from mssegment.segmentation.rank_selection import lowest_adequate_rank
from mssegment.segmentation.selection import SelectedMotion, SelectionProblem, SelectionResult

MIN_DISTINCTNESS = 38.0
"""Two groups are distinct if (cost of the union - cost of both) / sqrt(tracks) is at least this."""
OUTLIER_RATIO = 20.0
"""A track is an outlier if its residual exceeds the median of its group by this factor (times
``limit_factor``)."""
MAX_PASSES = 2
"""Groups are computed again if tracks that fitted nothing near them turn out to be inliers."""
MAX_MOTIONS = 8
"""Maximum number of motions, unless their number is given."""


def mixture(problem: SelectionProblem) -> SelectionResult:
    """Select motions over many frames, one for each group of tracks.

    Parameters
    ----------
    problem : SelectionProblem
        The tracks and the modes, of a model with ranks.

    Returns
    -------
    SelectionResult
    """
    mode_votes = [ModeVotes.of_set(problem, index) for index in range(len(problem.observed_sets))]
    misfit = np.min([votes.misfit for votes in mode_votes], axis=0)
    tracks = np.flatnonzero(first_test(problem.points, misfit))
    for _ in range(MAX_PASSES):
        labels = _complete_labels(problem, _groups(problem, mode_votes, tracks))
        relative = _relative_residuals(problem.points, labels)
        outliers = relative > OUTLIER_RATIO * limit_factor(relative, OUTLIER_RATIO)
        before, tracks = tracks, np.flatnonzero(~outliers)
        if np.isin(tracks, before).all():
            break
    labels[outliers] = OUTLIER
    used: set[int] = set()
    motions = []
    for label in range(1, int(labels.max()) + 1):
        motion = _motion(problem, labels == label)
        mode = _nearest_mode(problem, motion, used)
        if mode is not None:
            used.add(mode)
        motions.append(replace(motion, mode=mode))
    return SelectionResult(tuple(motions))


def _groups(
    problem: SelectionProblem, mode_votes: Sequence[ModeVotes], tracks: Integers
) -> Integers:
    """Labels [P]: 1, 2, ... for ``tracks``, OUTLIER for the others."""
    # subsets of the lowest rank are the most reliable: most neighbours lie in a plane
    lowest = min(range(len(mode_votes)), key=lambda i: problem.observed_sets[i].model.subset_size)
    components = principal_components(problem.points[tracks])
    likelihood = Likelihood(components, mode_votes[lowest].vote_shares[tracks])
    best = partitions(likelihood, starts(problem, mode_votes, tracks))
    labels = np.full(len(problem.points), OUTLIER, dtype=np.int64)
    labels[tracks] = best[_count(problem, likelihood, best)] + 1
    return labels


def _complete_labels(problem: SelectionProblem, labels: Integers) -> Integers:
    """Assign tracks without a label to the group with the nearest subspace.

    Outliers are removed later. If an object is not rigid, many of its tracks fit no hypothesis near
    them.
    """
    observed_set = max(
        problem.observed_sets, key=lambda observed_set: observed_set.model.subset_size
    )
    names = np.unique(labels[labels > 0])
    points, _ = observed_set.fit((labels == names[:, None]).astype(np.float64))
    return np.where(labels > 0, labels, names[observed_set.residuals(points).argmin(axis=0)])


def _relative_residuals(points: Floats, labels: Integers) -> Floats:
    """Leave-one-out residual of each track [P], relative to the median of its group."""
    relative = np.zeros(len(points))
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        if len(members) > MIN_GROUP_SIZE:
            residual = leave_one_out_residuals(points[members].reshape(len(members), -1))
            relative[members] = residual / max(float(np.median(residual)), 1e-12)
    return relative


def _count(problem: SelectionProblem, likelihood: Likelihood, best: dict[int, Integers]) -> int:
    """The given number of groups; otherwise groups are added while all of them are distinct."""
    given = problem.options.motions
    if given:
        return min(best, key=lambda count: (abs(count - given), count))
    groups = max(1, min(problem.options.min_motions, max(best)))
    while groups + 1 in best and groups < MAX_MOTIONS:
        if distinctness(likelihood, best[groups + 1]) < MIN_DISTINCTNESS:
            break
        groups += 1
    return groups


def distinctness(likelihood: Likelihood, labels: Integers) -> float:
    """Distinctness of the two most similar groups, in nats over the root of their tracks."""
    sizes = np.bincount(labels)
    pairs, saved = split_savings(likelihood, labels, VOTE_WEIGHT)
    return min(
        float(amount / np.sqrt(sizes[i] + sizes[j]))
        for (i, j), amount in zip(pairs, saved, strict=True)
    )


def _motion(problem: SelectionProblem, inliers: Flags) -> SelectedMotion:
    """The motion of a group: of the lowest rank that explains it."""
    fits = [_fit(observed_set, inliers) for observed_set in problem.observed_sets]
    ranks = [observed_set.model.subset_size for observed_set in problem.observed_sets]
    index = lowest_adequate_rank([rms for _, rms in fits], ranks)
    point, rms = fits[index]
    return SelectedMotion(index, point, inliers, None, rms)


def _fit(observed_set: ObservedSet, inliers: Flags) -> tuple[Floats, float]:
    """The least-squares motion of a group and its rms residual in pixels."""
    points, valid = observed_set.fit(inliers[None].astype(np.float64))
    if not valid[0]:
        return points[0], np.inf
    return points[0], float(np.sqrt(np.mean(observed_set.residuals(points)[0, inliers] ** 2)))


def _nearest_mode(problem: SelectionProblem, motion: SelectedMotion, used: set[int]) -> int | None:
    """The mode of the same set, not ``used``, that is nearest to the motion on the manifold."""
    unused = [
        i
        for i, mode in enumerate(problem.modes)
        if mode.set_index == motion.set_index and i not in used
    ]
    if not unused:
        return None
    manifold = problem.observed_sets[motion.set_index].model.manifold
    distances = [
        float(manifold.dist(motion.point[None], problem.modes[i].point[None])[0]) for i in unused
    ]
    return unused[int(np.argmin(distances))]
