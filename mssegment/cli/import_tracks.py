"""``mssegment import``."""

from __future__ import annotations

import time

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Voice, output_option, refuse_keyboard, voice_options
from mssegment.documents import STANDARD


@click.command(
    short_help=COMMANDS["import"],
    epilog="Example:  mssegment import tracks.csv | mssegment hypothesize --model affine",
)
@click.argument("file", metavar="[FILE]", required=False, default=STANDARD)
@output_option
@voice_options
def command(file: str, output: str | None, voice: Voice) -> None:
    """Read tracks that another program made, and write a tracks document.

    FILE is a CSV (`x1,y1,x2,y2[,label]` or `track,frame,x,y[,label]`, pixels), or a .mat of
    Hopkins155, AdelaideRMF or KT3DMoSeg; the content decides. Labels and camera come along where
    the file has them. No FILE or - is a CSV on standard input.
    """
    refuse_keyboard(file, "CSV of tracks", "cat tracks.csv")
    start = time.perf_counter()
    from mssegment.pipeline import import_tracks

    document = import_tracks(file)
    voice.deliver(document, output, start, "import")
