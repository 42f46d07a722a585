"""Many tracks: some of them are grouped, and the others join the group that they agree with.

The cost of grouping grows with the square of the tracks, and dense tracks say the same thing many
times. Hypotheses are drawn from at most MAX_GROUPED_TRACKS tracks, and these are the ones to group.
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
from mssegment.sampling.validation import limit_factor, misfit_limit, two_frame_misfit
from mssegment.segmentation.consensus.coassociation import marks_of

AT_A_TIME = 8000
"""Tracks that join together, so that the residuals from all hypotheses fit memory."""


def tracks_to_group(eligible: Flags, sets: Sequence[HypothesisSet]) -> Flags:
    """Which of the eligible tracks [P] to group: all, or of many those that made hypotheses."""
    if eligible.sum() <= MAX_GROUPED_TRACKS:
        return eligible
    makers = np.zeros(len(eligible), dtype=bool)
    for entry in sets:
        makers[entry.subsets.ravel()] = True
    return eligible & makers


def hypotheses_among(hypotheses: Hypotheses, tracks: Flags) -> Hypotheses:
    """The hypotheses made of ``tracks`` [P] alone; their subsets count these tracks only."""
    if tracks.all():
        return hypotheses
    place = np.cumsum(tracks) - 1
    kept = [tracks[entry.subsets].all(axis=1) for entry in hypotheses.sets]
    sets = [
        replace(entry, subsets=place[entry.subsets[own]], points=entry.points[own])
        for entry, own in zip(hypotheses.sets, kept, strict=True)
    ]
    return replace(hypotheses, sets=tuple(sets))


def propagate_labels(
    grouped: Floats,
    sets: Sequence[HypothesisSet],
    labels: Integers,
    misfit: Floats,
    others: Floats,
    *,
    perspective: bool,
) -> Integers:
    """Labels [m] of the tracks ``others`` [m, F, 2], pixels, NaN where not seen.

    The tracks ``grouped`` [n, F, 2] have the ``labels`` [n] and the ``misfit`` [n]; ``sets`` are
    made of them. A track joins the group whose tracks mark the same hypotheses. It is an outlier
    where it misfits more than the grouped tracks may, NOT_JUDGED where no set sees it.
    """
    if not (labels > 0).any():
        return np.full(len(others), OUTLIER)
    limit = misfit_limit(grouped, misfit, perspective=perspective)
    limit *= limit_factor(misfit[np.isfinite(misfit)], limit)
    found = np.full(len(others), NOT_JUDGED)
    for start in range(0, len(others), AT_A_TIME):
        rows = slice(start, start + AT_A_TIME)
        together = np.concatenate([grouped, others[rows]])
        agreement = _agreement(together, sets, labels)
        away = two_frame_misfit(together, sets, np.arange(len(grouped)))[len(grouped) :]
        label = np.where(away > limit, OUTLIER, agreement.argmax(axis=1) + 1)
        found[rows] = np.where(agreement.any(axis=1), label, NOT_JUDGED)
    return found


def _agreement(points: Floats, sets: Sequence[HypothesisSet], labels: Integers) -> Floats:
    """How far the tracks after those with ``labels`` [n] agree with each group, [m, groups].

    The marks that a track shares with a track of the group, on average, summed over the sets.
    """
    groups = np.arange(1, labels.max() + 1)
    agreement = np.zeros((len(points) - len(labels), len(groups)))
    for entry in sets:
        observed_set = ObservedSet.of(points, entry)
        seen = observed_set.tracks
        marks = marks_of(observed_set, observed_set.ranking_sq_residuals())
        first = int(np.searchsorted(seen, len(labels)))
        member = (labels[seen[:first], None] == groups).astype(np.float32)
        shared = marks[:first].T @ member / np.maximum(member.sum(axis=0), 1)
        agreement[seen[first:] - len(labels)] += marks[first:] @ shared
    return agreement
