"""Benchmarks on published data sets: run the pipeline on every sequence and evaluate the result.

The error is the misclassification defined in ``evaluation``. The true labels are removed before the
pipeline sees the tracks, and the tracks are shuffled with each seed.
"""

from __future__ import annotations

import multiprocessing
import os
import re
import time
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from mssegment.benchmarking.disturbance import resampled, shuffled_in_time, uniform_mismatches
from mssegment.configuration import Configuration, Setting, resolve
from mssegment.datasets import DATASETS, ImportedTracks
from mssegment.datasets.base import Benchmark, DataSet
from mssegment.errors import UsageError
from mssegment.evaluation import misclassification
from mssegment.records import Floats, Integers, Record, Tracks, replace

__all__ = [
    "Case",
    "GroupSummary",
    "Options",
    "SequenceResult",
    "number_of_results",
    "resampled",
    "run_benchmark",
    "run_case",
    "shuffled_in_time",
    "summarise",
    "uniform_mismatches",
]

Motions = Literal["auto", "given"]

SMALLEST_SINGLE_GROUP = 13
"""Minimum number of tracks of a true group that is run as a sequence of its own."""
_SUBSET = re.compile(r"_g\d\d$")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class SequenceResult(Record, frozen=True):
    """The result of one sequence with one seed.

    Attributes
    ----------
    name, group : str
        The sequence and the part of the data set it belongs to.
    error : float
        The misclassification, 0 to 1.
    motions_true, motions_found : int
        The true and the found number of motions.
    seconds : float
        Wall-clock time of the pipeline, without reading the file.
    seed : int
        The seed.
    """

    name: str
    group: str
    error: float
    motions_true: int
    motions_found: int
    seconds: float
    seed: int


class GroupSummary(Record, frozen=True):
    """Statistics over the results of a group of sequences.

    Attributes
    ----------
    sequences : int
        The number of sequences.
    mean : float
        The mean error over all results, 0 to 1.
    median : float
        The median over the sequences of their mean error.
    count_right : float
        The fraction of results with the true number of motions.
    seconds : float
        The mean time of a result.
    """

    sequences: int
    mean: float
    median: float
    count_right: float
    seconds: float


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


def run_benchmark(
    dataset: str,
    folder: Path | str,
    *,
    motions: Motions = "auto",
    seeds: int = 3,
    jobs: int = 1,
    settings: Sequence[Setting] = (),
    outliers: float = 0.0,
    min_motions: int = 0,
    single_groups: bool = False,
    from_pixels: bool = False,
) -> Iterator[SequenceResult]:
    """Run the pipeline on every sequence of a data set.

    Parameters
    ----------
    dataset : str
        A name in ``DATASETS`` with a benchmark.
    folder : Path or str
        The folder with the files of the data set as published.
    motions : {"auto", "given"}
        Whether the pipeline estimates the number of motions or is given the true one.
    seeds : int
        Number of runs per sequence, with the seeds 0 .. ``seeds`` - 1.
    jobs : int
        Number of parallel processes; the results do not depend on it.
    settings : sequence of Setting
        Settings that override those of the benchmark.
    outliers : float
        Number of outlier tracks to add, as a fraction of the number of tracks, 0 to 10. In image
        pairs they are uniform mismatches; in longer sequences one half are tracks of other
        sequences and the other half are tracks shuffled in time.
    min_motions : int
        Minimum number of motions.
    single_groups : bool
        Run each true group alone, as a sequence with one motion.
    from_pixels : bool
        Detect and match in the images that come with the tracks, and label the published tracks by
        the motions found.

    Returns
    -------
    iterator of SequenceResult
        One per sequence and seed, in order, each as soon as it is computed.

    Raises
    ------
    UsageError
        If the data set is unknown or a number is out of range.
    DataError
        If the folder has no files of the data set, or a file is damaged.
    """
    known = [name for name, entry in DATASETS.items() if entry.benchmark]
    if dataset not in known:
        raise UsageError(f"unknown benchmark {dataset!r}; expected one of {', '.join(known)}")
    if seeds < 1 or jobs < 1 or min_motions < 0 or not 0 <= outliers <= 10:
        raise UsageError(
            f"found seeds {seeds}, jobs {jobs}, min_motions {min_motions}, outliers {outliers:g}; "
            "expected seeds and jobs at least 1, min_motions at least 0, outliers from 0 to 10"
        )
    files = DATASETS[dataset].files(Path(folder))
    cases = _single_groups(dataset, files) if single_groups else [Case(path) for path in files]
    options = Options(
        dataset,
        motions,
        tuple(settings),
        outliers,
        min_motions,
        from_pixels,
        tuple(files) if outliers else (),
    )
    work = [(case, seed, options) for case in cases for seed in range(seeds)]
    return _in_turn(work) if jobs == 1 else _in_processes(work, jobs)


def number_of_results(
    dataset: str, folder: Path | str, seeds: int = 3, single_groups: bool = False
) -> int:
    """The number of results that ``run_benchmark`` yields, for a progress bar."""
    files = DATASETS[dataset].files(Path(folder))
    return seeds * (len(_single_groups(dataset, files)) if single_groups else len(files))


def summarise(results: Iterable[SequenceResult]) -> dict[str, GroupSummary]:
    """Summarize results by group.

    Parameters
    ----------
    results : iterable of SequenceResult

    Returns
    -------
    dict of str to GroupSummary
        The groups in alphabetical order, then ``all``; empty without results.
    """
    everything = list(results)
    names = sorted({result.group for result in everything})
    groups = {name: [r for r in everything if r.group == name] for name in names}
    if everything:
        groups["all"] = everything
    return {name: _summary(members) for name, members in groups.items()}


