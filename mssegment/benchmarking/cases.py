"""The sequences that a benchmark runs, as published or disturbed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from mssegment.benchmarking.disturbance import resampled, shuffled_in_time, uniform_mismatches
from mssegment.configuration import Setting
from mssegment.datasets import DATASETS, ImportedTracks
from mssegment.datasets.base import DataSet
from mssegment.records import Floats, Integers, Record, Tracks, replace

Motions = Literal["auto", "given"]

SMALLEST_SINGLE_GROUP = 13
"""Minimum number of tracks of a true group that is run as a sequence of its own."""
_SUBSET = re.compile(r"_g\d\d$")


class Options(Record, frozen=True):
    """The options of a benchmark, the same for every sequence; see ``run_benchmark``."""

    benchmark: str
    motions: Motions
    settings: tuple[Setting, ...]
    outliers: float
    min_motions: int
    from_pixels: bool
    others: tuple[Path, ...]
    """Files whose tracks are used as outliers in other sequences."""


class Case(Record, frozen=True):
    """One sequence to run: a file, or a single true group of it."""

    path: Path
    single_group: int | None = None


def single_groups_of(dataset: str, files: Sequence[Path]) -> list[Case]:
    """Each true group alone; sequences that are subsets of another one would repeat its groups."""
    scenes = {path.stem for path in files}
    cases = []
    for path in files:
        stem = path.stem.removesuffix("_truth")
        whole = _SUBSET.sub("", stem)
        if whole != stem and f"{whole}_truth" in scenes:
            continue
        labels = read_entry(dataset, path).tracks.labels
        if labels is not None:
            names, sizes = np.unique(labels[labels > 0], return_counts=True)
            cases += [Case(path, int(name)) for name in names[sizes >= SMALLEST_SINGLE_GROUP]]
    return cases


def load(dataset: str, case: Case) -> ImportedTracks:
    """The sequence of a case, with one true group only where the case says so."""
    entry = read_entry(dataset, case.path)
    labels = entry.tracks.labels
    if case.single_group is None or labels is None:
        return entry
    own = labels == case.single_group
    tracks = Tracks(entry.tracks.points[own], labels=np.ones(int(own.sum()), dtype=np.int64))
    return replace(
        entry, name=f"{entry.name}#{case.single_group}", given=tracks, group="single groups"
    )


def add_outliers(
    points: Floats, labels: Integers, options: Options, case: Case, rng: np.random.Generator
) -> tuple[Floats, Integers]:
    """Append ``options.outliers`` times as many outlier tracks, with label 0.

    Parameters
    ----------
    points : ndarray [P, F, 2] of float64
        The tracks in pixels.
    labels : ndarray [P] of int64
        Their true labels.
    options : Options
        The options of the benchmark.
    case : Case
        The sequence; tracks of other scenes are used as outliers.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    points : ndarray [P + n, F, 2] of float64
    labels : ndarray [P + n] of int64
    """
    count = round(options.outliers * len(points))
    if not count:
        return points, labels
    if points.shape[1] == 2:
        added = uniform_mismatches(points, count, rng)
    else:
        foreign = (count + 1) // 2
        added = np.concatenate(
            [
                _foreign_tracks(points, foreign, options, case, rng),
                shuffled_in_time(points, count - foreign, rng),
            ]
        )
    zeros = np.zeros(len(added), dtype=np.int64)
    return np.concatenate([points, added]), np.concatenate([labels, zeros])


def _foreign_tracks(
    points: Floats, count: int, options: Options, case: Case, rng: np.random.Generator
) -> Floats:
    """Complete tracks of other scenes, resampled to the same number of frames."""
    own = _scene(case.path)
    others = [path for path in options.others if _scene(path) != own]
    if not others:
        return shuffled_in_time(points, count, rng)
    found: list[Floats] = []
    while len(found) < count:
        path = others[int(rng.integers(len(others)))]
        tracks = read_entry(options.benchmark, path).tracks.points
        complete = np.flatnonzero(np.isfinite(tracks).all(axis=(1, 2)))
        if len(complete):
            track = tracks[complete[int(rng.integers(len(complete)))]]
            found.append(resampled(track[None], points.shape[1])[0])
    return np.stack(found)


@lru_cache(maxsize=200)
def read_entry(dataset: str, path: Path) -> ImportedTracks:
    """One file of a data set; the last ones read are kept."""
    entry: DataSet = DATASETS[dataset]
    return entry.read(path)


def _scene(path: Path) -> str:
    return _SUBSET.sub("", path.stem.removesuffix("_truth"))
