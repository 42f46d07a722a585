"""``mssegment benchmark``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, complete_assignment, console_options, put
from mssegment.configuration import from_environment, from_text
from mssegment.registry import DATASETS

if TYPE_CHECKING:
    from mssegment.benchmarking import SequenceResult

DATA_SETS = sorted(name for name, entry in DATASETS.items() if entry.benchmark)


@click.command(
    short_help=COMMANDS["benchmark"],
    epilog="Example:  mssegment benchmark hopkins155 Hopkins155 --motions given --seeds 3",
)
@click.argument("dataset", type=click.Choice(DATA_SETS))
@click.argument("folder", metavar="FOLDER")
@click.option(
    "--motions",
    type=click.Choice(["auto", "given"]),
    default="auto",
    show_default=True,
    help="auto: estimate the number of motions; given: use the true number.",
)
@click.option(
    "--min-motions",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="Minimum number of motions.",
)
@click.option(
    "--from-pixels",
    is_flag=True,
    help="Detect and match in the images, and label the published matches by the motions found.",
)
@click.option(
    "--outliers",
    type=click.FloatRange(0, 10),
    default=0.0,
    show_default=True,
    metavar="FRACTION",
    help="Number of outlier tracks to add, as a fraction of the number of tracks.",
)
@click.option(
    "--single-groups", is_flag=True, help="Run each true group alone, as a scene with one motion."
)
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=3,
    show_default=True,
    help="Number of runs per sequence, with the seeds 0, 1, ...",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of parallel processes; the results do not depend on it.",
)
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set any key; repeatable.",
    shell_complete=complete_assignment,
)
@console_options
def command(
    dataset: str,
    folder: str,
    motions: str,
    min_motions: int,
    from_pixels: bool,
    outliers: float,
    single_groups: bool,
    seeds: int,
    jobs: int,
    assignments: tuple[str, ...],
    console: Console,
) -> None:
    """Segment every sequence of a public data set and compare the result with its labels.

    FOLDER holds the files of the data set as published. The error is the misclassification, 1 -
    correct / counted: a track is correct if its motion is matched to its true motion by the best
    one-to-one matching, or if it is a true outlier labelled as an outlier. The labels are removed
    before the segmentation, and the tracks are shuffled with each seed.
    """
    from mssegment import benchmarking

    results: list[SequenceResult] = []
    running = benchmarking.run_benchmark(
        dataset,
        folder,
        motions="given" if motions == "given" else "auto",
        seeds=seeds,
        jobs=jobs,
        settings=[*from_environment(), *from_text(assignments)],
        outliers=outliers,
        min_motions=min_motions,
        single_groups=single_groups,
        from_pixels=from_pixels,
    )
    total = benchmarking.number_of_results(dataset, folder, seeds, single_groups)
    try:
        # one by one, so that an interruption keeps the results so far
        results.extend(_watched(running, total, console))
    except KeyboardInterrupt:
        _write(dataset, results, console)
        console.note(f"interrupted after {len(results)} of {total} results")
        raise
    _write(dataset, results, console)


def _watched(
    running: Iterator[SequenceResult], total: int, console: Console
) -> Iterator[SequenceResult]:
    """The results, with a progress bar on a terminal."""
    with console.progress("benchmark", total) as advance:
        for result in running:
            advance(result.name)
            yield result


def _write(dataset: str, results: list[SequenceResult], console: Console) -> None:
    from mssegment.cli.benchmark_tables import benchmark_json, benchmark_text

    write = benchmark_json if console.json else benchmark_text
    put(write(dataset, results))
