"""Many tracks: some of them are grouped, and the others get the label of the group they agree with.

The cost of grouping is quadratic, and dense tracks are redundant. Hypotheses are drawn from at most
``MAX_GROUPED_TRACKS`` tracks, and these are the ones to group.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.models import Flags
from mssegment.records import (
    NOT_JUDGED,
    OUTLIER,
    Floats,
    Hypotheses,
    HypothesisSet,
    Integers,
    replace,
)
from mssegment.sampling.frame_pairs import MAX_GROUPED_TRACKS
from mssegment.sampling.observed import ObservedSet
from mssegment.sampling.validation import (
    FEW_OUTLIERS_SHARE,
    limit_factor,
    misfit_limit,
    two_frame_misfit,
)
from mssegment.segmentation.consensus.clustering import Consensus
from mssegment.segmentation.consensus.coassociation import marks_of

TRACKS_PER_BATCH = 8000
"""Tracks that are labelled at a time, to limit the memory for residuals."""


def tracks_to_group(eligible: Flags, sets: Sequence[HypothesisSet]) -> Flags:
    """The tracks [P] to group: all that are ``eligible``, or of many those that were sampled."""
    if eligible.sum() <= MAX_GROUPED_TRACKS:
        return eligible
    sampled = np.zeros(len(eligible), dtype=bool)
    for hypotheses in sets:
        sampled[hypotheses.subsets.ravel()] = True
    return eligible & sampled


def hypotheses_among(hypotheses: Hypotheses, tracks: Flags) -> Hypotheses:
    """The hypotheses drawn from ``tracks`` [P] alone; their subsets index only these tracks."""
    if tracks.all():
        return hypotheses
    row = np.cumsum(tracks) - 1
    sets = []
    for one in hypotheses.sets:
        kept = tracks[one.subsets].all(axis=1)
        sets.append(replace(one, subsets=row[one.subsets[kept]], points=one.points[kept]))
    return replace(hypotheses, sets=tuple(sets))


def propagate_labels(
    points: Floats, grouped: Floats, found: Consensus, hypotheses: Hypotheses
) -> Integers:
    """Label further tracks by the groups whose tracks mark the same hypotheses.

    Parameters
    ----------
    points : ndarray [m, F, 2]
        Tracks to label, in pixels, NaN where a point is not visible.
    grouped : ndarray [n, F, 2]
        The tracks that were grouped.
    found : Consensus
        Their labels and misfit.
    hypotheses : Hypotheses
        Hypotheses drawn from the grouped tracks.

    Returns
    -------
    ndarray [m] of int
        Labels 1, 2, ...; ``OUTLIER`` where the misfit exceeds the limit of the grouped tracks, and
        ``NOT_JUDGED`` where no set applies.
    """
    labels = found.labels
    if not (labels > 0).any():
        return np.full(len(points), OUTLIER)
    perspective = hypotheses.partition == "joinedness"
    limit = misfit_limit(grouped, found.misfit, perspective=perspective)
    if not _has_outliers(hypotheses):
        limit *= limit_factor(found.misfit[np.isfinite(found.misfit)], limit)
    propagated = np.full(len(points), NOT_JUDGED)
    for start in range(0, len(points), TRACKS_PER_BATCH):
        rows = slice(start, start + TRACKS_PER_BATCH)
        tracks = np.concatenate([grouped, points[rows]])
        agreement = _agreement(tracks, hypotheses.sets, labels)
        misfit = two_frame_misfit(tracks, hypotheses.sets, np.arange(len(grouped)))[len(grouped) :]
        label = np.where(misfit > limit, OUTLIER, agreement.argmax(axis=1) + 1)
        propagated[rows] = np.where(agreement.any(axis=1), label, NOT_JUDGED)
    return propagated


def _has_outliers(hypotheses: Hypotheses) -> bool:
    """Whether the a-contrario test found more outliers than hardly any."""
    if hypotheses.log_nfa is None:
        return False
    tested = hypotheses.log_nfa[~np.isnan(hypotheses.log_nfa)]
    return bool(len(tested)) and float((tested >= 0).mean()) >= FEW_OUTLIERS_SHARE


def _agreement(points: Floats, sets: Sequence[HypothesisSet], labels: Integers) -> Floats:
    """Agreement of the tracks after those with ``labels`` [n] with each group, [m, groups].

    The number of marks shared with a track of the group, on average, summed over the sets.
    """
    groups = np.arange(1, labels.max() + 1)
    agreement = np.zeros((len(points) - len(labels), len(groups)))
    for hypotheses in sets:
        observed_set = ObservedSet.of(points, hypotheses)
        tracks = observed_set.tracks
        marks = marks_of(observed_set, observed_set.ranking_sq_residuals())
        first = int(np.searchsorted(tracks, len(labels)))
        member = (labels[tracks[:first], None] == groups).astype(np.float32)
        shared = marks[:first].T @ member / np.maximum(member.sum(axis=0), 1)
        agreement[tracks[first:] - len(labels)] += marks[first:] @ shared
    return agreement
