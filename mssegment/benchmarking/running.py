"""Run the pipeline on every sequence of a data set."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from mssegment.benchmarking.cases import (
    Case,
    Motions,
    Options,
    add_outliers,
    load,
    single_groups_of,
)
from mssegment.benchmarking.results import SequenceResult
from mssegment.configuration import Configuration, Setting, resolve
from mssegment.datasets import DATASETS, ImportedTracks
from mssegment.datasets.base import Benchmark
from mssegment.errors import UsageError
from mssegment.evaluation import misclassification
from mssegment.records import Floats, Integers, Tracks

_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


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
    cases = single_groups_of(dataset, files) if single_groups else [Case(path) for path in files]
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
    return seeds * (len(single_groups_of(dataset, files)) if single_groups else len(files))


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
    entry = load(options.benchmark, case)
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
