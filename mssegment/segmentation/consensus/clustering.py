"""From hypothesis sets to one label per track: consensus, count, outliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.models import Flags
from mssegment.records import (
    NOT_JUDGED,
    OUTLIER,
    Floats,
    Hypotheses,
    HypothesisSet,
    Integers,
    Record,
)
from mssegment.sampling.observed import ObservedSet
from mssegment.sampling.validation import (
    Misfit,
    first_test,
    limit_factor,
    misfit_limit,
    two_frame_misfit,
)
from mssegment.segmentation.consensus.average_linkage import AverageLinkage
from mssegment.segmentation.consensus.coassociation import (
    Coassociation,
    Coassociations,
)
from mssegment.segmentation.consensus.model_order import PartitionSearch
from mssegment.segmentation.consensus.normalized_cuts import NormalizedCuts
from mssegment.segmentation.consensus.outliers import second_test

MOST_MOTIONS = 8
"""The most motions that are looked for where nobody says how many there are."""
SMALLEST, SMALLEST_SHARE = 8, 0.02
"""A group of complete tracks with fewer than both is a clique of outliers, no motion. Incomplete
tracks need the first only: what crosses the picture quickly leaves few."""


class Consensus(Record, frozen=True):
    """The outcome: ``labels`` [P] 1..m by size, 0 outlier, -2 seen too briefly.

    ``misfit`` [P] is that of ``Misfit`` (pixels); ``notes`` are sentences for the user.
    """

    labels: Integers
    misfit: Floats
    notes: tuple[str, ...] = ()


def cluster_by_consensus(
    points: Floats,
    hypotheses: Hypotheses,
    rng: np.random.Generator,
    *,
    motions: int | None = None,
    min_motions: int = 1,
    max_motions: int = MOST_MOTIONS,
    eligible: Flags | None = None,
) -> Consensus:
    """Group the tracks ``points`` [P, F, 2] (pixels, NaN: not visible) by ``hypotheses``.

    ``motions`` is the number of motions where it is known; ``eligible`` [P] excludes tracks
    (background), their label is 0. Raises DataError where the hypotheses were not drawn for
    consensus, or see too few tracks.
    """
    chosen = np.arange(len(points)) if eligible is None else np.flatnonzero(eligible)
    own = points.copy()
    if eligible is not None:
        own[~eligible] = np.nan
    usable = [entry for entry in hypotheses.sets if len(entry.points) and entry.evidence]
    _check(usable)
    least = motions if motions else max(1, min_motions)
    most = motions if motions else max(least, max_motions)
    if hypotheses.partition == "average_linkage":
        return _linked(own, usable, chosen, (least, motions or len(points)))
    misfits, coassociations = Misfit(own), Coassociations(len(points))
    for entry in usable:
        observed_set = ObservedSet.of(own, entry)
        squared = observed_set.ranking_sq_residuals()
        misfits.add(observed_set, squared)
        coassociations.add(observed_set, squared)
    misfit, kinds = misfits.pixels(), coassociations.kinds
    labels = np.full(len(points), OUTLIER, dtype=np.int64)
    unseen = np.isnan(misfit)
    labels[chosen[unseen[chosen]]] = NOT_JUDGED
    kept = np.flatnonzero(~unseen)
    if len(kept) < SMALLEST:
        raise DataError(
            f"{len(kept)} tracks are seen in a frame pair of the hypotheses; expected at least "
            f"{SMALLEST}: give longer tracks, or more corners"
        )
    perspective = hypotheses.partition == "normalized_cuts"
    sparing = limit_factor(
        misfit[kept], misfit_limit(own[kept], misfit[kept], perspective=perspective)
    )
    kept = kept[first_test(own[kept], misfit[kept], perspective=perspective)]
    group = _group_incomplete if perspective else _group_complete
    found, groups = group(own, kinds, kept, (least, most), rng)
    if not perspective:
        groups[second_test(own[found], misfit[found], groups, sparing)] = OUTLIER
    labels[found] = groups
    return Consensus(_by_size(labels), misfit)


def _linked(
    points: Floats, sets: Sequence[HypothesisSet], chosen: Integers, bounds: tuple[int, int]
) -> Consensus:
    """The outcome before a static camera; ``bounds`` are the least and the most motions."""
    found = AverageLinkage(points, sets)
    labels = np.full(len(points), OUTLIER, dtype=np.int64)
    labels[chosen[~found.seen[chosen]]] = NOT_JUDGED
    labels[found.seen] = found.labels(*bounds)
    return Consensus(_by_size(labels), two_frame_misfit(points, sets))


def _group_complete(
    points: Floats,
    kinds: Mapping[str, Coassociation],
    tracks: Integers,
    bounds: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[Integers, Integers]:
    """Tracks and their labels (0 outlier): complete tracks by bodies, the others join them."""
    complete = tracks[np.isfinite(points[tracks]).all(axis=(1, 2))]
    most = bounds[1]

    def partition_search(chosen: Integers) -> PartitionSearch:
        block = np.ix_(chosen, chosen)
        agreements = {name: np.asarray(kind.mean[block], float) for name, kind in kinds.items()}
        return PartitionSearch(points[chosen], agreements, most, rng)

    complete, labels = _without_cliques(complete, partition_search, bounds, SMALLEST_SHARE)
    partial = np.setdiff1d(tracks, np.flatnonzero(np.isfinite(points).all(axis=(1, 2))))
    local = next(kind for name, kind in kinds.items() if models.class_named(name).is_local)
    joined = _join(local, partial, complete, labels)
    return np.concatenate([complete, partial]), np.concatenate([labels, joined])


def _group_incomplete(
    points: Floats,
    kinds: Mapping[str, Coassociation],
    tracks: Integers,
    bounds: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[Integers, Integers]:
    """Tracks and their labels, by normalised cuts."""

    def normalized_cuts(chosen: Integers) -> NormalizedCuts:
        block = np.ix_(chosen, chosen)
        own = {
            name: Coassociation(kind.agreement[block], kind.shared[block])
            for name, kind in kinds.items()
        }
        return NormalizedCuts(points[chosen], own, bounds[1], rng)

    return _without_cliques(tracks, normalized_cuts, bounds, 0.0)


def _without_cliques(
    tracks: Integers,
    partitions: Callable[[Integers], PartitionSearch | NormalizedCuts],
    bounds: tuple[int, int],
    share: float,
) -> tuple[Integers, Integers]:
    """Groups of the tracks, labels 1..m; cliques of outliers are taken out and it starts again."""
    while True:
        found = partitions(tracks)
        labels = found.best(found.count(*bounds))
        sizes = np.bincount(labels)[labels]
        small = sizes < max(SMALLEST, share * len(tracks))
        # what is left must still be able to hold the motions
        if not small.any() or (~small).sum() < SMALLEST * bounds[0]:
            return tracks, labels + 1
        tracks = tracks[~small]


def _join(kind: Coassociation, partial: Integers, complete: Integers, labels: Integers) -> Integers:
    """Labels of the tracks ``partial``: the group they agree with most; NOT_JUDGED without any."""
    if not len(partial):
        return np.zeros(0, dtype=np.int64)
    member = np.eye(int(labels.max()) + 1)[labels][:, 1:]
    block = np.ix_(partial, complete)
    shared = kind.shared[block] @ member
    agreement = kind.agreement[block] @ member / np.maximum(shared, 1)
    return np.where(shared.any(axis=1), agreement.argmax(axis=1) + 1, NOT_JUDGED)


def _by_size(labels: Integers) -> Integers:
    """Motions numbered from the largest to the smallest."""
    names, sizes = np.unique(labels[labels > 0], return_counts=True)
    numbered = labels.copy()
    for number, name in enumerate(names[np.argsort(-sizes, kind="stable")], 1):
        numbered[labels == name] = number
    return numbered


def _check(sets: Sequence[HypothesisSet]) -> None:
    if not any(len(entry.frames) == 2 for entry in sets):
        raise DataError(
            "consensus needs hypotheses between frame pairs, these are over "
            f"{len(sets[0].frames) if sets else 0} frames; run `mssegment hypothesize` again"
        )
