"""The paper's selection: the first m modes are motions where they clearly dominate the next one.

What dominates is the mass of a mode, its kernel density times the hypotheses that converge to it
(the two columns of the paper's tables). Modes are looked at from the heaviest; one that fits the
same tracks as a heavier one is the same motion, one that loses its tracks to the others is none.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.dominant_modes.inliers import SPARE, Fitted, fit_within, inlier_limit
from mssegment.segmentation.dominant_modes.refit import compete
from mssegment.segmentation.selection import SelectedMotion, SelectionProblem, SelectionResult

CANDIDATES = 60
"""Modes looked at, heaviest first."""
SAME = 2.0
"""Two motions are the same where the inliers of one have residuals from the other that are less
than so many times as large."""

HEAVY = 0.02
"""Modes with this share of the heaviest one's mass say what the noise is."""
SLACK = 1.5
"""The inliers of the chosen motions end, at the latest, so many times as far as those of all modes:
bodies without a motion of their own must not widen the noise of the others."""
MIXTURE = 3.0
"""A motion with residuals so many times the noise was fitted to two bodies at once."""


class _Candidate(Record, frozen=True):
    """A mode with its own motion, and the mass by which it dominates."""

    mode: int
    mass: float
    fitted: Fitted


def dominance(problem: SelectionProblem) -> SelectionResult:
    """The heaviest modes before the largest gap (or as many as given), with their inliers.

    Works on the set of the heaviest mode alone where there are several sets: kernel densities on
    different manifolds cannot be compared.
    """
    if not problem.modes:
        return SelectionResult((), ("there is no mode",))
    index = max(problem.modes, key=lambda mode: mode.kde * mode.hypotheses).set_index
    observed_set = problem.observed_sets[index]
    candidates, cut = _candidates(problem, index)
    found = _distinct(observed_set, candidates, problem.options.motions)
    masses = np.array([candidate.mass for candidate in found])
    count, notes = problem.options.motions, []
    if count is None:
        count = max(largest_gap(masses, _lone(observed_set)), problem.options.min_motions)
        notes += _warnings(masses, count)
    if count > len(found):
        notes.append(f"{count} motions were wanted, but only {len(found)} modes stand for one")
    chosen = found[:count]
    if not chosen:
        return SelectionResult((), tuple(notes))
    points, inliers, residuals = compete(
        observed_set, np.stack([c.fitted.point for c in chosen]), SLACK * cut
    )
    return SelectionResult(
        tuple(
            SelectedMotion(
                index, points[j], inliers[j], c.mode, _scale(observed_set, residuals[j][inliers[j]])
            )
            for j, c in enumerate(chosen)
        ),
        tuple(notes),
    )


def largest_gap(masses: Floats, lone: float) -> int:
    """How many of the ``masses``, in descending order, come before the largest ratio of two.

    After the last comes ``lone``, the mass of a mode of a single hypothesis; nothing counts less.
    """
    if len(masses) == 0:
        return 0
    ladder = np.maximum([*masses, lone], lone)
    return int(np.argmax(ladder[:-1] / ladder[1:])) + 1


def _lone(observed_set: ObservedSet) -> float:
    return 1.0 / len(observed_set.hypotheses.points)


def _candidates(problem: SelectionProblem, index: int) -> tuple[list[_Candidate], float]:
    """The heaviest modes of one set whose motion keeps its inliers; where inliers end (pixels)."""
    observed_set = problem.observed_sets[index]
    modes = [i for i, mode in enumerate(problem.modes) if mode.set_index == index]
    modes.sort(key=lambda i: -problem.modes[i].kde * problem.modes[i].hypotheses)
    found = []
    modes = modes[:CANDIDATES]
    masses = np.array([problem.modes[i].kde * problem.modes[i].hypotheses for i in modes])
    heavy = [i for i, mass in zip(modes, masses, strict=True) if mass >= HEAVY * masses[0]]
    nearest = observed_set.residuals(np.stack([problem.modes[i].point for i in heavy])).min(axis=0)
    cut = inlier_limit(nearest, observed_set.model)
    for i in modes:
        mode = problem.modes[i]
        fitted = fit_within(observed_set, mode.point, cut)
        if fitted is not None:
            found.append(_Candidate(i, mode.kde * mode.hypotheses, fitted))
    return found, cut


def _distinct(
    observed_set: ObservedSet, candidates: list[_Candidate], wanted: int | None
) -> list[_Candidate]:
    """Candidates that stand for motions of their own, at most ``wanted``."""
    least = observed_set.model.subset_size + SPARE
    kept: list[_Candidate] = []
    noise = _noise(candidates) if candidates else 0.0
    for candidate in candidates:
        if _median(candidate.fitted) > MIXTURE * noise:
            continue
        if any(_is_same(candidate.fitted, other.fitted, noise) for other in kept):
            continue
        # of its inliers those count that no heavier motion is nearer to
        others = [other.fitted.residuals for other in kept]
        nearer = np.all([candidate.fitted.residuals < row for row in others], axis=0)
        if (candidate.fitted.inliers & nearer).sum() < least:
            continue
        kept.append(candidate)
        if wanted is not None and len(kept) == wanted:
            break
    return kept


def _is_same(a: Fitted, b: Fitted, noise: float) -> bool:
    """Whether either motion explains the other's inliers almost as well as their own does.

    A motion cannot be better than the ``noise``: it fits a handful of tracks by chance.
    """
    return any(
        np.median(other.residuals[one.inliers]) <= SAME * max(_median(one), noise)
        for one, other in ((a, b), (b, a))
    )


def _median(fitted: Fitted) -> float:
    return float(np.median(fitted.residuals[fitted.inliers]))


def _noise(candidates: list[_Candidate]) -> float:
    """The residual (pixels) that tracks have from their motion: the median over the modes' mass."""
    medians = np.array([_median(c.fitted) for c in candidates])
    order = np.argsort(medians)
    mass = np.cumsum(np.array([c.mass for c in candidates])[order])
    return float(medians[order][np.searchsorted(mass, mass[-1] / 2)])


def _scale(observed_set: ObservedSet, residuals: Floats) -> float:
    """Standard deviation (pixels) of a residual's coordinate."""
    if len(residuals) == 0:
        return 0.0
    mean_square = float(np.mean(residuals**2))
    return float(
        np.sqrt(
            mean_square * observed_set.model.residual_terms / observed_set.model.residual_dimension
        )
    )


def _warnings(masses: Floats, count: int) -> list[str]:
    """Says so where no mode clearly dominates the next one."""
    if 0 < count < len(masses) and masses[count - 1] < 2.0 * masses[count]:
        ratio = masses[count - 1] / masses[count]
        return [
            f"mode {count} outweighs mode {count + 1} only {ratio:.1f} times: the number of "
            "motions is a guess; give it, or choose selection mdl"
        ]
    return []
