"""The hypotheses that consensus reads: several sets, on frame pairs and on whole tracks.

Where most tracks are complete: planar patches between frame pairs, and subspaces over all frames.
Where tracks begin and end anywhere: homographies and fundamental matrices between frame pairs, each
with the tracks that both of its frames see. Before a camera that stands still: affine motions
between frames far apart. Nothing is invented where a track is not seen.
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
from mssegment.records import (
    Floats,
    Hypotheses,
    HypothesisSet,
    Integers,
    Partition,
    replace,
)
from mssegment.sampling.neighbourhoods import nearest_neighbours, some_of
from mssegment.sampling.validation import first_test, two_frame_misfit

MOST_GROUPED = 2000
"""Tracks that make hypotheses and are grouped; the cost of grouping grows with their square."""
COMPLETE = 0.75
"""From this share of complete tracks on, whole tracks are evidence too."""
PAIRS = 12
"""Frame pairs of complete tracks, evenly spaced."""
GAP = 0.1
"""Gap of a pair of complete tracks, as a share of the frames."""
GAPS, PAIRS_PER_GAP = (1, 2, 4), 6
"""The same for tracks that begin and end anywhere: short, or too few tracks are in both."""
LENGTH = 14
"""These gaps suit tracks of so many frames; tracks twice as long allow twice the gaps."""
LONG_GAPS = (1 / 8, 1 / 4, 1 / 2)
"""Gaps before a static camera, as shares of the frames that the typical track is seen in: the
longest tells objects apart, the others are for shorter tracks."""
PER_PAIR = 200
"""Hypotheses per frame pair and kind."""
PER_LONG_PAIR = 400
"""The same before a static camera: a small object must be the seed of some."""
SPANNING = 1e-6
"""Least singular value of an elemental subset of whole tracks, over the largest: tracks only rank
these hypotheses, so that a poorly conditioned one does no harm."""
WHOLE = 1000
"""Hypotheses over all frames."""
WHOLE_BESIDE = 300
"""The same of a rank that is no evidence: they tell the density about a motion."""
LOCAL = 0.7
"""Share of the subsets that are a seed and its neighbours; the others are drawn anywhere."""
NEIGHBOURS = 24
MOTION_WEIGHT = 3.0
"""Weight of the displacement against the place, when neighbours are sought between two frames."""
FEWEST = 10
"""Tracks that a frame pair must have in common."""


def draw_for_consensus(
    points: Floats,
    rng: np.random.Generator,
    *,
    eligible: Flags | None = None,
    static: bool = False,
    rank: int | Literal["auto"] = "auto",
) -> Hypotheses:
    """Hypotheses for the tracks ``points`` [P, F, 2] (pixels, NaN: not visible).

    ``eligible`` [P] excludes tracks (background); ``static`` says that the camera stands still and
    the background is excluded. ``rank`` (3 planar, 4 general) is that of the subspaces over all
    frames; ``auto`` draws general ones as evidence and some planar ones to tell which motions are
    planar. Raises DataError for fewer than two frames, or where no two frames
    share FEWEST tracks.
    """
    frames = points.shape[1]
    if frames < 2:
        raise DataError(f"consensus needs at least 2 frames, the tracks have {frames}")
    seen = np.asarray(np.isfinite(points).all(axis=2))
    if eligible is not None:
        seen = seen & eligible[:, None]
    seen = seen & some_of(np.asarray(seen.any(axis=1)), MOST_GROUPED, rng)[:, None]
    lengths = seen.sum(axis=1)
    complete = seen.all(axis=1)
    partition: Partition
    if static:
        pairs, partition = _long_pairs(frames, lengths), "average_linkage"
        sets = _draw_pairs(points, seen, (Affine(),), pairs, PER_LONG_PAIR, rng)
    elif complete.sum() >= max(COMPLETE * seen.any(axis=1).sum(), FEWEST):
        ranks, partition = (4, 3) if rank == "auto" else (rank,), "spectral"
        sets = _draw_complete(points, seen, ranks, rng)
    else:
        pairs, partition = _short_pairs(frames, lengths), "normalized_cuts"
        kinds = (Homography(), Fundamental())
        sets = _draw_pairs(points, seen, kinds, pairs, PER_PAIR, rng)
    return Hypotheses("consensus", tuple(sets), partition)


def _draw_complete(
    points: Floats, seen: Flags, ranks: tuple[int, ...], rng: np.random.Generator
) -> list[HypothesisSet]:
    frames = points.shape[1]
    complete = np.flatnonzero(seen.all(axis=1))
    near = nearest_neighbours(points[complete], NEIGHBOURS)
    sets = []
    for pair in _even_pairs(frames, max(1, round(GAP * frames)), PAIRS):
        shared = np.flatnonzero(seen[:, pair].all(axis=1))
        around = near if len(shared) == len(complete) else _pair_neighbours(points[shared][:, pair])
        sets.append(_draw_set(Flat(), points, shared, around, pair, PER_PAIR, rng))
    if frames < 3:
        stated = _draw_set(Affine(), points, complete, near, (0, 1), WHOLE_BESIDE, rng)
        return [*sets, replace(stated, evidence=False)]
    trusted = complete[first_test(points[complete], two_frame_misfit(points, sets)[complete])]
    near = nearest_neighbours(points[trusted], NEIGHBOURS)
    every = tuple(range(frames))
    for place, rank in enumerate(ranks):
        model = Factorization(frames, rank, SPANNING)
        count = WHOLE_BESIDE if place else WHOLE
        drawn = _draw_set(model, points, trusted, near, every, count, rng)
        sets.append(replace(drawn, evidence=place == 0))
    return sets


def _draw_pairs(
    points: Floats,
    seen: Flags,
    kinds: Sequence[MotionModel],
    pairs: list[tuple[int, int]],
    count: int,
    rng: np.random.Generator,
) -> list[HypothesisSet]:
    sets = []
    for pair in pairs:
        shared = np.flatnonzero(seen[:, pair].all(axis=1))
        if len(shared) < FEWEST:
            continue
        near = _pair_neighbours(points[shared][:, pair])
        sets += [_draw_set(model, points, shared, near, pair, count, rng) for model in kinds]
    if not sets:
        raise DataError(
            f"none of the frame pairs that were looked at share {FEWEST} tracks; "
            "give longer tracks (match.min_length), or more corners"
        )
    return sets


def _draw_set(
    model: MotionModel,
    points: Floats,
    shared: Integers,
    neighbours: Integers,
    frames: tuple[int, ...],
    count: int,
    rng: np.random.Generator,
) -> HypothesisSet:
    """``count`` elemental subsets of the tracks ``shared``; unsound ones are left out."""
    tracks = points[shared][:, frames]
    normalization = model.normalization(tracks)
    observed = model.observe(tracks, normalization)
    subsets = draw_subsets(neighbours[:, : model.sampling_neighbours], model.subset_size, count, rng)
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
    """Subsets [count, size] of distinct tracks: mostly a seed and neighbours, the rest anywhere."""
    tracks, near = neighbours.shape
    local = round(LOCAL * count) if near >= size - 1 else 0
    seeds = rng.integers(tracks, size=local)
    places = rng.random((local, near)).argsort(axis=1)[:, : size - 1]
    around = np.take_along_axis(neighbours[seeds], places, axis=1)
    anywhere = rng.random((count - local, tracks)).argpartition(size - 1, axis=1)[:, :size]
    return np.concatenate([np.concatenate([seeds[:, None], around], axis=1), anywhere])


def _pair_neighbours(matches: Floats) -> Integers:
    """Nearest tracks by place and displacement between two frames, ``matches`` [n, 2, 2]."""
    moved = matches[:, 1] - matches[:, 0]
    space = np.stack([matches[:, 0], MOTION_WEIGHT * moved], axis=1)
    return nearest_neighbours(space, NEIGHBOURS)


def _even_pairs(frames: int, gap: int, count: int) -> list[tuple[int, int]]:
    starts = np.unique(np.linspace(0, frames - 1 - gap, count).round().astype(int))
    return [(int(start), int(start) + gap) for start in starts]


def _short_pairs(frames: int, lengths: Integers) -> list[tuple[int, int]]:
    """Pairs with the GAPS, or multiples of them where the typical track is long."""
    gaps = [gap * max(1, int(_usual(lengths) // LENGTH)) for gap in GAPS]
    return [
        pair for gap in gaps if gap < frames for pair in _even_pairs(frames, gap, PAIRS_PER_GAP)
    ]


def _long_pairs(frames: int, lengths: Integers) -> list[tuple[int, int]]:
    """Pairs with the LONG_GAPS."""
    gaps = {min(max(1, round(share * _usual(lengths))), frames - 1) for share in LONG_GAPS}
    return [pair for gap in sorted(gaps) for pair in _even_pairs(frames, gap, PAIRS_PER_GAP)]


def _usual(lengths: Integers) -> float:
    """In how many frames the typical track is seen."""
    return float(np.median(lengths[lengths > 0])) if (lengths > 0).any() else 0.0
