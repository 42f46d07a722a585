"""From hypotheses to labels: mean shift on every set, selection of modes, one label per track."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.meanshift import (
    Clusters,
    ModeSearch,
    find_clusters,
    kernel_named,
    nearest_neighbour_bandwidth,
    thread_pool,
)
from mssegment.preprocessing.noise import reference_noise
from mssegment.records import (
    BACKGROUND,
    NOT_JUDGED,
    OUTLIER,
    ClusterResult,
    Floats,
    HypothesisSet,
    Integers,
    Mode,
    replace,
)
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.final_fit import final_fit, joined_remarks
from mssegment.segmentation.modes import RankedModes, rank_modes
from mssegment.segmentation.options import SegmentOptions
from mssegment.segmentation.selection import Selection, SelectionProblem

BANDWIDTH_CONSTANT = 1.0
"""Ratio of the automatic bandwidth to the median distance of the (0.05 n)-th nearest hypothesis."""


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
        points[tracks],
        observed_sets,
        found.modes,
        options,
        rng,
        found.assignments,
        tracks,
        static_camera=bool((status == BACKGROUND).any()),
        noise=_noise(points[tracks], observed_sets),
    )
    selected = select(problem)
    fit = final_fit(problem, selected)
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
        notes=(*selected.notes, *remarks, *joined_remarks(fit.motions)),
    )


def _noise(points: Floats, observed_sets: Sequence[ObservedSet]) -> float:
    """The noise of two pictures in pixels, NaN for more, or for data that is no picture."""
    of_pictures = all(observed_set.model.of_pictures for observed_set in observed_sets)
    return reference_noise(points) if of_pictures and points.shape[1] == 2 else float("nan")


def _find_modes(
    observed_sets: Sequence[ObservedSet], options: SegmentOptions, rng: np.random.Generator
) -> RankedModes:
    """Mean shift on every set."""
    modes: list[Mode] = []
    bandwidths, assigned = [], []
    for index, observed_set in enumerate(observed_sets):
        bandwidth, found = _cluster(observed_set, options, rng)
        bandwidths.append(bandwidth)
        assigned.append(np.where(found.labels >= 0, found.labels + len(modes), -1))
        points = _oriented(observed_set, found.modes, found.labels)
        modes += [
            Mode(index, int(count), float(density), point)
            for point, density, count in zip(points, found.densities, found.counts, strict=True)
        ]
    return rank_modes(modes, bandwidths, assigned)


def _cluster(
    observed_set: ObservedSet, options: SegmentOptions, rng: np.random.Generator
) -> tuple[float, Clusters]:
    """The bandwidth, which for hypotheses of motions is narrower than ``auto``, and the modes."""
    manifold, points = observed_set.model.manifold, observed_set.hypotheses.points
    if len(points) == 0:
        raise DataError("mean shift needs at least 1 hypothesis, found none")
    manifold.check_point(points)
    bandwidth = options.bandwidth
    if bandwidth == "auto":
        bandwidth = nearest_neighbour_bandwidth(manifold, points, rng, BANDWIDTH_CONSTANT)
    with thread_pool(options.threads) as pool:
        search = ModeSearch(manifold, kernel_named(options.kernel), float(bandwidth), pool=pool)
        return search.bandwidth, find_clusters(search, points, rng)


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
