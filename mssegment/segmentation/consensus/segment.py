"""Consensus as a ``ClusterResult``: the motion of every group on its manifold, and its mode.

The motion of a group is estimated on the most informative set: the subspaces over all frames if
there are any, otherwise the homographies of the frame pair in which most of the group is visible.
Mean shift started at the motion finds its mode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment import manifolds
from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.manifolds import Manifold
from mssegment.meanshift import ascend, kernel_named, nearest_neighbour_bandwidth
from mssegment.models import MODELS, Flags
from mssegment.records import (
    OUTLIER,
    ClusterResult,
    Floats,
    Hypotheses,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    replace,
)
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.consensus.clustering import Consensus, cluster_by_consensus
from mssegment.segmentation.consensus.label_propagation import (
    hypotheses_among,
    propagate_labels,
    tracks_to_group,
)
from mssegment.segmentation.consensus.readmission import readmitted
from mssegment.segmentation.modes import RankedModes, rank_modes
from mssegment.segmentation.options import SegmentOptions
from mssegment.segmentation.rank_selection import lowest_adequate_rank

MODE_NOTE = (
    "Long sequence: each mode is found by starting mean shift at its motion; its hypotheses are "
    "those drawn from the tracks of that motion"
)
DENSITY_SAMPLE = 300
"""Hypotheses of a set from which the density is estimated; the bandwidth is from half of them."""
TOLERANCE, MOST_STEPS = 1e-2, 200
"""Mean shift ends when the step is below this many bandwidths, or after this many steps."""
ROBUST_FIT_ROUNDS = 5
"""Rounds of the robust fit of a motion to its group."""


def segment_by_consensus(
    points: Floats,
    hypotheses: Hypotheses,
    *,
    status: Integers,
    options: SegmentOptions,
    rng: np.random.Generator,
    with_modes: bool = True,
    moved_before: Flags | None = None,
) -> ClusterResult:
    """Segment tracks by consensus.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    hypotheses : Hypotheses
        Hypotheses drawn for consensus.
    status : ndarray [P] of int
        ``OUTLIER`` for tracks to label, otherwise the label that a track keeps.
    options : SegmentOptions
        The settings.
    rng : numpy.random.Generator
        Source of random numbers.
    with_modes : bool
        Whether to look for the mode of each motion, on which its labels do not depend.
    moved_before : ndarray [P] of bool, optional
        Tracks that moved with a motion in the frames before. A motion that goes on is not tested.

    Returns
    -------
    ClusterResult

    Raises
    ------
    DataError
        If the hypotheses were not drawn for consensus, or apply to too few tracks.
    """
    eligible = status == OUTLIER
    labels, found = _labels(points, hypotheses, eligible, options, rng, moved_before)
    significance = dict(enumerate(found.log_nfa, start=1))
    separations = dict(enumerate(found.separations, start=1))
    labels = np.where(eligible, labels, status).astype(np.int64)
    count = int(labels.max(initial=0))
    observed_sets = [ObservedSet.of(points, one) for one in hypotheses.sets]
    motions: list[Motion] = []
    residuals = np.full((count, len(points)), np.nan)
    for label in range(1, count + 1):
        motion, residuals[label - 1] = _motion(label, observed_sets, labels)
        found_too = {"log_nfa": significance.get(label), "separation": separations.get(label)}
        motions.append(replace(motion, **found_too))
    if not with_modes:
        return ClusterResult(
            labels=labels,
            modes=(),
            motions=tuple(motions),
            bandwidths=(),
            residuals=residuals,
            notes=found.notes,
        )
    ranked = _modes(hypotheses.sets, motions, labels, options, rng)
    return ClusterResult(
        labels=labels,
        modes=ranked.modes,
        motions=tuple(motions),
        bandwidths=ranked.bandwidths,
        residuals=residuals,
        assignments=ranked.assignments,
        notes=(*found.notes, MODE_NOTE) if count else found.notes,
    )


def _labels(
    points: Floats,
    hypotheses: Hypotheses,
    eligible: Flags,
    options: SegmentOptions,
    rng: np.random.Generator,
    moved_before: Flags | None,
) -> tuple[Integers, Consensus]:
    """Labels [P] of the eligible tracks, by grouping or propagation; and the groups."""
    rejected = np.zeros(0, dtype=np.int64)
    if hypotheses.log_nfa is not None:
        rejected = np.flatnonzero(eligible & (hypotheses.log_nfa >= 0))
        eligible = eligible & ~(hypotheses.log_nfa >= 0)
    grouped = tracks_to_group(eligible, hypotheses.sets)
    among = hypotheses_among(hypotheses, grouped)
    found = cluster_by_consensus(
        points[grouped],
        among,
        rng,
        motions=options.motions,
        min_motions=options.min_motions,
        moved_before=None if moved_before is None else moved_before[grouped],
    )
    labels = np.full(len(points), OUTLIER)
    labels[grouped] = found.labels
    others = eligible & ~grouped
    if others.any():
        labels[others] = propagate_labels(points[others], points[grouped], found, among)
    if hypotheses.partition == "joinedness":
        pairs = sorted({(one.frames[0], one.frames[1]) for one in hypotheses.sets})
        labels[rejected] = readmitted(points, labels, rejected, pairs, rng)
    return labels, found


def _motion(
    label: int, observed_sets: Sequence[ObservedSet], labels: Integers
) -> tuple[Motion, Floats]:
    """The motion of a group, and its residuals [P] in pixels, NaN for tracks that have none."""
    indices = _usable_sets(labels == label, observed_sets)
    fits = [_robust_fit(label, index, observed_sets[index], labels) for index in indices]
    ranks = [observed_sets[index].model.subset_size for index in indices]
    return fits[lowest_adequate_rank([motion.rms for motion, _ in fits], ranks)]


def _usable_sets(members: Flags, observed_sets: Sequence[ObservedSet]) -> list[int]:
    """Indices of the sets on which the motion of a group may be estimated.

    These are sets of models that a user may choose: those over all frames, of every rank, or that
    of the frame pair in which most members are visible.
    """
    frames = [observed_set.hypotheses.frames for observed_set in observed_sets]
    usable = [i for i, one in enumerate(observed_sets) if one.model.name in MODELS]
    best = max(
        usable, key=lambda i: (len(frames[i]), int(members[observed_sets[i].tracks].sum()), -i)
    )
    return [i for i in usable if frames[i] == frames[best] and len(frames[i]) > 2] or [best]


def _robust_fit(
    label: int, index: int, observed_set: ObservedSet, labels: Integers
) -> tuple[Motion, Floats]:
    """The motion of a group on one set, and its residuals [P] in pixels, NaN for other tracks."""
    model, normalization = observed_set.model, observed_set.hypotheses.normalization
    members = labels[observed_set.tracks] == label
    observed = observed_set.observed[members]
    weights = np.ones(int(members.sum()))
    for _ in range(ROBUST_FIT_ROUNDS):
        fitted, valid = model.fit(observed, weights[None])
        residual = model.residuals(fitted, observed, normalization)[0]
        finite = np.where(np.isfinite(residual), residual, 1e9)
        weights = geman_mcclure_weights(finite**2, (2 * float(np.median(finite)) + 1e-12) ** 2)
    residuals = np.full(len(labels), np.nan)
    if valid[0]:
        residuals[observed_set.tracks] = observed_set.residuals(fitted)[0]
    of_members = residuals[observed_set.tracks[members]]
    usable = len(of_members) and np.isfinite(of_members).all()
    rms = float(np.sqrt(np.mean(of_members**2))) if usable else 0.0
    motion = Motion(
        label=label,
        set_index=index,
        model=model.name,
        parameters=fitted[0],
        inliers=np.flatnonzero(labels == label),
        scale=rms,
        rms=rms,
    )
    return motion, residuals


def _modes(
    sets: Sequence[HypothesisSet],
    motions: Sequence[Motion],
    labels: Integers,
    options: SegmentOptions,
    rng: np.random.Generator,
) -> RankedModes:
    """The mode of each motion, by mean shift started there; sets without a motion have bandwidth 0.

    The hypotheses of a mode are those whose elemental subset is from the tracks of its motion; the
    others are assigned to no mode.
    """
    bandwidths = [0.0] * len(sets)
    assigned = [np.full(len(hypotheses.points), -1, dtype=np.int64) for hypotheses in sets]
    modes: list[Mode] = []
    for index in sorted({motion.set_index for motion in motions}):
        hypotheses = sets[index]
        of_set = [motion for motion in motions if motion.set_index == index]
        if not len(hypotheses.points):  # exact tracks of a lower rank: every subset is degenerate
            modes += [Mode(index, 0, 0.0, m.parameters, m.label) for m in of_set]
            continue
        manifold = manifolds.from_name(hypotheses.manifold)
        sample = hypotheses.points[rng.permutation(len(hypotheses.points))[:DENSITY_SAMPLE]]
        bandwidths[index] = (
            nearest_neighbour_bandwidth(manifold, sample[: DENSITY_SAMPLE // 2], rng)
            if options.bandwidth == "auto"
            else options.bandwidth
        )
        starts = np.stack([motion.parameters for motion in of_set])
        reached, densities = climb(manifold, sample, starts, bandwidths[index], options.kernel)
        of_subset = labels[hypotheses.subsets]
        for motion, point, density in zip(of_set, reached, densities, strict=True):
            members = (of_subset == motion.label).all(axis=1)
            assigned[index][members] = len(modes)
            modes.append(Mode(index, int(members.sum()), float(density), point, motion.label))
    return rank_modes(modes, bandwidths, assigned)


def climb(
    manifold: Manifold, points: Floats, starts: Floats, bandwidth: float, kernel: str
) -> tuple[Floats, Floats]:
    """The modes that mean shift (10) reaches from ``starts`` [m, ...], and their densities (7)."""
    found = ascend(
        manifold.prepare(points, bandwidth),
        kernel_named(kernel),
        starts,
        tolerance=TOLERANCE,
        max_iterations=MOST_STEPS,
        accelerated=False,
    )
    return found.x, found.density
