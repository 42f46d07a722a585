"""From sets of hypotheses to one label per track: grouping, number of groups, outliers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

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
from mssegment.sampling.validation import Misfit, two_frame_misfit
from mssegment.segmentation.consensus.coassociation import (
    Coassociation,
    CoassociationAccumulator,
)
from mssegment.segmentation.consensus.group_test import by_chance, log_false_alarms_of_groups
from mssegment.segmentation.consensus.groups import (
    Groups,
    complete_groups,
    incomplete_groups,
    static_groups,
)
from mssegment.segmentation.consensus.walk_test import walk_test

MAX_MOTIONS = 8
"""Maximum number of motions, unless their number is given."""
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
        groups, usable = static_groups(points, sets, (least, motions or len(points)))
        brief = tracks[~usable[tracks]]
        found = Consensus(
            by_size(_labels(groups, len(points), brief)), two_frame_misfit(points, sets)
        )
        return without_chance_groups(points, found, rng, moved_before, drop=drop)
    bounds = least, motions if motions else max(least, MAX_MOTIONS)
    misfit, kinds = _evidence(points, sets)
    incomplete = hypotheses.partition == "joinedness"
    if incomplete:
        pairs = sorted({(one.frames[0], one.frames[1]) for one in sets})
        groups = incomplete_groups(points, kinds, pairs, misfit, bounds, rng)
    else:
        groups = complete_groups(points, kinds, misfit, bounds, rng)
    brief = tracks[np.isnan(misfit[tracks])]
    drawn = _labels(groups, len(points), brief)
    found = Consensus(by_size(drawn), misfit)
    found = without_chance_groups(points, found, rng, moved_before, drop=drop)
    # afterwards, since what is left of independent tracks is coherent by selection
    walks = walk_test(points, found.labels, rng, incomplete=incomplete)
    found = without_outliers(found, walks)
    return replace(found, separations=_in_order(groups.separations, drawn, found.labels))


def _evidence(
    points: Floats, sets: Sequence[HypothesisSet]
) -> tuple[Floats, Mapping[str, Coassociation]]:
    """The misfit of each track [P] in pixels, and the coassociation of the tracks by model."""
    misfits, coassociations = Misfit(points), CoassociationAccumulator(len(points))
    for one in track(sets, "sets of hypotheses"):
        observed_set = ObservedSet.of(points, one)
        squared = observed_set.ranking_sq_residuals()
        misfits.add(observed_set, squared)
        coassociations.add(observed_set, squared)
    return misfits.pixels(), coassociations.kinds


def _labels(groups: Groups, total: int, brief: Integers) -> Integers:
    """The labels of all ``total`` tracks: ``OUTLIER`` for those without one that are not brief."""
    labels = np.full(total, OUTLIER, dtype=np.int64)
    labels[brief] = NOT_JUDGED
    labels[groups.tracks] = groups.labels
    return labels


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
