"""``mssegment hypothesize``."""

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
from mssegment.documents import TracksDocument

KEYS = (
    "hypothesize.model",
    "hypothesize.rank",
    "hypothesize.count",
    "hypothesize.sampling",
    "cluster.method",
    "segment.selection",
    "background.remove",
    "background.min_displacement",
    "camera.file",
    "camera.derotate",
    "seed",
)


@click.command(
    short_help=COMMANDS["hypothesize"],
    epilog="Example:  mssegment hypothesize --model affine tracks.json -o hypotheses.json",
)
@document_argument("tracks")
@settings_options(*KEYS)
@output_option
@console_options
def command(document: str, settings: list[Setting], output: str | None, console: Console) -> None:
    """Draw elemental subsets of the tracks and fit a motion hypothesis to each.

    Reads a tracks document and writes a hypotheses document; each hypothesis is a point on the
    manifold of the motion model. If the camera is static, the static tracks are removed first, as
    background. A hypothesis is kept if further tracks near its subset agree with it.
    """
    configuration = resolve(settings)
    tracks = read_argument(document, TracksDocument)
    start = time.perf_counter()
    from mssegment import pipeline
    from mssegment.resources import keep_freed_memory

    keep_freed_memory()

    with console.working("hypothesize"):
        hypotheses = pipeline.hypothesize(tracks, configuration)
    console.deliver(hypotheses, output, start)
