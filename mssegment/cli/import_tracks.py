"""``mssegment import``."""

from __future__ import annotations

import time

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, output_option, refuse_keyboard
from mssegment.documents import STANDARD


@click.command(
    short_help=COMMANDS["import"],
    epilog="Example:  mssegment import tracks.csv | mssegment hypothesize --model affine",
)
@click.argument("file", metavar="[FILE]", required=False, default=STANDARD)
@output_option
@console_options
def command(file: str, output: str | None, console: Console) -> None:
    """Import the tracks of another program and write a tracks document.

    FILE is a CSV with the columns `x1,y1,x2,y2[,label]` or `track,frame,x,y[,label]`, in pixels, or
    a .mat file of Hopkins155, AdelaideRMF or KT3DMoSeg; the format is determined from the content.
    Labels are imported if the file has them. Without FILE, or if it is -, a CSV is read from
    standard input.
    """
    refuse_keyboard(file, "CSV of tracks", "cat tracks.csv")
    start = time.perf_counter()
    from mssegment.pipeline import import_tracks

    document = import_tracks(file)
    console.deliver(document, output, start, "import")
