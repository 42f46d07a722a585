"""``mssegment benchmark``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, put
from mssegment.configuration import from_environment, from_text

if TYPE_CHECKING:
    from mssegment.benchmarking import SequenceResult

DATA_SETS = ("adelaidermf", "hopkins155", "kt3dmoseg")


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
    help="Whether the number of motions is to be found, or given.",
)
@click.option(
    "--min-motions",
    type=click.IntRange(min=0),
    default=0,
    show_default=True,
    help="At least so many motions, where their number is to be found.",
)
@click.option(
    "--from-pixels",
    is_flag=True,
    help="Detect and match in the pictures; each labelled match is judged by the motions found.",
)
@click.option(
    "--outliers",
    type=click.FloatRange(0, 10),
    default=0.0,
    show_default=True,
    metavar="FRACTION",
    help="Add so many outlier tracks, as a share of the tracks.",
)
@click.option("--single-groups", is_flag=True, help="Each true group alone, with one motion.")
@click.option(
    "--seeds",
    type=click.IntRange(min=1),
    default=3,
    show_default=True,
    help="Runs of each sequence, with the seeds 0, 1, ...",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Processes at a time; the results do not depend on them.",
)
@click.option("--set", "assignments", multiple=True, metavar="KEY=VALUE", help="Set any key.")
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
    """Run a published data set and compare with its labels.

    FOLDER holds the files as they were published. Misclassification is 1 - right / counted: right
    are the tracks on the best one-to-one matching of found to true motions, plus true outliers
    found as outliers. The labels are taken off before the tracks are segmented, and their order is
    drawn anew for each seed.
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
        # one by one, so that an interruption leaves what is done
        results.extend(_watched(running, total, console))
    except KeyboardInterrupt:
        _write(dataset, results, console)
        console.note(f"interrupted: {len(results)} of {total} results are above")
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
