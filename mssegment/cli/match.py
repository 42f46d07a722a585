"""``mssegment match``."""

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
from mssegment.documents import CornersDocument

KEYS = ("match.method", "match.min_length")


@click.command(
    short_help=COMMANDS["match"],
    epilog="Example:  mssegment detect 1.png 2.png | mssegment match -o tracks.json",
)
@document_argument("corners")
@settings_options(*KEYS)
@output_option
@console_options
def command(document: str, settings: list[Setting], output: str | None, console: Console) -> None:
    """Match corners between two views, or track them through a sequence.

    Reads a corners document and the images that it refers to, and writes a tracks document.
    """
    configuration = resolve(settings)
    corners = read_argument(document, CornersDocument)
    start = time.perf_counter()
    from mssegment import pipeline
    from mssegment.resources import keep_freed_memory

    keep_freed_memory()

    with console.working("match"):
        tracks = pipeline.match(corners, configuration)
    console.deliver(tracks, output, start)
