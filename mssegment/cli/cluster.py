"""``mssegment cluster``."""

from __future__ import annotations

import time

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    console_options,
    document_argument,
    output_option,
    read_argument,
    settings_options,
)
from mssegment.configuration import Setting, resolve
from mssegment.documents import STANDARD, HypothesesDocument
from mssegment.errors import DataError

KEYS = (
    "cluster.method",
    "cluster.bandwidth",
    "cluster.kernel",
    "segment.selection",
    "segment.motions",
    "segment.min_motions",
    "segment.granularity",
    "segment.camera_motion",
    "seed",
)


@click.command(
    short_help=COMMANDS["cluster"],
    epilog="Example:  mssegment cluster hypotheses.json -o segmentation.json",
)
@document_argument("hypotheses")
@settings_options(*KEYS)
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of threads; the result does not depend on it.",
)
@output_option
@console_options
def command(
    document: str, settings: list[Setting], threads: int, output: str | None, console: Console
) -> None:
    """Find the modes of the hypotheses by mean shift and select the motions.

    Reads a hypotheses document and writes a segmentation document: each mode with its number of
    hypotheses and its kernel density, each motion with its parameters and inliers, and one label
    per track.
    """
    resolve(settings)  # reports an invalid option before anything is read
    hypotheses = read_argument(document, HypothesesDocument)
    _check(hypotheses, document)
    start = time.perf_counter()
    from mssegment import pipeline
    from mssegment.history import inherited
    from mssegment.resources import keep_freed_memory

    keep_freed_memory()

    configuration = resolve([*inherited(hypotheses), *settings])
    with console.working("cluster"):
        segmentation = pipeline.cluster(hypotheses, configuration, threads)
    console.deliver(segmentation, output, start)


def _check(hypotheses: HypothesesDocument, document: str) -> None:
    """Raises DataError, naming the document, if a set does not fit its model."""
    from mssegment.stage_checks import check_sets

    try:
        check_sets(hypotheses.sets)
    except DataError as error:
        name = "standard input" if document == STANDARD else document
        raise DataError(f"{name}: {error}") from None
