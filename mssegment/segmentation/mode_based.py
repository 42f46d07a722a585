"""From hypotheses to labels: mean shift on every set, selection of modes, one label per track."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.meanshift import MeanShift
from mssegment.models import Flags, MotionModel
from mssegment.records import (
    NOT_JUDGED,
    OUTLIER,
    ClusterResult,
    Floats,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Record,
    replace,
)
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.modes import RankedModes, rank_modes
from mssegment.segmentation.options import SegmentOptions
from mssegment.segmentation.selection import SelectedMotion, Selection, SelectionProblem
from mssegment.special import chi_square_quantile, median

BANDWIDTH_CONSTANT = 1.0
"""Ratio of the automatic bandwidth to the median distance of the (0.05 n)-th nearest hypothesis."""
REFIT_ROUNDS = 3
"""Rounds of the final least squares."""
REFIT_TAIL = 1e-4
"""Share of the true inliers that the final least squares may exclude."""


class _Fit(Record, frozen=True):
    """The final motions, largest first, with ``residuals`` [m, n] and ``labels`` [n] of tracks."""

    motions: tuple[Motion, ...]
    residuals: Floats
    labels: Integers


def segment_by_modes(
    points: Floats,
    sets: Sequence[HypothesisSet],
    *,
    select: Selection,
    status: Integers,
    options: SegmentOptions,
    rng: np.random.Generator,
) -> ClusterResult:
    """Segment tracks by the modes of sets of hypotheses.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    sets : sequence of HypothesisSet
        The hypotheses; mean shift runs on each set.
    select : callable
        Selects motions among the modes.
    status : ndarray [P] of int
        ``OUTLIER`` for tracks to label, otherwise the label that a track keeps.
    options : SegmentOptions
        The settings.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    ClusterResult

    Raises
    ------
    DataError
        If the hypotheses do not fit the tracks.
    """
    eligible = np.asarray((status == OUTLIER) & np.isfinite(points).all(axis=(1, 2)))
    if not all(len(hypotheses.points) for hypotheses in sets):
        raise DataError("a set holds no hypotheses: run `mssegment hypothesize` again")
    tracks = np.flatnonzero(eligible)
    observed_sets = tuple(ObservedSet.of(points[tracks], hypotheses) for hypotheses in sets)
    found = _find_modes(observed_sets, options, rng)
    problem = SelectionProblem(
        points[tracks], observed_sets, found.modes, options, rng, found.assignments, tracks
    )
    selected = select(problem)
    fit = _final_fit(problem, selected.motions)
    labels = np.where(status == OUTLIER, NOT_JUDGED, status).astype(np.int64)
    labels[tracks] = fit.labels
    residuals = np.full((len(fit.motions), len(points)), np.nan)
    residuals[:, tracks] = fit.residuals
    remarks = models.remarks(
        [observed_sets[motion.set_index].model for motion in fit.motions],
        [motion.parameters for motion in fit.motions],
    )
    return ClusterResult(
        labels=labels,
        modes=_named_modes(problem, labels),
        motions=fit.motions,
        bandwidths=found.bandwidths,
        residuals=residuals,
        assignments=found.assignments,
        notes=(*selected.notes, *remarks),
    )


def _find_modes(
    observed_sets: Sequence[ObservedSet], options: SegmentOptions, rng: np.random.Generator
) -> RankedModes:
    """Mean shift on every set."""
    modes: list[Mode] = []
    bandwidths, assigned = [], []
    for index, observed_set in enumerate(observed_sets):
        shifted = MeanShift(
            observed_set.model.manifold,
            options.bandwidth,
            options.kernel,
            bandwidth_constant=BANDWIDTH_CONSTANT,
            threads=options.threads,
        ).fit(observed_set.hypotheses.points, rng=rng)
        bandwidths.append(shifted.bandwidth_)
        assigned.append(np.where(shifted.labels_ >= 0, shifted.labels_ + len(modes), -1))
        points = _oriented(observed_set, shifted.modes_, shifted.labels_)
        modes += [
            Mode(index, int(count), float(density), point)
            for point, density, count in zip(
                points, shifted.densities_, shifted.counts_, strict=True
            )
        ]
    return rank_modes(modes, bandwidths, assigned)


def _oriented(observed_set: ObservedSet, modes: Floats, assignments: Integers) -> Floats:
    """The modes [m, ...] in the orientation of most of the hypotheses assigned to them."""
    choices = observed_set.model.orientations(modes).reshape(-1, *modes.shape)
    if len(choices) == 1:
        return modes
    best = []
    for m in range(len(modes)):
        members = observed_set.hypotheses.points[assignments == m].reshape(-1, modes[m].size)
        difference = choices[:, m].reshape(len(choices), 1, -1) - members
        best.append(int((difference**2).sum(axis=(1, 2)).argmin()))
    return np.asarray(choices[best, np.arange(len(modes))])


def _final_fit(problem: SelectionProblem, selected: Sequence[SelectedMotion]) -> _Fit:
    """Assign each track to one motion, refit the motions, and number them by size."""
    owner = _owners(selected, _residuals(problem, selected))
    refitted = _refit(problem, selected, owner)
    residuals = _residuals(problem, refitted)
    sizes = np.array([(owner == j).sum() for j in range(len(refitted))], dtype=np.int64)
    order = [int(j) for j in np.argsort(-sizes, kind="stable") if sizes[j] > 0]
    labels = np.full(len(owner), OUTLIER, dtype=np.int64)
    motions = []
    for label, j in enumerate(order, start=1):
        inliers = owner == j
        labels[inliers] = label
        motion = refitted[j]
        motions.append(
            Motion(
                label=label,
                set_index=motion.set_index,
                model=problem.observed_sets[motion.set_index].model.name,
                parameters=motion.point,
                inliers=problem.tracks[inliers].astype(np.int64),
                scale=motion.scale,
                rms=float(np.sqrt(np.mean(residuals[j][inliers] ** 2))),
                cost_saved=motion.cost_saved,
            )
        )
    return _Fit(tuple(motions), residuals[order], labels)


def _named_modes(problem: SelectionProblem, labels: Integers) -> tuple[Mode, ...]:
    """The modes with the motion of each: the densest mode of every motion in each set.

    A mode belongs to a motion if most tracks in the elemental subsets that converge to it do. (The
    mode that a selection refitted may be a weak one next to it.) ``labels`` are those of all
    tracks.
    """
    lowest = int(labels.min(initial=0))
    named: set[tuple[int, int]] = set()
    modes = []
    for index, mode in enumerate(problem.modes):
        members = problem.assignments[mode.set_index] == index
        subsets = problem.observed_sets[mode.set_index].hypotheses.subsets[members]
        counts = np.bincount(labels[subsets].ravel() - lowest, minlength=1)
        label = int(counts.argmax()) + lowest
        majority = 2 * counts.max() > counts.sum()
        if label > 0 and majority and (mode.set_index, label) not in named:
            named.add((mode.set_index, label))
            modes.append(replace(mode, motion=label))
        else:
            modes.append(mode)
    return tuple(modes)


def _refit(
    problem: SelectionProblem, selected: Sequence[SelectedMotion], owner: Integers
) -> tuple[SelectedMotion, ...]:
    """Final least squares of each motion to its tracks.

    Tracks with residuals beyond the noise of the others are excluded, because a few mismatches
    would bias the fit. Invalid fits are rejected.
    """
    points = [motion.point for motion in selected]
    for index, observed_set in enumerate(problem.observed_sets):
        active = [j for j, motion in enumerate(selected) if motion.set_index == index]
        before = np.zeros((len(active), len(owner)), dtype=bool)
        for _ in range(REFIT_ROUNDS):
            if not active:
                break
            residuals = observed_set.residuals(np.stack([points[j] for j in active]))
            members = owner == np.array(active)[:, None]
            limits = _noise_limits(residuals, members, observed_set.model)
            inliers = members & (residuals <= limits[:, None])
            fitted, valid = observed_set.fit(inliers.astype(np.float64))
            accepted = (
                valid
                & (inliers.sum(axis=1) > observed_set.model.subset_size)
                & (inliers != before).any(axis=1)
            )
            for row in np.flatnonzero(accepted).tolist():
                points[active[row]] = fitted[row]
            active = [active[row] for row in np.flatnonzero(accepted)]
            before = inliers[accepted]
    return tuple(
        replace(motion, point=point) for motion, point in zip(selected, points, strict=True)
    )


def _noise_limits(residuals: Floats, members: Flags, model: MotionModel) -> Floats:
    """Residuals in pixels [m] that a share ``REFIT_TAIL`` of normal noise exceeds.

    The noise of each motion is estimated by the median of ``residuals`` [m, P] of its ``members``
    [m, P].
    """
    tail, half = (
        chi_square_quantile(model.residual_dimension, share) for share in (1 - REFIT_TAIL, 0.5)
    )
    medians = [
        median(row[own]) if own.any() else 0.0 for row, own in zip(residuals, members, strict=True)
    ]
    return np.asarray(np.array(medians) * np.sqrt(tail / half), dtype=np.float64)


def _residuals(problem: SelectionProblem, selected: Sequence[SelectedMotion]) -> Floats:
    """Residuals [m, n] in pixels of the tracks of the problem from the selected motions."""
    residuals = np.zeros((len(selected), len(problem.points)))
    for index, observed_set in enumerate(problem.observed_sets):
        rows = [j for j, motion in enumerate(selected) if motion.set_index == index]
        if rows:
            residuals[rows] = observed_set.residuals(np.stack([selected[j].point for j in rows]))
    return residuals


def _owners(selected: Sequence[SelectedMotion], residuals: Floats) -> Integers:
    """Index of the motion of each track, -1 for none; the nearest of several."""
    if not selected:
        return np.full(residuals.shape[1], -1, dtype=np.int64)
    distance = np.where(np.stack([motion.inliers for motion in selected]), residuals, np.inf)
    nearest = distance.argmin(axis=0)
    return np.where(np.isfinite(distance.min(axis=0)), nearest, -1).astype(np.int64)
