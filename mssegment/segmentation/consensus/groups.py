"""Complete and incomplete tracks, and those before a static camera, in groups.

Each kind has its own way from the agreement of the tracks to a partition and the number of its
groups; outliers by the first two tests are taken out, and small groups.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.models import Flags
from mssegment.records import NOT_JUDGED, OUTLIER, Floats, HypothesisSet, Integers, Record
from mssegment.sampling.validation import first_test, limit_factor, misfit_limit
from mssegment.segmentation.consensus.average_linkage import AverageLinkage
from mssegment.segmentation.consensus.coassociation import Coassociation
from mssegment.segmentation.consensus.model_order import SpectralClustering
from mssegment.segmentation.consensus.outliers import second_test
from mssegment.segmentation.consensus.rigid_grouping import RigidGrouping

MIN_GROUP_SIZE, MIN_GROUP_SHARE = 8, 0.02
"""Smallest number of tracks of a group, and for complete tracks also the smallest share of all
tracks: smaller groups are outliers that agree by chance. (What crosses the image quickly has few,
incomplete tracks.)"""

Bounds = tuple[int, int]
"""The least and the largest number of motions."""


class Groups(Record, frozen=True):
    """Some of the tracks, in groups.

    Attributes
    ----------
    tracks : ndarray [n] of int
        Indices of the tracks that have a label.
    labels : ndarray [n] of int
        1..m, ``OUTLIER`` or ``NOT_JUDGED``.
    separations : sequence of float
        How far each of the m groups is apart from its nearest neighbour; empty if this was not
        tested.
    """

    tracks: Integers
    labels: Integers
    separations: Sequence[float] = ()


def static_groups(
    points: Floats, sets: Sequence[HypothesisSet], bounds: Bounds
) -> tuple[Groups, Flags]:
    """Of tracks [P, F, 2] that move before a static camera, and which can be grouped, [P]."""
    linkage = AverageLinkage(points, sets)
    return Groups(np.flatnonzero(linkage.usable), linkage.labels(*bounds)), linkage.usable


def complete_groups(
    points: Floats,
    kinds: Mapping[str, Coassociation],
    misfit: Floats,
    bounds: Bounds,
    rng: np.random.Generator,
) -> Groups:
    """Of mostly complete tracks [P, F, 2]: those by spectral clustering, which the others join.

    ``kinds`` are the coassociations by model, ``misfit`` [P] is in pixels.
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

    complete = _without_small_groups(
        tracks[is_complete[tracks]], spectral_clustering, bounds, MIN_GROUP_SHARE
    )
    partial = np.setdiff1d(tracks, np.flatnonzero(is_complete))
    local = next(kind for name, kind in kinds.items() if models.class_named(name).is_local)
    tracks = np.concatenate([complete.tracks, partial])
    labels = np.concatenate([complete.labels, _join(local, partial, complete)])
    labels[second_test(points[tracks], misfit[tracks], labels, factor)] = OUTLIER
    return Groups(tracks, labels, complete.separations)


def incomplete_groups(
    points: Floats,
    kinds: Mapping[str, Coassociation],
    pairs: Sequence[tuple[int, int]],
    misfit: Floats,
    bounds: Bounds,
    rng: np.random.Generator,
) -> Groups:
    """Of incomplete tracks [P, F, 2], seen in ``pairs`` of frames, by ``RigidGrouping``."""
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
    bounds: Bounds,
    share: float,
) -> Groups:
    """Groups of the tracks; starts again without the tracks of small groups."""
    while True:
        found = partitions(tracks)
        count = found.count(*bounds)
        labels = found.best(count)
        sizes = np.bincount(labels)[labels]
        small = sizes < max(MIN_GROUP_SIZE, share * len(tracks))
        # enough tracks must remain for the least number of motions
        if not small.any() or (~small).sum() < MIN_GROUP_SIZE * bounds[0]:
            return Groups(tracks, labels + 1, found.separations(count))
        tracks = tracks[~small]


def _join(kind: Coassociation, partial: Integers, complete: Groups) -> Integers:
    """Labels of the tracks ``partial``: the group that they agree with most, or NOT_JUDGED."""
    if not len(partial):
        return np.zeros(0, dtype=np.int64)
    member = np.eye(int(complete.labels.max()) + 1)[complete.labels][:, 1:]
    block = np.ix_(partial, complete.tracks)
    shared = kind.shared[block] @ member
    agreement = kind.agreement[block] @ member / np.maximum(shared, 1)
    return np.where(shared.any(axis=1), agreement.argmax(axis=1) + 1, NOT_JUDGED)
