"""``mssegment import``."""

from __future__ import annotations

import time

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    console_options,
    files,
    output_option,
    refuse_keyboard,
    settings_options,
)
from mssegment.configuration import Setting, resolve
from mssegment.documents import STANDARD
from mssegment.errors import UsageError

KEYS = ("input.images",)


@click.command(
    short_help=COMMANDS["import"],
    epilog="Example:  mssegment import tracks.csv | mssegment hypothesize --model affine",
)
@click.argument("file", metavar="[FILE]", required=False, default=STANDARD, shell_complete=files)
@settings_options(*KEYS)
@click.option(
    "--points",
    is_flag=True,
    help="FILE is data that is no picture: a table of numbers, a point cloud, matched 3-D points.",
)
@output_option
@console_options
def command(
    file: str, settings: list[Setting], points: bool, output: str | None, console: Console
) -> None:
    """Import the tracks of another program and write a tracks document.

    FILE is a table (`x1,y1,x2,y2[,label]` or `track,frame,x,y[,label]`, in pixels, under many other
    names of the columns), an array [tracks, frames, 2] (.npy, .npz, .mat, HDF5, JSON), matches of
    LightGlue, hloc or COLMAP, boxes of MOTChallenge, or a file of Hopkins155, AdelaideRMF or
    KT3DMoSeg. The content determines the format; FILE#PART names a part of a file. Without FILE, or
    if it is -, standard input is read. --images names the pictures that the tracks were made from.

    With --points, FILE is a table with one point in each row (`x,y,z[,label]`, or any columns of
    numbers), matched points (`x1,y1,z1,x2,y2,z2[,label]`), an array [points, d], XYZ, PLY or PCD.
    """
    refuse_keyboard(file, "file of tracks", "cat tracks.csv")
    configuration = resolve(settings)
    if points and configuration.input.images:
        raise UsageError("--points: data that is no picture goes without --images")
    start = time.perf_counter()
    from mssegment import pipeline

    if points:
        document = pipeline.import_points(file)
    else:
        source = pipeline.open_input(configuration) if configuration.input.images else None
        document = pipeline.import_tracks(file, source)
    console.deliver(document, output, start, "import")
