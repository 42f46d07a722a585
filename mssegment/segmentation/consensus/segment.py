"""Consensus as a ``Segmentation``: every group's motion on its manifold, with its mode.

Each group gets a motion on the set that says most about it: the subspaces over all frames where
they were drawn, else the homographies of the frame pair that sees most of the group. Mean
shift climbs from there to the motion's mode.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mssegment import manifolds, models
from mssegment.manifolds import Manifold
from mssegment.meanshift import ascend, kernel_named, nearest_neighbour_bandwidth
from mssegment.models import MotionModel
from mssegment.records import (
    OUTLIER,
    Floats,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Segmentation,
)
from mssegment.sampling.observed import observe
from mssegment.segmentation.consensus.clustering import cluster_by_consensus
from mssegment.segmentation.consensus.label_propagation import (
    propagate_labels,
    sets_among,
    tracks_to_group,
)

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
    sets: Sequence[HypothesisSet],
    *,
    status: Integers,
    bandwidth: float | Literal["auto"] = "auto",
    kernel: str = "gaussian",
    motions: int | None = None,
    min_motions: int = 1,
    rng: np.random.Generator,
) -> Segmentation:
    """Segments the tracks ``points`` [P, F, 2] (pixels, NaN where not seen) by consensus.

    ``status`` [P] is 0 for tracks to label, else the label they keep. Raises DataError where the
    sets are not those of ``draw_consensus_sets``, or see too few tracks.
    """
    judged = status == OUTLIER
    labels, notes = _labels(points, sets, judged, motions, min_motions, rng)
    labels = np.where(judged, labels, status).astype(np.int64)
    count = int(labels.max(initial=0))
    seen = [_seen(points, entry) for entry in sets]
    results = [
        _of_the_lowest_rank(
            [
                _motion(label, place, points, sets[place], labels)
                for place in _sets_of(labels == label, sets, seen)
            ]
        )
        for label in range(1, count + 1)
    ]
    found_motions = tuple(motion for motion, _ in results)
    modes, bandwidths, assignments = _modes(sets, found_motions, labels, bandwidth, kernel, rng)
    residuals = np.full((count, len(points)), np.nan)
    for row, (_, own) in enumerate(results):
        residuals[row] = own
    return Segmentation(
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
    sets: Sequence[HypothesisSet],
    judged: np.ndarray[tuple[int], np.dtype[np.bool_]],
    motions: int | None,
    min_motions: int,
    rng: np.random.Generator,
) -> tuple[Integers, tuple[str, ...]]:
    """Labels [P] of the judged tracks, some grouped and the others joined, and notes."""
    grouped = tracks_to_group(judged, sets)
    own, among = points[grouped], sets_among(sets, grouped)
    found = cluster_by_consensus(own, among, rng, motions=motions, min_motions=min_motions)
    labels = np.full(len(points), OUTLIER)
    labels[grouped] = found.labels
    others = judged & ~grouped
    if others.any():
        labels[others] = propagate_labels(own, among, found.labels, found.misfit, points[others])
    return labels, found.notes


def _seen(points: Floats, entry: HypothesisSet) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.asarray(np.isfinite(points[:, list(entry.frames)]).all(axis=(1, 2)))


def _of_the_lowest_rank(fits: Sequence[tuple[Motion, Floats]]) -> tuple[Motion, Floats]:
    """The fit of the lowest rank that explains a group nearly as well as the best does."""
    least = min(motion.rms for motion, _ in fits)
    valid = [fit for fit in fits if fit[0].rms <= PLANAR * least]
    return min(valid, key=lambda fit: fit[0].parameters.shape[-1])


def _sets_of(
    members: np.ndarray[tuple[int], np.dtype[np.bool_]],
    sets: Sequence[HypothesisSet],
    seen: Sequence[np.ndarray[tuple[int], np.dtype[np.bool_]]],
) -> list[int]:
    """The sets on which a group's motion may be reported.

    Whole tracks first, of every rank drawn; then the frame pair that sees the most tracks.
    """
    usable = [i for i, entry in enumerate(sets) if entry.model in models.MODELS]
    usable = usable or list(range(len(sets)))
    best = max(usable, key=lambda i: (len(sets[i].frames), int((members & seen[i]).sum()), -i))
    return [
        i for i in usable if sets[i].frames == sets[best].frames and len(sets[i].frames) > 2
    ] or [best]


def _model_of(entry: HypothesisSet) -> MotionModel:
    """The motion model in which a group is reported; patches between two views are affine."""
    name = entry.model if entry.model in models.MODELS else "affine"
    return models.make(name, frames=len(entry.frames), rank=entry.points.shape[-1])


def _motion(
    label: int, place: int, points: Floats, entry: HypothesisSet, labels: Integers
) -> tuple[Motion, Floats]:
    """The robust fit to a group, and its residuals [P] in pixels, NaN where a track has none."""
    model = _model_of(entry)
    tracks, observed = observe(points, entry)
    own = labels[tracks] == label
    weights = np.ones(int(own.sum()))
    for _ in range(REWEIGHTINGS):
        fitted, valid = model.fit(observed[own], weights[None])
        residual = model.residuals(fitted, observed[own], entry.normalization)[0]
        finite = np.where(np.isfinite(residual), residual, 1e9)
        weights = (1 + (finite / (2 * np.median(finite) + 1e-12)) ** 2) ** -2.0
    everywhere = np.full(len(points), np.nan)
    if valid[0]:
        everywhere[tracks] = model.residuals(fitted, observed, entry.normalization)[0]
    mine = everywhere[tracks[own]]
    rms = float(np.sqrt(np.mean(mine**2))) if np.isfinite(mine).all() and len(mine) else 0.0
    motion = Motion(
        label=label,
        set_index=place,
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
