"""From hypotheses to labelled tracks: mean shift on every set, selection, one label per track."""

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
    replace,
)
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.options import SegmentOptions
from mssegment.segmentation.selection import (
    SelectedMotion,
    Selection,
    SelectionProblem,
    SelectionResult,
)
from mssegment.special import chi_square_quantile, median

BANDWIDTH_CONSTANT = 1.0
"""Times the median distance to the (0.05 n)-th nearest hypothesis: the bandwidth ``auto``."""

REFITS = 3
"""Rounds of the final least squares."""
TAIL = 1e-4
"""Share of the true inliers that the final least squares may leave out."""


def segment_by_modes(
    points: Floats,
    sets: Sequence[HypothesisSet],
    *,
    select: Selection,
    status: Integers,
    options: SegmentOptions,
    rng: np.random.Generator,
) -> ClusterResult:
    """Mean shift on every set, modes ranked by kernel density, then ``select``.

    ``points`` [P, F, 2] in pixels; ``status`` [P] is 0 for tracks to label, else the label they
    keep. Raises DataError where the hypotheses do not fit the tracks.
    """
    judged = np.asarray((status == OUTLIER) & np.isfinite(points).all(axis=(1, 2)))
    if not all(len(hypotheses.points) for hypotheses in sets):
        raise DataError("a set holds no hypotheses: run `mssegment hypothesize` again")
    observed_sets = tuple(ObservedSet.of(points[judged], hypotheses) for hypotheses in sets)
    modes, bandwidths, assignments = _find_modes(observed_sets, options, rng)
    problem = SelectionProblem(
        points[judged], observed_sets, modes, options, rng, assignments, np.flatnonzero(judged)
    )
    choice = select(problem)
    return _segmentation(
        points, status, judged, observed_sets, modes, bandwidths, assignments, choice
    )


def _find_modes(
    observed_sets: Sequence[ObservedSet], options: SegmentOptions, rng: np.random.Generator
) -> tuple[tuple[Mode, ...], tuple[float, ...], tuple[Integers, ...]]:
    """Modes of all sets, densest first; bandwidth and assignments (-1: to no mode) per set."""
    modes: list[Mode] = []
    bandwidths, places = [], []
    for index, observed_set in enumerate(observed_sets):
        shifted = MeanShift(
            observed_set.model.manifold,
            options.bandwidth,
            options.kernel,
            bandwidth_constant=BANDWIDTH_CONSTANT,
            threads=options.threads,
        ).fit(observed_set.hypotheses.points, rng=rng)
        bandwidths.append(shifted.bandwidth_)
        places.append(np.where(shifted.labels_ >= 0, shifted.labels_ + len(modes), -1))
        points = _oriented(observed_set, shifted.modes_, shifted.labels_)
        modes += [
            Mode(index, int(count), float(density), point)
            for point, density, count in zip(
                points, shifted.densities_, shifted.counts_, strict=True
            )
        ]
    order = sorted(range(len(modes)), key=lambda i: -modes[i].kde)
    rank = np.full(len(modes) + 1, -1)
    rank[order] = np.arange(len(modes))
    assignments = tuple(rank[place].astype(np.int64) for place in places)
    return tuple(modes[i] for i in order), tuple(bandwidths), assignments


def _oriented(observed_set: ObservedSet, modes: Floats, assignments: Integers) -> Floats:
    """The modes [m, ...] as the motions that most of the hypotheses behind them stand for."""
    choices = observed_set.model.orientations(modes).reshape(-1, *modes.shape)
    if len(choices) == 1:
        return modes
    places = []
    for m in range(len(modes)):
        members = observed_set.hypotheses.points[assignments == m].reshape(-1, modes[m].size)
        away = choices[:, m].reshape(len(choices), 1, -1) - members
        places.append(int((away**2).sum(axis=(1, 2)).argmin()))
    return np.asarray(choices[places, np.arange(len(modes))])


def _segmentation(
    points: Floats,
    status: Integers,
    judged: Flags,
    observed_sets: Sequence[ObservedSet],
    modes: tuple[Mode, ...],
    bandwidths: tuple[float, ...],
    assignments: tuple[Integers, ...],
    choice: SelectionResult,
) -> ClusterResult:
    owner = _owners(choice.motions, _residuals(observed_sets, choice.motions, int(judged.sum())))
    choice = replace(choice, motions=_refitted(observed_sets, choice.motions, owner))
    residuals = _residuals(observed_sets, choice.motions, int(judged.sum()))
    sizes = np.array([(owner == j).sum() for j in range(len(choice.motions))], dtype=np.int64)
    order = [int(j) for j in np.argsort(-sizes, kind="stable") if sizes[j] > 0]
    labels = np.where(status == OUTLIER, NOT_JUDGED, status).astype(np.int64)
    labels[judged] = OUTLIER
    tracks = np.flatnonzero(judged)
    found = []
    for label, j in enumerate(order, start=1):
        inliers = tracks[owner == j]
        labels[inliers] = label
        found.append(
            _motion(label, choice.motions[j], inliers, residuals[j][owner == j], observed_sets)
        )
    everywhere = np.full((len(found), len(points)), np.nan)
    everywhere[:, judged] = residuals[order]
    label_of_mode = _strongest_modes(modes, assignments, observed_sets, labels)
    named = tuple(
        Mode(m.set_index, m.hypotheses, m.kde, m.point, label_of_mode.get(i, 0))
        for i, m in enumerate(modes)
    )
    return ClusterResult(
        labels,
        named,
        tuple(found),
        bandwidths,
        everywhere,
        assignments,
        (
            *choice.notes,
            *models.remarks(
                [observed_sets[motion.set_index].model for motion in found],
                [motion.parameters for motion in found],
            ),
        ),
    )


