"""Hypotheses for consensus: several sets, between pairs of frames and over all frames.

- Mostly complete tracks: planar patches between pairs of frames, and subspaces over all frames.
- Incomplete tracks: homographies and fundamental matrices between pairs of frames, each computed
  from the tracks that are visible in both.
- Static camera: affine motions between frames far apart.

Missing positions are never filled in.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from mssegment.errors import DataError
from mssegment.models import Flags, MotionModel
from mssegment.models.affine import Affine
from mssegment.models.factorization import Factorization
from mssegment.models.flat import Flat
from mssegment.models.fundamental import Fundamental
from mssegment.models.homography import Homography
from mssegment.progress import track
from mssegment.records import (
    Floats,
    Hypotheses,
    HypothesisSet,
    Integers,
    Partition,
    replace,
)
from mssegment.sampling.chimeras import log_false_alarms
from mssegment.sampling.neighbourhoods import nearest_neighbours, random_subset
from mssegment.sampling.validation import first_test, two_frame_misfit
from mssegment.sampling.windows import log_false_alarms_in_windows

MAX_GROUPED_TRACKS = 2000
"""Tracks that are sampled and grouped; the cost of grouping is quadratic."""
MIN_COMPLETE_SHARE = 0.75
"""Share of complete tracks from which on hypotheses over all frames are used."""
COMPLETE_PAIRS = 12
"""Number of frame pairs for complete tracks, evenly spaced."""
COMPLETE_GAP = 0.1
"""Gap of a frame pair for complete tracks, as a share of the frames."""
SHORT_GAPS = (1, 2, 4)
"""Gaps of the frame pairs of incomplete tracks, in frames; for longer gaps too few tracks are in
both frames."""
PAIRS_PER_GAP = 6
"""Number of frame pairs of each gap, evenly spaced."""
REFERENCE_LENGTH = 14
"""Track length in frames for which ``SHORT_GAPS`` are meant; with the length they are
multiplied."""
LONG_GAPS = (1 / 8, 1 / 4, 1 / 2)
"""Gaps of frame pairs of a static camera, relative to the median track length: the longest
separates objects best, the others are for shorter tracks."""
HYPOTHESES_PER_PAIR = 200
"""Hypotheses per frame pair and model."""
HYPOTHESES_PER_LONG_PAIR = 400
"""Hypotheses per frame pair of a static camera: some must have their seed on each small object."""
RANKING_SINGULAR_VALUE_RATIO = 1e-6
"""Smallest singular value of a subset of complete tracks, relative to the largest. Tracks only rank
these hypotheses, so that a poorly conditioned one does no harm."""
HYPOTHESES_OVER_ALL_FRAMES = 1000
"""Hypotheses over all frames."""
HYPOTHESES_NOT_EVIDENCE = 300
"""Hypotheses of a set that is not used for grouping, only to estimate the density around a
motion."""
LOCAL_SHARE = 0.7
"""Share of the subsets that are a seed and some of its neighbours; the others are drawn
uniformly."""
STORED_NEIGHBOURS = 24
"""Nearest neighbours stored per track; a model draws from ``MotionModel.sampling_neighbours``."""
DISPLACEMENT_WEIGHT = 3.0
"""Weight of the displacement relative to the position in distances between two frames."""
MIN_SHARED_TRACKS = 10
"""Tracks that must be visible in both frames of a pair."""


def draw_for_consensus(
    points: Floats,
    rng: np.random.Generator,
    *,
    eligible: Flags | None = None,
    static: bool = False,
    rank: int | Literal["auto"] = "auto",
) -> Hypotheses:
    """Sample the hypotheses that consensus needs.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    rng : numpy.random.Generator
        Source of random numbers.
    eligible : ndarray [P] of bool, optional
        Tracks that may be sampled, without the background; all by default.
    static : bool
        Whether the camera is static and the background excluded.
    rank : {3, 4, "auto"}
        Rank of the subspaces over all frames: 3 planar, 4 general. ``auto`` samples general ones as
        evidence, and some planar ones to decide which motions are planar.

    Returns
    -------
    Hypotheses
        With ``partition``, the kind of grouping that suits the tracks.

    Raises
    ------
    DataError
        If there are fewer than two frames, or no frame pair has enough tracks in common.
    """
    frames = points.shape[1]
    if frames < 2:
        raise DataError(f"consensus needs at least 2 frames, but the tracks have {frames}")
    visible = np.asarray(np.isfinite(points).all(axis=2))
    if eligible is not None:
        visible = visible & eligible[:, None]
    tracks = random_subset(np.asarray(visible.any(axis=1)), MAX_GROUPED_TRACKS, rng)
    visible = visible & tracks[:, None]
    lengths = visible.sum(axis=1)
    complete = np.asarray(visible.all(axis=1))
    partition: Partition
    if static:
        pairs, partition = _long_pairs(frames, lengths), "average_linkage"
        _check_pairs(visible, pairs)
        sets = _draw_pairs(points, visible, (Affine(),), pairs, HYPOTHESES_PER_LONG_PAIR, rng)
    elif complete.sum() >= max(MIN_COMPLETE_SHARE * tracks.sum(), MIN_SHARED_TRACKS):
        ranks, partition = (4, 3) if rank == "auto" else (rank,), "spectral"
        log_nfa = _tested(points, complete, rng)
        visible = visible & ~(log_nfa >= 0)[:, None]
        sets = []
        if visible.all(axis=1).sum() >= MIN_SHARED_TRACKS:
            sets = _draw_complete(points, visible, ranks, rng)
        return Hypotheses("consensus", tuple(sets), partition, log_nfa)
    else:
        pairs, partition = _short_pairs(frames, lengths), "joinedness"
        _check_pairs(visible, pairs)
        log_nfa = log_false_alarms_in_windows(points, tracks, rng)
        visible = visible & ~(log_nfa >= 0)[:, None]
        kinds = (Homography(), Fundamental())
        sets = _draw_pairs(points, visible, kinds, pairs, HYPOTHESES_PER_PAIR, rng)
        return Hypotheses("consensus", tuple(sets), partition, log_nfa)
    return Hypotheses("consensus", tuple(sets), partition)


def _tested(points: Floats, complete: Flags, rng: np.random.Generator) -> Floats:
    """Log numbers of false alarms [P] of the ``complete`` tracks [P]; NaN for the others."""
    log_nfa = np.full(len(points), np.nan)
    if points.shape[1] > 2:
        log_nfa[complete] = log_false_alarms(points[complete], rng)
    return log_nfa


def _draw_complete(
    points: Floats, visible: Flags, ranks: tuple[int, ...], rng: np.random.Generator
) -> list[HypothesisSet]:
    """Sets for complete tracks: patches between frame pairs, then subspaces of ``ranks``."""
    frames = points.shape[1]
    complete = np.flatnonzero(visible.all(axis=1))
    neighbours = nearest_neighbours(points[complete], STORED_NEIGHBOURS)
    sets = []
    even = _even_pairs(frames, max(1, round(COMPLETE_GAP * frames)), COMPLETE_PAIRS)
    for pair in track(even, "pairs of frames"):
        shared = np.flatnonzero(visible[:, pair].all(axis=1))
        near = (
            neighbours
            if len(shared) == len(complete)
            else _pair_neighbours(points[shared][:, pair])
        )
        sets.append(_draw_set(Flat(), points, shared, near, pair, HYPOTHESES_PER_PAIR, rng))
    if frames < 3:
        count = HYPOTHESES_NOT_EVIDENCE
        drawn = _draw_set(Affine(), points, complete, neighbours, (0, 1), count, rng)
        return [*sets, replace(drawn, evidence=False)]
    inliers = complete[first_test(points[complete], two_frame_misfit(points, sets)[complete])]
    neighbours = nearest_neighbours(points[inliers], STORED_NEIGHBOURS)
    all_frames = tuple(range(frames))
    for i, rank in enumerate(ranks):
        model = Factorization(frames, rank, RANKING_SINGULAR_VALUE_RATIO)
        count = HYPOTHESES_NOT_EVIDENCE if i else HYPOTHESES_OVER_ALL_FRAMES
        drawn = _draw_set(model, points, inliers, neighbours, all_frames, count, rng)
        sets.append(replace(drawn, evidence=i == 0))
    return sets


def _draw_pairs(
    points: Floats,
    visible: Flags,
    kinds: Sequence[MotionModel],
    pairs: list[tuple[int, int]],
    count: int,
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    """Sets of all ``kinds`` between the ``pairs`` of frames that have enough tracks in common."""
    sets = []
    for pair in track(pairs, "pairs of frames"):
        shared = np.flatnonzero(visible[:, pair].all(axis=1))
        if len(shared) < MIN_SHARED_TRACKS:
            continue
        near = _pair_neighbours(points[shared][:, pair])
        sets += [_draw_set(model, points, shared, near, pair, count, rng) for model in kinds]
    return sets


def _check_pairs(visible: Flags, pairs: Sequence[tuple[int, int]]) -> None:
    """Raise DataError if none of the frame pairs has enough tracks in common."""
    if not any(visible[:, pair].all(axis=1).sum() >= MIN_SHARED_TRACKS for pair in pairs):
        raise DataError(
            f"no frame pair has {MIN_SHARED_TRACKS} tracks in common; "
            "use longer tracks (match.min_length) or more corners"
        )


def _draw_set(
    model: MotionModel,
    points: Floats,
    shared: Integers,
    neighbours: Integers,
    frames: tuple[int, ...],
    count: int,
    rng: np.random.Generator,
) -> HypothesisSet:
    """Sample ``count`` elemental subsets of the tracks ``shared``; invalid ones are dropped."""
    tracks = points[shared][:, frames]
    normalization = model.normalization(tracks)
    observed = model.observe(tracks, normalization)
    subsets = draw_subsets(
        neighbours[:, : model.sampling_neighbours], model.subset_size, count, rng
    )
    found, valid = model.minimal_fit(observed[subsets])
    return HypothesisSet(
        model=model.name,
        manifold=model.manifold.name,
        frames=frames,
        normalization=normalization,
        subsets=shared[subsets[valid]],
        points=found[valid],
        drawn=count,
    )


def draw_subsets(neighbours: Integers, size: int, count: int, rng: np.random.Generator) -> Integers:
    """Sample subsets [count, size] of distinct tracks: a seed and neighbours, or uniformly."""
    tracks, near = neighbours.shape
    local = round(LOCAL_SHARE * count) if near >= size - 1 else 0
    seeds = rng.integers(tracks, size=local)
    order = rng.random((local, near)).argsort(axis=1)[:, : size - 1]
    others = np.take_along_axis(neighbours[seeds], order, axis=1)
    uniform = rng.random((count - local, tracks)).argpartition(size - 1, axis=1)[:, :size]
    return np.concatenate([np.concatenate([seeds[:, None], others], axis=1), uniform])


def _pair_neighbours(matches: Floats) -> Integers:
    """Nearest neighbours by position and displacement, of ``matches`` [n, 2, 2]."""
    displacement = matches[:, 1] - matches[:, 0]
    space = np.stack([matches[:, 0], DISPLACEMENT_WEIGHT * displacement], axis=1)
    return nearest_neighbours(space, STORED_NEIGHBOURS)


def _even_pairs(frames: int, gap: int, count: int) -> list[tuple[int, int]]:
    """At most ``count`` frame pairs with the same ``gap``, evenly spaced."""
    starts = np.unique(np.linspace(0, frames - 1 - gap, count).round().astype(int))
    return [(int(start), int(start) + gap) for start in starts]


def _short_pairs(frames: int, lengths: Integers) -> list[tuple[int, int]]:
    """Pairs with ``SHORT_GAPS``, or multiples of them for long tracks."""
    gaps = [gap * max(1, int(_median_length(lengths) // REFERENCE_LENGTH)) for gap in SHORT_GAPS]
    return [
        pair for gap in gaps if gap < frames for pair in _even_pairs(frames, gap, PAIRS_PER_GAP)
    ]


def _long_pairs(frames: int, lengths: Integers) -> list[tuple[int, int]]:
    """Pairs with ``LONG_GAPS``."""
    gaps = {min(max(1, round(share * _median_length(lengths))), frames - 1) for share in LONG_GAPS}
    return [pair for gap in sorted(gaps) for pair in _even_pairs(frames, gap, PAIRS_PER_GAP)]


def _median_length(lengths: Integers) -> float:
    """Median number of frames in which a track is visible."""
    return float(np.median(lengths[lengths > 0])) if (lengths > 0).any() else 0.0