def run_case(case: Case, seed: int, options: Options) -> SequenceResult:
    """Run one sequence with one seed.

    Parameters
    ----------
    case : Case
        The sequence.
    seed : int
        Seed of the pipeline, of the order of the tracks, and of added outliers.
    options : Options
        The options of the benchmark.

    Returns
    -------
    SequenceResult

    Raises
    ------
    DataError
        If the file is damaged, or has too few tracks for the motion model.
    UsageError
        If images are needed and the file has none.
    """
    # imported late, because the pipeline imports every package
    from mssegment.documents import TracksDocument
    from mssegment.pipeline import cluster, hypothesize

    rng = np.random.default_rng([seed, 155])
    entry = _load(options.benchmark, case)
    points, labels = entry.tracks.points, entry.tracks.labels
    if labels is None:
        labels = np.zeros(len(points), dtype=np.int64)
    points, labels = add_outliers(points, labels, options, case, rng)
    order = rng.permutation(len(points))
    points, labels = points[order], labels[order]
    true = len(np.unique(labels[labels > 0]))
    configuration = _configuration(entry, options, true, seed)
    start = time.perf_counter()
    if options.from_pixels:
        found = _labels_from_pixels(entry, configuration, points)
    else:
        document = TracksDocument(
            frames=list(entry.frames), camera=entry.camera, tracks=Tracks(points)
        )
        found = cluster(hypothesize(document, configuration), configuration).labels
    seconds = time.perf_counter() - start
    return SequenceResult(
        name=entry.name,
        group=entry.group,
        error=misclassification(found, labels),
        motions_true=true,
        motions_found=len(np.unique(found[found > 0])),
        seconds=seconds,
        seed=seed,
    )


def _labels_from_pixels(
    entry: ImportedTracks, configuration: Configuration, points: Floats
) -> Integers:
    """Labels [P] of the published tracks ``points`` by the motions found in the images."""
    from mssegment.imaging.frames import frames_in_memory
    from mssegment.pipeline import run
    from mssegment.segmentation.assignment import assign

    if not entry.pictures:
        raise UsageError(f"{entry.name}: its file has no images, which --from-pixels needs")
    source = frames_in_memory(entry.frames, [picture[..., ::-1] for picture in entry.pictures])
    found = run(configuration, source=source).segmentation
    return assign(points, found.sets, found.segmentation)


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
        tracks = _read(options.benchmark, path).tracks.points
        complete = np.flatnonzero(np.isfinite(tracks).all(axis=(1, 2)))
        if len(complete):
            track = tracks[complete[int(rng.integers(len(complete)))]]
            found.append(resampled(track[None], points.shape[1])[0])
    return np.stack(found)


def _single_groups(dataset: str, files: Sequence[Path]) -> list[Case]:
    """Each true group alone; sequences that are subsets of another one would repeat its groups."""
    scenes = {path.stem for path in files}
    cases = []
    for path in files:
        stem = path.stem.removesuffix("_truth")
        whole = _SUBSET.sub("", stem)
        if whole != stem and f"{whole}_truth" in scenes:
            continue
        labels = _read(dataset, path).tracks.labels
        if labels is not None:
            names, sizes = np.unique(labels[labels > 0], return_counts=True)
            cases += [Case(path, int(name)) for name in names[sizes >= SMALLEST_SINGLE_GROUP]]
    return cases


def _load(dataset: str, case: Case) -> ImportedTracks:
    entry = _read(dataset, case.path)
    labels = entry.tracks.labels
    if case.single_group is None or labels is None:
        return entry
    own = labels == case.single_group
    tracks = Tracks(entry.tracks.points[own], labels=np.ones(int(own.sum()), dtype=np.int64))
    return replace(
        entry, name=f"{entry.name}#{case.single_group}", tracks=tracks, group="single groups"
    )


@lru_cache(maxsize=200)
def _read(dataset: str, path: Path) -> ImportedTracks:
    entry: DataSet = DATASETS[dataset]
    return entry.read(path)


def _scene(path: Path) -> str:
    return _SUBSET.sub("", path.stem.removesuffix("_truth"))


def _configuration(
    entry: ImportedTracks, options: Options, true_motions: int, seed: int
) -> Configuration:
    """The settings of the benchmark, overridden by those of the group, then by the user's."""
    benchmark: Benchmark = DATASETS[options.benchmark].benchmark
    values: dict[str, object] = {"seed": seed, **benchmark.settings}
    values |= benchmark.by_group.get(entry.group, {})
    if options.min_motions:
        values["segment.min_motions"] = options.min_motions
    if options.motions == "given":
        values["segment.motions"] = true_motions
    own = [Setting(key, value, f"benchmark {options.benchmark}") for key, value in values.items()]
    return resolve([*own, *options.settings])


def _summary(results: Sequence[SequenceResult]) -> GroupSummary:
    by_name: dict[str, list[float]] = {}
    for result in results:
        by_name.setdefault(result.name, []).append(result.error)
    return GroupSummary(
        sequences=len(by_name),
        mean=float(np.mean([result.error for result in results])),
        median=float(np.median([np.mean(errors) for errors in by_name.values()])),
        count_right=float(np.mean([r.motions_true == r.motions_found for r in results])),
        seconds=float(np.mean([result.seconds for result in results])),
    )


def _in_turn(work: Sequence[tuple[Case, int, Options]]) -> Iterator[SequenceResult]:
    for item in work:
        yield run_case(*item)


def _in_processes(work: Sequence[tuple[Case, int, Options]], jobs: int) -> Iterator[SequenceResult]:
    """As ``_in_turn``, in spawned processes, so that the limit of one BLAS thread takes effect."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"))
    try:
        for future in [pool.submit(run_case, *item) for item in work]:
            yield future.result()
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
