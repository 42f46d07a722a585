"""``mssegment label``."""

from __future__ import annotations

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, settings_options
from mssegment.configuration import Setting, resolve
from mssegment.errors import UsageError

KEYS = ("input.start", "input.stop", "input.step")


@click.command(
    short_help=COMMANDS["label"],
    epilog="Example:  mssegment label 1.png 2.png --out labels",
)
@click.argument("images", nargs=-1, metavar="IMAGE... | FOLDER | GLOB | VIDEO")
@settings_options(*KEYS)
@click.option(
    "--out",
    default="mssegment-labels",
    show_default=True,
    metavar="DIR",
    help="Folder of the masks; drawing goes on where it was left.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="Port on this machine; 0 takes any free one.",
)
@console_options
def command(
    images: tuple[str, ...], settings: list[Setting], out: str, port: int, console: Console
) -> None:
    """Label motions by hand: draw polygons over the frames in a local page.

    The page is served to this machine only, until Ctrl-C. Saving writes one mask per labelled
    frame, which `mssegment report --labels` reads.
    """
    if not images:
        raise UsageError("no pictures given; name pictures, a folder, a glob or a video")
    from mssegment.imaging.frames import open_frames
    from mssegment.labelling import serve

    read = resolve(settings).input
    source = open_frames(images, read.start, read.stop, read.step, at_least=1)
    try:
        serve(
            source.frames,
            lambda index: source.colour(index)[..., ::-1],
            out,
            port=port,
            ready=lambda url: click.echo(f"{url}  (Ctrl-C ends)"),
            saved=lambda names: console.note(f"{', '.join(names)} saved in {out}"),
        )
    except KeyboardInterrupt:
        # Ctrl-C is how one leaves the page, so it is no interruption
        console.note(f"the masks are in {out}: mssegment report ... --labels '{out}/mask-*.png'")
