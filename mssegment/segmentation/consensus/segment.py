"""Consensus as a ``ClusterResult``: every group's motion on its manifold, with its mode.

Each group gets a motion on the set that says most about it: the subspaces over all frames where
they were drawn, else the homographies of the frame pair that sees most of the group. Mean
shift climbs from there to the motion's mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

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
)
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.consensus.clustering import cluster_by_consensus
from mssegment.segmentation.consensus.label_propagation import (
    hypotheses_among,
    propagate_labels,
    tracks_to_group,
)
from mssegment.segmentation.options import SegmentOptions

MODE_NOTE = (
    "consensus: a mode is where mean shift arrives from its motion, its hypotheses are those made "
    "of the motion's tracks alone"
)
MODE_SAMPLE = 300
"""So many hypotheses of a set tell the density; the bandwidth needs half of them."""
TOLERANCE, MOST_STEPS = 1e-2, 200
"""A trajectory ends when its shift is below this many bandwidths, or after this many steps."""
PLANAR = 1.25
"""A motion is planar if rank 3 leaves at most so many times the residual of rank 4."""
REWEIGHTINGS = 5
"""Rounds of the robust fit of a motion to its group."""


def segment_by_consensus(
    points: Floats,
    hypotheses: Hypotheses,
    *,
    status: Integers,
    options: SegmentOptions,
    rng: np.random.Generator,
) -> ClusterResult:
    """Segment the tracks ``points`` [P, F, 2] (pixels, NaN: not visible) by consensus.

    ``status`` [P] is 0 for tracks to label, else the label they keep. Raises DataError where the
    hypotheses were not drawn for consensus, or see too few tracks.
    """
    judged = status == OUTLIER
    labels, notes = _labels(points, hypotheses, judged, options, rng)
    labels = np.where(judged, labels, status).astype(np.int64)
    count = int(labels.max(initial=0))
    observed_sets = [ObservedSet.of(points, entry) for entry in hypotheses.sets]
    results = [
        _of_the_lowest_rank(
            [
                _motion(label, index, observed_sets[index], labels)
                for index in _sets_of(labels == label, observed_sets)
            ],
            observed_sets,
        )
        for label in range(1, count + 1)
    ]
    found_motions = tuple(motion for motion, _ in results)
    modes, bandwidths, assignments = _modes(
        hypotheses.sets, found_motions, labels, options.bandwidth, options.kernel, rng
    )
    residuals = np.full((count, len(points)), np.nan)
    for row, (_, own) in enumerate(results):
        residuals[row] = own
    return ClusterResult(
        labels,
        modes,
        found_motions,
        bandwidths,
        residuals,
        assignments,
        (*notes, MODE_NOTE) if count else notes,
    )


def _labels(
    points: Floats,
    hypotheses: Hypotheses,
    judged: Flags,
    options: SegmentOptions,
    rng: np.random.Generator,
) -> tuple[Integers, tuple[str, ...]]:
    """Labels [P] of the judged tracks: some are grouped, the others join a group; and notes."""
    grouped = tracks_to_group(judged, hypotheses.sets)
    own, among = points[grouped], hypotheses_among(hypotheses, grouped)
    found = cluster_by_consensus(
        own, among, rng, motions=options.motions, min_motions=options.min_motions
    )
    labels = np.full(len(points), OUTLIER)
    labels[grouped] = found.labels
    others = judged & ~grouped
    if others.any():
        labels[others] = propagate_labels(
            own,
            among.sets,
            found.labels,
            found.misfit,
            points[others],
            perspective=among.partition == "normalized_cuts",
        )
    return labels, found.notes


def _of_the_lowest_rank(
    fits: Sequence[tuple[Motion, Floats]], observed_sets: Sequence[ObservedSet]
) -> tuple[Motion, Floats]:
    """The fit of the lowest rank that explains a group nearly as well as the best does."""
    least = min(motion.rms for motion, _ in fits)
    good = [fit for fit in fits if fit[0].rms <= PLANAR * least]
    return min(good, key=lambda fit: observed_sets[fit[0].set_index].model.subset_size)


def _sets_of(members: Flags, observed_sets: Sequence[ObservedSet]) -> list[int]:
    """The sets on which the motion of a group may be stated, those of models that a user knows.

    Whole tracks first, of every rank drawn; then the frame pair that sees the most tracks.
    """
    frames = [entry.hypotheses.frames for entry in observed_sets]
    usable = [i for i, entry in enumerate(observed_sets) if entry.model.name in MODELS]
    best = max(
        usable, key=lambda i: (len(frames[i]), int(members[observed_sets[i].tracks].sum()), -i)
    )
    return [i for i in usable if frames[i] == frames[best] and len(frames[i]) > 2] or [best]


def _motion(
    label: int, index: int, observed_set: ObservedSet, labels: Integers
) -> tuple[Motion, Floats]:
    """The robust fit to a group, and its residuals [P] in pixels, NaN where a track has none."""
    model, normalization = observed_set.model, observed_set.hypotheses.normalization
    own = labels[observed_set.tracks] == label
    observed = observed_set.observed[own]
    weights = np.ones(int(own.sum()))
    for _ in range(REWEIGHTINGS):
        fitted, valid = model.fit(observed, weights[None])
        residual = model.residuals(fitted, observed, normalization)[0]
        finite = np.where(np.isfinite(residual), residual, 1e9)
        weights = geman_mcclure_weights(finite**2, (2 * float(np.median(finite)) + 1e-12) ** 2)
    everywhere = np.full(len(labels), np.nan)
    if valid[0]:
        everywhere[observed_set.tracks] = observed_set.residuals(fitted)[0]
    mine = everywhere[observed_set.tracks[own]]
    rms = float(np.sqrt(np.mean(mine**2))) if np.isfinite(mine).all() and len(mine) else 0.0
    motion = Motion(
        label=label,
        set_index=index,
        model=model.name,
        parameters=fitted[0],
        inliers=np.flatnonzero(labels == label),
        scale=rms,
        rms=rms,
    )
    return motion, everywhere


def _modes(
    sets: Sequence[HypothesisSet],
    motions: Sequence[Motion],
    labels: Integers,
    bandwidth: float | Literal["auto"],
    kernel: str,
    rng: np.random.Generator,
) -> tuple[tuple[Mode, ...], tuple[float, ...], tuple[Integers, ...]]:
    """One mode per motion, densest first; the sets without a motion have bandwidth 0.

    Mean shift starts at the motion itself. Its hypotheses are those that were made of its tracks
    alone; the others are assigned to no mode (-1).
    """
    bandwidths = [0.0] * len(sets)
    places = [np.full(len(entry.points), -1, dtype=np.int64) for entry in sets]
    modes: list[Mode] = []
    for place in sorted({motion.set_index for motion in motions}):
        entry = sets[place]
        own = [motion for motion in motions if motion.set_index == place]
        manifold = manifolds.from_name(entry.manifold)
        sample = entry.points[rng.permutation(len(entry.points))[:MODE_SAMPLE]]
        bandwidths[place] = (
            nearest_neighbour_bandwidth(manifold, sample[: MODE_SAMPLE // 2], rng)
            if bandwidth == "auto"
            else bandwidth
        )
        starts = np.stack([motion.parameters for motion in own])
        reached, densities = climb(manifold, sample, starts, bandwidths[place], kernel)
        made_of = labels[entry.subsets]
        for motion, point, density in zip(own, reached, densities, strict=True):
            alone = (made_of == motion.label).all(axis=1)
            places[place][alone] = len(modes)
            modes.append(Mode(place, int(alone.sum()), float(density), point, motion.label))
    order = sorted(range(len(modes)), key=lambda i: -modes[i].kde)
    rank = np.full(len(modes) + 1, -1)
    rank[order] = np.arange(len(modes))
    return (
        tuple(modes[i] for i in order),
        tuple(bandwidths),
        tuple(rank[place].astype(np.int64) for place in places),
    )


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
