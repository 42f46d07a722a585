"""``mssegment detect``."""

from __future__ import annotations

import time

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, files, output_option, settings_options
from mssegment.configuration import Setting, resolve
from mssegment.errors import UsageError

KEYS = (
    "input.start",
    "input.stop",
    "input.step",
    "detect.levels",
    "detect.max_corners",
    "detect.quality",
    "detect.min_distance",
)


@click.command(
    short_help=COMMANDS["detect"],
    epilog="Example:  mssegment detect 1.png 2.png -o corners.json",
)
@click.argument(
    "images", nargs=-1, metavar="IMAGE... | FOLDER | GLOB | VIDEO", shell_complete=files
)
@settings_options(*KEYS)
@output_option
@console_options
def command(
    images: tuple[str, ...], settings: list[Setting], output: str | None, console: Console
) -> None:
    """Detect Harris corners in images (8 or 16 bit, grey or colour) or in a video.

    Writes a corners document.
    """
    if not images:
        raise UsageError("no images given; name two images, a folder, a glob pattern or a video")
    start = time.perf_counter()
    from mssegment import pipeline
    from mssegment.resources import keep_freed_memory

    keep_freed_memory()

    configuration = resolve([*settings, Setting("input.images", list(images), "IMAGE")])
    with console.working("detect"):
        document = pipeline.detect(configuration, pipeline.open_input(configuration))
    console.deliver(document, output, start)