def _strongest_modes(
    modes: Sequence[Mode],
    assignments: Sequence[Integers],
    observed_sets: Sequence[ObservedSet],
    labels: Integers,
) -> dict[int, int]:
    """The densest mode of each motion in each set of hypotheses, mode -> label.

    A mode belongs to a motion when most tracks of the elemental subsets that converge to it do. The
    candidate that a selection happened to refit may have been a weak neighbour of it.
    """
    lowest = int(labels.min(initial=0))
    owner: dict[int, int] = {}
    told: set[tuple[int, int]] = set()
    for index, mode in enumerate(modes):
        subsets = observed_sets[mode.set_index].hypotheses.subsets[
            assignments[mode.set_index] == index
        ]
        counts = np.bincount(labels[subsets].ravel() - lowest, minlength=1)
        label = int(counts.argmax()) + lowest
        most = 2 * counts.max() > counts.sum()
        if label > 0 and most and (mode.set_index, label) not in told:
            owner[index] = label
            told.add((mode.set_index, label))
    return owner


def _refitted(
    observed_sets: Sequence[ObservedSet], chosen: Sequence[SelectedMotion], owner: Integers
) -> tuple[SelectedMotion, ...]:
    """The final least squares of every motion on the tracks it got.

    A few mismatches among its tracks would pull it, so tracks beyond the noise of the others stay
    out of the fit; unsound fits are not taken.
    """
    points = [motion.point for motion in chosen]
    for index, observed_set in enumerate(observed_sets):
        moving = [j for j, motion in enumerate(chosen) if motion.set_index == index]
        before = np.zeros((len(moving), len(owner)), dtype=bool)
        for _ in range(REFITS):
            if not moving:
                break
            residuals = observed_set.residuals(np.stack([points[j] for j in moving]))
            own = owner == np.array(moving)[:, None]
            kept = own & (residuals <= _noise_limits(residuals, own, observed_set.model)[:, None])
            fitted, valid = observed_set.fit(kept.astype(np.float64))
            on = (
                valid
                & (kept.sum(axis=1) > observed_set.model.subset_size)
                & (kept != before).any(axis=1)
            )
            for place in np.flatnonzero(on).tolist():
                points[moving[place]] = fitted[place]
            moving, before = [moving[k] for k in np.flatnonzero(on)], kept[on]
    return tuple(replace(motion, point=point) for motion, point in zip(chosen, points, strict=True))


def _noise_limits(residuals: Floats, own: Flags, model: MotionModel) -> Floats:
    """What ``TAIL`` of the residuals [m, P] of a normal noise would exceed, pixels [m].

    The noise is that which has the median of those that are a motion's ``own`` [m, P].
    """
    tail, half = (chi_square_quantile(model.residual_dimension, share) for share in (1 - TAIL, 0.5))
    medians = [
        median(row[mine]) if mine.any() else 0.0 for row, mine in zip(residuals, own, strict=True)
    ]
    return np.asarray(np.array(medians) * np.sqrt(tail / half), dtype=np.float64)


def _residuals(
    observed_sets: Sequence[ObservedSet], chosen: Sequence[SelectedMotion], tracks: int
) -> Floats:
    """Residuals in pixels of the judged tracks from the chosen motions, [m, P]."""
    residuals = np.zeros((len(chosen), tracks))
    for index, observed_set in enumerate(observed_sets):
        own = [j for j, motion in enumerate(chosen) if motion.set_index == index]
        if own:
            residuals[own] = observed_set.residuals(np.stack([chosen[j].point for j in own]))
    return residuals


def _owners(chosen: Sequence[SelectedMotion], residuals: Floats) -> Integers:
    """The motion of each judged track, -1 for none; a tie goes to the smaller residual."""
    if not chosen:
        return np.full(residuals.shape[1], -1, dtype=np.int64)
    own = np.where(np.stack([c.inliers for c in chosen]), residuals, np.inf)
    nearest = own.argmin(axis=0)
    return np.where(np.isfinite(own.min(axis=0)), nearest, -1).astype(np.int64)


def _motion(
    label: int,
    chosen: SelectedMotion,
    inliers: Integers,
    residuals: Floats,
    observed_sets: Sequence[ObservedSet],
) -> Motion:
    return Motion(
        label=label,
        set_index=chosen.set_index,
        model=observed_sets[chosen.set_index].model.name,
        parameters=chosen.point,
        inliers=inliers.astype(np.int64),
        scale=chosen.scale,
        rms=float(np.sqrt(np.mean(residuals**2))),
        cost_saved=chosen.cost_saved,
    )
