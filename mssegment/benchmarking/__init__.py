"""Benchmarks on published data sets: every sequence through the pipeline, judged afterwards.

Misclassification is that of ``evaluation``: 1 - right / counted. The true labels are taken off the
tracks before the pipeline sees them, and the order of the tracks is drawn anew for every seed.
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

from mssegment.benchmarking.catalogue import BENCHMARKS, Benchmark, Published
from mssegment.benchmarking.disturbance import resampled, shuffled_in_time, uniform_mismatches
from mssegment.configuration import Configuration, Setting, resolve
from mssegment.datasets import DATASETS, ImportedTracks
from mssegment.errors import UsageError
from mssegment.evaluation import misclassification
from mssegment.records import Floats, Integers, Record, Tracks, replace

__all__ = [
    "BENCHMARKS",
    "Benchmark",
    "Case",
    "GroupSummary",
    "Options",
    "Published",
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
"""Tracks of a true group below which it is no sequence of its own."""
_SUBSET = re.compile(r"_g\d\d$")
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


class SequenceResult(Record, frozen=True):
    """One sequence under one seed: ``error`` is a fraction, ``seconds`` those of the pipeline."""

    name: str
    group: str
    error: float
    motions_true: int
    motions_found: int
    seconds: float
    seed: int


class GroupSummary(Record, frozen=True):
    """Over the results of a group: ``mean`` over all, ``median`` over the sequences' means."""

    sequences: int
    mean: float
    median: float
    count_right: float
    seconds: float


class Options(Record, frozen=True):
    """How to run: what ``run_benchmark`` is told, the same for every sequence."""

    benchmark: str
    motions: Motions
    settings: tuple[Setting, ...]
    outliers: float
    min_motions: int
    from_pixels: bool
    others: tuple[Path, ...]
    """Files whose tracks serve as foreign outliers."""


class Case(Record, frozen=True):
    """One sequence to run: a file, or one true group of it alone."""

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
    """Results one by one, sequence after sequence, each with the seeds 0 .. ``seeds`` - 1.

    ``motions`` "given" tells the pipeline the true number of motions. ``outliers`` adds that share
    of outlier tracks: over many frames half from another sequence and half shuffled in time, in
    image pairs uniform mismatches. ``single_groups`` runs each true group alone, as a sequence
    with one motion. ``from_pixels`` detects and matches in the pictures that come with the tracks,
    and labels the published tracks by the motions found. ``jobs`` processes work at a time; the
    results do not depend on it.

    Raises UsageError for an unknown data set or senseless numbers, DataError for a folder without
    the files of the data set or a broken file.
    """
    if dataset not in BENCHMARKS:
        raise UsageError(f"benchmark {dataset!r} is unknown; choose {', '.join(BENCHMARKS)}")
    if seeds < 1 or jobs < 1 or min_motions < 0 or not 0 <= outliers <= 10:
        raise UsageError("seeds and jobs are at least 1, min_motions 0, outliers between 0 and 10")
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
    """How many results ``run_benchmark`` will give, for a progress bar."""
    files = DATASETS[dataset].files(Path(folder))
    return seeds * (len(_single_groups(dataset, files)) if single_groups else len(files))


def summarise(results: Iterable[SequenceResult]) -> dict[str, GroupSummary]:
    """Group name -> summary, in alphabetical order, the group ``all`` last."""
    everything = list(results)
    names = sorted({result.group for result in everything})
    groups = {name: [r for r in everything if r.group == name] for name in names}
    if everything:
        groups["all"] = everything
    return {name: _summary(members) for name, members in groups.items()}


def run_case(case: Case, seed: int, options: Options) -> SequenceResult:
    """One sequence under one seed."""
    # the pipeline loads every room: workers and help texts should not wait for that
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
    """Labels of the published tracks ``points`` under the motions found in the pictures."""
    from mssegment.imaging.frames import frames_in_memory
    from mssegment.pipeline import run
    from mssegment.segmentation.assignment import assign

    if not entry.pictures:
        raise UsageError(f"{entry.name}: --from-pixels needs pictures, and its file has none")
    source = frames_in_memory(entry.frames, [picture[..., ::-1] for picture in entry.pictures])
    found = run(configuration, source=source).segmentation
    return assign(points, found.sets, found.segmentation)


def add_outliers(
    points: Floats, labels: Integers, options: Options, case: Case, rng: np.random.Generator
) -> tuple[Floats, Integers]:
    """The tracks with ``options.outliers`` x as many outlier tracks behind them, label 0."""
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
    """Complete tracks of other sequences (not of the same scene), over as many frames."""
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
    """Each true group alone; subsets of a sequence that is there itself only repeat its groups."""
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
    return DATASETS[dataset].read(path)


def _scene(path: Path) -> str:
    return _SUBSET.sub("", path.stem.removesuffix("_truth"))


def _configuration(
    entry: ImportedTracks, options: Options, true_motions: int, seed: int
) -> Configuration:
    """Defaults of the benchmark, of the group, then what the user set."""
    benchmark = BENCHMARKS[options.benchmark]
    values: dict[str, object] = {"seed": seed, **benchmark.settings}
    values |= benchmark.by_group.get(entry.group, {})
    if options.min_motions:
        values["segment.min_motions"] = options.min_motions
    if options.motions == "given":
        values["segment.motions"] = true_motions
    own = [Setting(key, value, f"benchmark {benchmark.dataset}") for key, value in values.items()]
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
    """As ``_in_turn``; the processes are fresh ones, so that one BLAS thread each takes effect."""
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
