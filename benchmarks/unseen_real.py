"""Cases from the public data sets: as published, and changed."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.unseen_rows import Case, Outcome, Plan, outcome_of
from benchmarks.unseen_scenes import cut_tracks
from mssegment.benchmarking import resampled, shuffled_in_time
from mssegment.datasets import DATASETS, ImportedTracks
from mssegment.records import Integers

Change = Callable[[Case, np.random.Generator], Case]
"""Another case made from one of a data set."""
SEQUENCES = {"hypothesize.model": "factorization", "background.remove": False}
"""Settings of the published sequences: a background is one of the motions to be found."""
OBJECTS = {"segment.granularity": "object", "background.remove": False}
PLANES = {
    "hypothesize.model": "homography",
    "segment.granularity": "surface",
    "background.remove": False,
}
LEAST_MATCHES = 5
"""Matches of a motion below which the number of motions does not count it."""
LEAST_TRACKS = 13
"""Tracks of a group below which it is no sequence of its own."""
_SUBSET = re.compile(r"_g\d\d$")


@lru_cache(maxsize=8)
def entries(folder: Path, dataset: str) -> tuple[ImportedTracks, ...]:
    """The sequences or pairs of a data set below ``folder``."""
    data = DATASETS[dataset]
    return tuple(data.read(path) for path in data.files(folder))


def unchanged(case: Case, rng: np.random.Generator) -> Case:
    """The case as published."""
    del rng
    return case


def published(
    dataset: str,
    below: str,
    settings: Mapping[str, Any],
    change: Change = unchanged,
    *,
    given: bool = False,
    outliers: float = 0.0,
) -> Callable[[Plan], Iterator[Outcome]]:
    """The outcomes on every sequence of a data set in the folder ``below``, in random order.

    ``change`` makes another case of it; ``given`` tells the number of motions; ``outliers`` adds
    that share of the tracks as outliers, half from other scenes and half shuffled in time.
    """

    def outcomes(plan: Plan) -> Iterator[Outcome]:
        assert plan.folder is not None
        found = entries(plan.folder / below, dataset)
        for entry in found:
            for seed in plan.seeds:
                rng = np.random.default_rng([seed, 155])
                case = change(_case(entry, settings), rng)
                case = in_random_order(_with_outliers(case, outliers, found, rng), rng)
                if given:
                    true = len(np.unique(case.labels[case.labels > 0]))
                    told = {**case.settings, "segment.motions": true}
                    case = replace(case, settings=told)
                yield outcome_of(case, seed)

    return outcomes


def single_groups(below: str) -> Callable[[Plan], Iterator[Outcome]]:
    """The outcomes on each true group of Hopkins155 alone, with one motion."""

    def outcomes(plan: Plan) -> Iterator[Outcome]:
        assert plan.folder is not None
        found = entries(plan.folder / below, "hopkins155")
        names = {entry.name for entry in found}
        for entry in found:
            whole = _SUBSET.sub("", entry.name)
            if whole != entry.name and whole in names:
                continue  # a subset of a sequence repeats its groups
            case = _case(entry, SEQUENCES)
            for label, size in zip(*np.unique(case.labels, return_counts=True), strict=True):
                if size < LEAST_TRACKS:
                    continue
                own = case.points[case.labels == label]
                single = replace(case, points=own, labels=np.ones(len(own), dtype=np.int64))
                for seed in plan.seeds:
                    rng = np.random.default_rng([seed, 155])
                    yield outcome_of(in_random_order(single, rng), seed)

    return outcomes


def in_random_order(case: Case, rng: np.random.Generator) -> Case:
    """The same tracks in another order."""
    order = rng.permutation(len(case.points))
    return replace(case, points=case.points[order], labels=case.labels[order])


def in_frames(frames: Callable[[int], Integers]) -> Change:
    """The tracks in the frames that ``frames`` names for a number of frames."""

    def change(case: Case, rng: np.random.Generator) -> Case:
        del rng
        return replace(case, points=case.points[:, frames(case.points.shape[1])])

    return change


def first_frames(count: int) -> Change:
    """The first ``count`` frames."""
    return in_frames(lambda frames: np.arange(min(count, frames)))


def thinned_frames(count: int) -> Change:
    """So many frames at equal distances, the first and the last among them."""
    return in_frames(lambda frames: np.linspace(0, frames - 1, count).round().astype(np.int64))


def pair_of_frames(first: int, last: int) -> Change:
    """The matches between two frames, which are counted from 0 (or -1, -2 from the end).

    Motions of fewer than ``LEAST_MATCHES`` matches stay in the truth but need not be counted.
    """

    def change(case: Case, rng: np.random.Generator) -> Case:
        del rng
        points = case.points[:, [first, last]]
        seen = np.isfinite(points).all(axis=(1, 2))
        labels = case.labels[seen]
        sizes = np.unique(labels[labels > 0], return_counts=True)[1]
        counts = int((sizes >= LEAST_MATCHES).sum()), len(sizes)
        return replace(case, points=points[seen], labels=labels, counts=counts)

    return change


def cut_at_random(case: Case, rng: np.random.Generator) -> Case:
    """Each track keeps a random contiguous third to all of its frames."""
    return replace(case, points=cut_tracks(case.points, rng))


def half_of_the_matches(case: Case, rng: np.random.Generator) -> Case:
    """Half of the tracks."""
    kept = rng.permutation(len(case.points))[: len(case.points) // 2]
    return replace(case, points=case.points[kept], labels=case.labels[kept])


def with_noise(pixels: float) -> Change:
    """Normal noise of this standard deviation on every coordinate."""
    return lambda case, rng: replace(
        case, points=case.points + rng.normal(0, pixels, case.points.shape)
    )


def as_one_scene(case: Case, rng: np.random.Generator) -> Case:
    """All planes of a static scene are one rigid body."""
    del rng
    return replace(case, labels=np.minimum(case.labels, 1))


def _case(entry: ImportedTracks, settings: Mapping[str, Any]) -> Case:
    assert entry.tracks.labels is not None
    size = entry.frames[0].width, entry.frames[0].height
    return Case(entry.tracks.points, entry.tracks.labels, settings, size, name=entry.name)


def _with_outliers(
    case: Case, share: float, found: Sequence[ImportedTracks], rng: np.random.Generator
) -> Case:
    """So many outlier tracks in addition: half from other scenes, half shuffled in time."""
    count = round(share * len(case.points))
    scene = _SUBSET.sub("", case.name)
    others = [entry for entry in found if _SUBSET.sub("", entry.name) != scene]
    added = []
    for _ in range((count + 1) // 2):
        tracks = others[int(rng.integers(len(others)))].tracks.points
        track = tracks[[int(rng.integers(len(tracks)))]]
        added.append(resampled(track, case.points.shape[1]))
    added.append(shuffled_in_time(case.points, count - len(added), rng))
    points = np.concatenate([case.points, *added])
    labels = np.concatenate([case.labels, np.zeros(count, dtype=np.int64)])
    return replace(case, points=points, labels=labels)
