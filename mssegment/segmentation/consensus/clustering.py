"""From sets of hypotheses to one label per track: grouping, number of groups, outliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.models import Flags
from mssegment.progress import track
from mssegment.records import (
    NOT_JUDGED,
    OUTLIER,
    Floats,
    Hypotheses,
    HypothesisSet,
    Integers,
    Record,
    by_size,
    replace,
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
    CoassociationAccumulator,
)
from mssegment.segmentation.consensus.group_test import by_chance, log_false_alarms_of_groups
from mssegment.segmentation.consensus.model_order import SpectralClustering
from mssegment.segmentation.consensus.outliers import second_test
from mssegment.segmentation.consensus.rigid_grouping import RigidGrouping
from mssegment.segmentation.consensus.walk_test import walk_test

MAX_MOTIONS = 8
"""Maximum number of motions, unless their number is given."""
MIN_GROUP_SIZE, MIN_GROUP_SHARE = 8, 0.02
"""Smallest number of tracks of a group, and for complete tracks also the smallest share of all
tracks: smaller groups are outliers that agree by chance. (What crosses the image quickly has few,
incomplete tracks.)"""


WALKS_NOTE = (
    "{count} group(s) of tracks move no more coherently than tracks that move independently, and "
    "are no motions; set segment.motions or segment.min_motions to keep them"
)


class Consensus(Record, frozen=True):
    """The groups of tracks.

    Attributes
    ----------
    labels : ndarray [P] of int
        1..m, the largest group first; ``OUTLIER``, or ``NOT_JUDGED`` for tracks that are visible
        too briefly.
    misfit : ndarray [P]
        The ``Misfit`` of each track in pixels.
    log_nfa : tuple of float
        Logarithm of the number of false alarms of each group, as ``Motion.log_nfa``, None
        where it is not known; empty if the groups were not tested.
    separations : tuple of float
        How far each group is from its nearest neighbour, as ``Motion.separation``; empty if there
        is one group, or if this was not tested.
    notes : tuple of str
        Notes for the user.
    """

    labels: Integers
    misfit: Floats
    log_nfa: tuple[float | None, ...] = ()
    separations: tuple[float, ...] = ()
    notes: tuple[str, ...] = ()


def cluster_by_consensus(
    points: Floats,
    hypotheses: Hypotheses,
    rng: np.random.Generator,
    *,
    motions: int | None = None,
    min_motions: int = 0,
    eligible: Flags | None = None,
    moved_before: Flags | None = None,
) -> Consensus:
    """Group tracks that agree on hypotheses.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    hypotheses : Hypotheses
        Hypotheses drawn for consensus.
    rng : numpy.random.Generator
        Source of random numbers.
    motions : int, optional
        The number of motions, if it is known.
    min_motions : int
        The least number of motions, if their number is not known.
    eligible : ndarray [P] of bool, optional
        Tracks to group; the others, for instance background, are labelled ``OUTLIER``.
    moved_before : ndarray [P] of bool, optional
        Tracks that moved with a group in the frames before (``log_false_alarms_of_groups``).

    Returns
    -------
    Consensus

    Raises
    ------
    DataError
        If the hypotheses were not drawn for consensus, or apply to too few tracks.
    """
    tracks = np.arange(len(points)) if eligible is None else np.flatnonzero(eligible)
    points = points.copy()
    if eligible is not None:
        points[~eligible] = np.nan
    sets = [one for one in hypotheses.sets if len(one.points) and one.evidence]
    _check_pairs(sets)
    least = motions if motions else max(1, min_motions)
    # a number of motions that the user gives is a fact
    drop = not motions and not min_motions
    if hypotheses.partition == "average_linkage":
        found = _cluster_static(points, sets, tracks, (least, motions or len(points)))
        return without_chance_groups(points, found, rng, moved_before, drop=drop)
    bounds = least, motions if motions else max(least, MAX_MOTIONS)
    misfits, coassociations = Misfit(points), CoassociationAccumulator(len(points))
    for one in track(sets, "sets of hypotheses"):
        observed_set = ObservedSet.of(points, one)
        squared = observed_set.ranking_sq_residuals()
        misfits.add(observed_set, squared)
        coassociations.add(observed_set, squared)
    misfit = misfits.pixels()
    labels = np.full(len(points), OUTLIER, dtype=np.int64)
    labels[tracks[np.isnan(misfit[tracks])]] = NOT_JUDGED
    if hypotheses.partition == "joinedness":
        pairs = sorted({(one.frames[0], one.frames[1]) for one in sets})
        grouped, groups, apart = _cluster_incomplete(
            points, coassociations.kinds, pairs, misfit, bounds, rng
        )
    else:
        grouped, groups, apart = _cluster_complete(
            points, coassociations.kinds, misfit, bounds, rng
        )
    labels[grouped] = groups
    drawn, labels = labels, by_size(labels)
    found = Consensus(labels, misfit)
    found = without_chance_groups(points, found, rng, moved_before, drop=drop)
    # afterwards, since what is left of independent tracks is coherent by selection
    incomplete = hypotheses.partition == "joinedness"
    walks = walk_test(points, found.labels, rng, incomplete=incomplete)
    found = without_outliers(found, walks)
    return replace(found, separations=_in_order(apart, drawn, found.labels))


def without_chance_groups(
    points: Floats,
    found: Consensus,
    rng: np.random.Generator,
    moved_before: Flags | None = None,
    *,
    drop: bool,
) -> Consensus:
    """The groups with their numbers of false alarms; without those by chance if ``drop``."""
    if points.shape[1] < 3:
        return found
    log_nfa = log_false_alarms_of_groups(points, found.labels, MAX_MOTIONS, rng, moved_before)
    chance = by_chance(log_nfa, MAX_MOTIONS)
    if not drop or not chance.any():
        return replace(found, log_nfa=_known(log_nfa))
    dropped = np.flatnonzero(chance) + 1
    labels = by_size(np.where(np.isin(found.labels, dropped), OUTLIER, found.labels))
    notes = (WALKS_NOTE.format(count=len(dropped)),)
    return replace(found, labels=labels, log_nfa=_known(log_nfa[~chance]), notes=notes)


def without_outliers(found: Consensus, outliers: Flags) -> Consensus:
    """The groups without these tracks [P], the largest group first."""
    labels = by_size(np.where(outliers, OUTLIER, found.labels))
    firsts = [int(np.argmax(labels == k)) for k in range(1, int(labels.max(initial=0)) + 1)]
    known = found.log_nfa and tuple(found.log_nfa[found.labels[i] - 1] for i in firsts)
    return replace(found, labels=labels, log_nfa=known)


def _known(log_nfa: Floats) -> tuple[float | None, ...]:
    """Numbers of false alarms, None for those that are not known."""
    return tuple(None if np.isnan(value) else value for value in log_nfa.tolist())


def _cluster_static(
    points: Floats, sets: Sequence[HypothesisSet], tracks: Integers, bounds: tuple[int, int]
) -> Consensus:
    """The groups before a static camera; ``bounds`` are the least and the most motions."""
    linkage = AverageLinkage(points, sets)
    labels = np.full(len(points), OUTLIER, dtype=np.int64)
    labels[tracks[~linkage.usable[tracks]]] = NOT_JUDGED
    labels[linkage.usable] = linkage.labels(*bounds)
    return Consensus(by_size(labels), two_frame_misfit(points, sets))


def _cluster_complete(
    points: Floats,
    kinds: Mapping[str, Coassociation],
    misfit: Floats,
    bounds: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[Integers, Integers, Sequence[float]]:
    """Tracks, their labels, and the separation of each label.

    Complete tracks by spectral clustering; the others join them.
    """
    tracks = _visible_tracks(misfit)
    factor = limit_factor(misfit[tracks], misfit_limit(points[tracks], misfit[tracks]))
    tracks = tracks[first_test(points[tracks], misfit[tracks])]
    is_complete = np.asarray(np.isfinite(points).all(axis=(1, 2)))

    def spectral_clustering(chosen: Integers) -> SpectralClustering:
        block = np.ix_(chosen, chosen)
        agreements = {name: np.asarray(kind.mean[block], float) for name, kind in kinds.items()}
        smallest = max(MIN_GROUP_SIZE, MIN_GROUP_SHARE * len(chosen))
        return SpectralClustering(points[chosen], agreements, bounds[1], smallest, rng)

    complete, labels, apart = _without_small_groups(
        tracks[is_complete[tracks]], spectral_clustering, bounds, MIN_GROUP_SHARE
    )
    partial = np.setdiff1d(tracks, np.flatnonzero(is_complete))
    local = next(kind for name, kind in kinds.items() if models.class_named(name).is_local)
    joined = _join(local, partial, complete, labels)
    grouped, labels = np.concatenate([complete, partial]), np.concatenate([labels, joined])
    labels[second_test(points[grouped], misfit[grouped], labels, factor)] = OUTLIER
    return grouped, labels, apart


def _cluster_incomplete(
    points: Floats,
    kinds: Mapping[str, Coassociation],
    pairs: Sequence[tuple[int, int]],
    misfit: Floats,
    bounds: tuple[int, int],
    rng: np.random.Generator,
) -> tuple[Integers, Integers, Sequence[float]]:
    """Tracks, their labels, and the separation of each label, by ``RigidGrouping``."""
    tracks = _visible_tracks(misfit)
    tracks = tracks[first_test(points[tracks], misfit[tracks], perspective=True)]

    def rigid_grouping(chosen: Integers) -> RigidGrouping:
        block = np.ix_(chosen, chosen)
        of_chosen = {
            name: Coassociation(kind.agreement[block], kind.shared[block])
            for name, kind in kinds.items()
        }
        return RigidGrouping(points[chosen], of_chosen, pairs, bounds, rng)

    return _without_small_groups(tracks, rigid_grouping, bounds, 0.0)


def _visible_tracks(misfit: Floats) -> Integers:
    """Tracks that are visible in a frame pair; raises DataError if there are too few."""
    tracks = np.flatnonzero(~np.isnan(misfit))
    if len(tracks) < MIN_GROUP_SIZE:
        raise DataError(
            f"{len(tracks)} tracks are visible in a frame pair of the hypotheses; expected at "
            f"least {MIN_GROUP_SIZE}: use longer tracks or more corners"
        )
    return tracks


def _without_small_groups(
    tracks: Integers,
    partitions: Callable[[Integers], SpectralClustering | RigidGrouping],
    bounds: tuple[int, int],
    share: float,
) -> tuple[Integers, Integers, Sequence[float]]:
    """Groups of the tracks, labels 1..m, and how far each is apart from the nearest other one.

    Starts again without the tracks of small groups.
    """
    while True:
        found = partitions(tracks)
        count = found.count(*bounds)
        labels = found.best(count)
        sizes = np.bincount(labels)[labels]
        small = sizes < max(MIN_GROUP_SIZE, share * len(tracks))
        # enough tracks must remain for the least number of motions
        if not small.any() or (~small).sum() < MIN_GROUP_SIZE * bounds[0]:
            return tracks, labels + 1, found.separations(count)
        tracks = tracks[~small]


def _join(kind: Coassociation, partial: Integers, complete: Integers, labels: Integers) -> Integers:
    """Labels of the tracks ``partial``: the group that they agree with most, or NOT_JUDGED."""
    if not len(partial):
        return np.zeros(0, dtype=np.int64)
    member = np.eye(int(labels.max()) + 1)[labels][:, 1:]
    block = np.ix_(partial, complete)
    shared = kind.shared[block] @ member
    agreement = kind.agreement[block] @ member / np.maximum(shared, 1)
    return np.where(shared.any(axis=1), agreement.argmax(axis=1) + 1, NOT_JUDGED)


def _in_order(apart: Sequence[float], before: Integers, labels: Integers) -> tuple[float, ...]:
    """The values of the labels 1..m ``before``, in the order of the ``labels`` that they became."""
    if len(apart) < 2:
        return ()
    first = [int(before[labels == label][0]) for label in range(1, int(labels.max(initial=0)) + 1)]
    return tuple(apart[label - 1] for label in first) if len(first) > 1 else ()


def _check_pairs(sets: Sequence[HypothesisSet]) -> None:
    """Raise DataError without a set between two frames."""
    if not any(len(one.frames) == 2 for one in sets):
        raise DataError(
            "consensus needs hypotheses between frame pairs, but these are over "
            f"{len(sets[0].frames) if sets else 0} frames; run `mssegment hypothesize` again"
        )
