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
    """Read tracks that another program made, and write a tracks document.

    FILE is a CSV (`x1,y1,x2,y2[,label]` or `track,frame,x,y[,label]`, pixels), or a .mat of
    Hopkins155, AdelaideRMF or KT3DMoSeg; the content decides. Labels and camera come along where
    the file has them. No FILE or - is a CSV on standard input.
    """
    refuse_keyboard(file, "CSV of tracks", "cat tracks.csv")
    start = time.perf_counter()
    from mssegment.pipeline import import_tracks

    document = import_tracks(file)
    console.deliver(document, output, start, "import")
