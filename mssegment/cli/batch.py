"""``mssegment batch``."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    chosen_format,
    complete_assignment,
    console_options,
    files,
    format_option,
    put,
    settings_options,
)
from mssegment.configuration import Setting, from_file, from_text
from mssegment.errors import ExitStatus, UsageError
from mssegment.inputs.text import printable

if TYPE_CHECKING:
    from mssegment.batch import Result

LONGEST_ERROR = 300
"""Characters of an error in the table; summary.json has all."""
KEYS = ("hypothesize.model", "segment.motions", "report.masks", "report.export", "seed")


@click.command(
    short_help=COMMANDS["batch"],
    epilog="Example:  mssegment batch pairs.csv --config config.yaml --out results",
)
@click.argument(
    "inputs",
    nargs=-1,
    required=True,
    metavar="MANIFEST | GLOB | FOLDER",
    shell_complete=files,
)
@click.option(
    "--config",
    metavar="FILE",
    shell_complete=files,
    help="Configuration of all items; a row of the manifest may override it.",
)
@settings_options(*KEYS)
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set any key for all items; repeatable.",
    shell_complete=complete_assignment,
)
@click.option(
    "--out",
    default="mssegment-batch",
    show_default=True,
    metavar="DIR",
    help="Folder for the ledger, the index, and a folder of each item.",
)
@click.option(
    "--jobs",
    type=click.IntRange(min=1),
    metavar="N",
    help="Number of processes.  [default: the number of processors]",
)
@click.option(
    "--scheduler",
    metavar="ADDRESS",
    help="Use the workers of a Dask scheduler, tcp://HOST:8786, or of a Dask cluster on this "
    "machine, local; needs mssegment[dask].",
)
@click.option(
    "--ship",
    is_flag=True,
    help="With --scheduler: send the files to the workers and fetch the results, where they share "
    "no disk with this machine.",
)
@click.option(
    "--retry-failed", is_flag=True, help="Try again what failed before, also if nothing changed."
)
@click.option(
    "--keep-going/--fail-fast",
    default=True,
    show_default=True,
    help="Do the other items if one fails, or stop.",
)
@format_option
@console_options
def command(
    inputs: tuple[str, ...],
    config: str | None,
    settings: list[Setting],
    assignments: tuple[str, ...],
    out: str,
    jobs: int | None,
    scheduler: str | None,
    ship: bool,
    retry_failed: bool,
    keep_going: bool,
    form: str | None,
    console: Console,
) -> int:
    """Segment many pairs, clips or files of tracks, each into a folder of its own.

    A manifest (CSV, TSV, YAML or JSON Lines) has a row for each item, with any keys of the
    configuration, such as `images`, `tracks`, `name` or `segment.motions`. A folder stands for the
    videos, files of tracks and folders of pictures in it. The same command again does only what is
    missing or has changed. The exit status is 4 if an item failed.
    """
    _check_scheduler(scheduler, ship)
    from mssegment.batch import Batch, items_of
    from mssegment.batch.pools import dask_pool, local_pool
    from mssegment.batch.summary import sentence, write_summary
    from mssegment.resources import processors

    options = [setting for setting in settings if setting.origin.startswith("--")]
    environment = [setting for setting in settings if not setting.origin.startswith("--")]
    below = [*(from_file(config) if config else []), *environment]
    items = items_of(inputs, below, [*options, *from_text(assignments)])
    cores = processors()
    jobs = jobs or min(cores, max(1, len(items)))
    batch = Batch(items, out, retry_failed, fail_fast=not keep_going)
    width = max(12, *(len(item.name) for item in items))

    ended: list[str] = []

    def show(result: Result) -> None:
        ended.append(result.item.name)
        if not console.quiet:
            print(f"{result.item.name:<{width}} {_sentence(result)}", file=sys.stderr)

    with batch.opened() as ledger:
        pools = local_pool(jobs, max(1, cores // jobs)) if scheduler is None else None
        with pools or dask_pool(scheduler or "", jobs, ship) as pool, console.working("batch"):
            try:
                results = batch.run(ledger, pool, show)
            except KeyboardInterrupt:
                console.note(f"{len(ended)} of {len(items)} items; the same command goes on")
                raise
        write_summary(results, out)
    _put(results, chosen_format(form, console))
    if not console.quiet:
        print(f"{sentence(results)}; index in {os.path.join(out, 'index.html')}", file=sys.stderr)
    if any(result.has_failed for result in results):
        _print_failures(results)
        return ExitStatus.DATA
    return ExitStatus.DONE


def _check_scheduler(scheduler: str | None, ship: bool) -> None:
    """Raises UsageError for what is no address, and for --ship without one."""
    if scheduler is None and ship:
        raise UsageError("--ship: it goes with --scheduler; processes of this machine read files")
    if scheduler is not None and scheduler != "local" and "://" not in scheduler:
        raise UsageError(f"--scheduler {scheduler}: expected tcp://HOST:PORT, or local")


def _sentence(result: Result) -> str:
    """What became of an item, in one line."""
    facts = result.facts
    if facts is None:
        return f"{result.state}: {printable(result.error, LONGEST_ERROR)}"
    count = len(facts.motions)
    found = f"{count or 'no'} motion{'s' * (count != 1)} in {facts.tracks} tracks"
    time = f"{result.seconds:.2f} s" if result.seconds else result.state
    return f"{found:<44} {time:>8}"


def _put(results: list[Result], form: str) -> None:
    from mssegment.batch.summary import summary_bytes, summary_table
    from mssegment.rendering.tables import format_table

    if form == "json":
        put(summary_bytes(results).decode())
    else:
        put(format_table(summary_table(results), form))


def _print_failures(results: list[Result]) -> None:
    failed = [result for result in results if result.has_failed]
    width = max(len(result.item.name) for result in failed)
    print(f"mssegment: {len(failed)} of {len(results)} items failed", file=sys.stderr)
    for result in failed:
        print(
            f"  {result.item.name:<{width}}  {printable(result.error, LONGEST_ERROR)}",
            file=sys.stderr,
        )
