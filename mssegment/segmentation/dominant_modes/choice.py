"""Selection of the paper: the first m modes are motions if they clearly dominate the next one.

The modes are ordered by mass: kernel density times number of converging hypotheses (the two columns
of the paper's tables). A mode that fits the same tracks as a heavier one is the same motion; one
that loses its tracks to the others is not a motion.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.dominant_modes.inliers import (
    EXTRA_INLIERS,
    Fitted,
    fit_within,
    inlier_limit,
)
from mssegment.segmentation.dominant_modes.refit import compete
from mssegment.segmentation.selection import SelectedMotion, SelectionProblem, SelectionResult

MAX_CANDIDATES = 60
"""Modes that are considered, heaviest first."""
SAME_MOTION_RATIO = 2.0
"""Two motions are the same if the inliers of one have residuals from the other that are less
than this times as large."""

NOISE_MASS_SHARE = 0.02
"""Modes with at least this share of the largest mass are used to estimate the noise."""
INLIER_SLACK = 1.5
"""Upper bound of the inlier limit of the selected motions, relative to that of all modes: objects
without a mode must not increase the noise of the others."""
MIXED_MOTION_RATIO = 3.0
"""A motion with residuals this many times the noise was fitted to two objects at once."""


class _Candidate(Record, frozen=True):
    """A mode, its mass, and the motion fitted to its inliers."""

    mode: int
    mass: float
    fitted: Fitted


def dominance(problem: SelectionProblem) -> SelectionResult:
    """Select the heaviest modes before the largest gap, or a given number of them.

    With several sets of hypotheses only that of the heaviest mode is used, because kernel densities
    on different manifolds are not comparable.

    Parameters
    ----------
    problem : SelectionProblem
        The tracks and the modes.

    Returns
    -------
    SelectionResult
    """
    if not problem.modes:
        return SelectionResult((), ("no mode was found",))
    index = max(problem.modes, key=lambda mode: mode.kde * mode.hypotheses).set_index
    observed_set = problem.observed_sets[index]
    candidates, limit = _candidates(problem, index)
    found = _distinct(observed_set, candidates, problem.options.motions)
    count, notes = _count(problem, observed_set, found)
    chosen = found[:count]
    if not chosen:
        return SelectionResult((), tuple(notes))
    points, inliers, residuals = compete(
        observed_set, np.stack([c.fitted.point for c in chosen]), INLIER_SLACK * limit
    )
    motions = []
    for j, candidate in enumerate(chosen):
        scale = _scale(observed_set, residuals[j][inliers[j]])
        motions.append(SelectedMotion(index, points[j], inliers[j], candidate.mode, scale))
    return SelectionResult(tuple(motions), tuple(notes))


def _count(
    problem: SelectionProblem, observed_set: ObservedSet, found: list[_Candidate]
) -> tuple[int, list[str]]:
    """The number of motions, given or before the largest gap, and notes about it."""
    masses = np.array([candidate.mass for candidate in found])
    count, notes = problem.options.motions, []
    if count is None:
        single = 1.0 / len(observed_set.hypotheses.points)
        count = max(largest_gap(masses, single), problem.options.min_motions)
        notes += _warnings(masses, count)
    if count > len(found):
        notes.append(f"{count} motions requested, but only {len(found)} modes are motions")
    return count, notes


def largest_gap(masses: Floats, single: float) -> int:
    """Number of masses before the largest ratio of two consecutive ones.

    Parameters
    ----------
    masses : ndarray
        Masses of the modes in descending order.
    single : float
        Mass of a mode of a single hypothesis, which follows the last one; smaller masses are raised
        to it.

    Examples
    --------
    >>> import numpy as np
    >>> largest_gap(np.array([9.0, 8.0, 7.0, 0.3]), single=0.1)
    3
    """
    if len(masses) == 0:
        return 0
    bounded = np.maximum([*masses, single], single)
    return int(np.argmax(bounded[:-1] / bounded[1:])) + 1


def _candidates(problem: SelectionProblem, index: int) -> tuple[list[_Candidate], float]:
    """The heaviest modes of a set whose motion keeps its inliers; the inlier limit in pixels."""
    observed_set = problem.observed_sets[index]
    masses = {
        i: mode.kde * mode.hypotheses
        for i, mode in enumerate(problem.modes)
        if mode.set_index == index
    }
    modes = sorted(masses, key=lambda i: -masses[i])[:MAX_CANDIDATES]
    heavy = [i for i in modes if masses[i] >= NOISE_MASS_SHARE * masses[modes[0]]]
    nearest = observed_set.residuals(np.stack([problem.modes[i].point for i in heavy])).min(axis=0)
    limit = inlier_limit(nearest, observed_set.model)
    found = []
    for i in modes:
        fitted = fit_within(observed_set, problem.modes[i].point, limit)
        if fitted is not None:
            found.append(_Candidate(i, masses[i], fitted))
    return found, limit


def _distinct(
    observed_set: ObservedSet, candidates: list[_Candidate], most: int | None
) -> list[_Candidate]:
    """Candidates that are distinct motions, at most ``most``."""
    least = observed_set.model.subset_size + EXTRA_INLIERS
    kept: list[_Candidate] = []
    noise = _noise(candidates) if candidates else 0.0
    for candidate in candidates:
        if _median(candidate.fitted) > MIXED_MOTION_RATIO * noise:
            continue
        if any(_is_same(candidate.fitted, other.fitted, noise) for other in kept):
            continue
        # count only inliers that are not nearer to a heavier motion
        others = [other.fitted.residuals for other in kept]
        nearer = np.all([candidate.fitted.residuals < row for row in others], axis=0)
        if (candidate.fitted.inliers & nearer).sum() < least:
            continue
        kept.append(candidate)
        if most is not None and len(kept) == most:
            break
    return kept


def _is_same(a: Fitted, b: Fitted, noise: float) -> bool:
    """Whether either motion explains the inliers of the other almost as well.

    A motion cannot be better than the ``noise``, because it fits a few tracks by chance.
    """
    return any(
        np.median(other.residuals[one.inliers]) <= SAME_MOTION_RATIO * max(_median(one), noise)
        for one, other in ((a, b), (b, a))
    )


def _median(fitted: Fitted) -> float:
    """Median residual of the inliers, in pixels."""
    return float(np.median(fitted.residuals[fitted.inliers]))


def _noise(candidates: list[_Candidate]) -> float:
    """Typical residual of inliers, in pixels: the median over the mass of the candidates."""
    medians = np.array([_median(c.fitted) for c in candidates])
    order = np.argsort(medians)
    mass = np.cumsum(np.array([c.mass for c in candidates])[order])
    return float(medians[order][np.searchsorted(mass, mass[-1] / 2)])


def _scale(observed_set: ObservedSet, residuals: Floats) -> float:
    """Standard deviation of a coordinate of the residual vector, in pixels."""
    if len(residuals) == 0:
        return 0.0
    model, mean_square = observed_set.model, float(np.mean(residuals**2))
    return float(np.sqrt(mean_square * model.residual_terms / model.residual_dimension))


def _warnings(masses: Floats, count: int) -> list[str]:
    """A note if the last selected mode does not clearly dominate the next one."""
    if 0 < count < len(masses) and masses[count - 1] < 2.0 * masses[count]:
        ratio = masses[count - 1] / masses[count]
        return [
            f"mode {count} has only {ratio:.1f} times the mass of mode {count + 1}: the number of "
            "motions is uncertain; set segment.motions, or set segment.selection to mdl"
        ]
    return []
