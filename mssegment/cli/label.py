"""``mssegment label``."""

from __future__ import annotations

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, files, settings_options
from mssegment.configuration import Setting, resolve
from mssegment.errors import UsageError

KEYS = ("input.start", "input.stop", "input.step")


@click.command(
    short_help=COMMANDS["label"],
    epilog="Example:  mssegment label 1.png 2.png --out labels",
)
@click.argument(
    "images", nargs=-1, metavar="IMAGE... | FOLDER | GLOB | VIDEO", shell_complete=files
)
@settings_options(*KEYS)
@click.option(
    "--out",
    default="mssegment-labels",
    show_default=True,
    metavar="DIR",
    help="Folder for the masks; polygons saved there earlier are loaded.",
)
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=0,
    show_default=True,
    help="Port of the page; 0 chooses a free one.",
)
@console_options
def command(
    images: tuple[str, ...], settings: list[Setting], out: str, port: int, console: Console
) -> None:
    """Label motions by hand by drawing polygons on the frames in a local web page.

    The page is served to this machine only, until you press Ctrl-C. Saving writes one mask per
    labelled frame, for `mssegment report --labels`.
    """
    if not images:
        raise UsageError("no images given; name image files, a folder, a glob pattern or a video")
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
            ready=lambda url: click.echo(f"{url}  (press Ctrl-C to stop)"),
            saved=lambda names: console.note(f"saved {', '.join(names)} in {out}"),
            trouble=console.note,
        )
    except KeyboardInterrupt:
        # Ctrl-C is the normal way to stop the server, not an interruption
        console.note(
            f"saved masks are in {out}; use them with "
            f"`mssegment report SEGMENTATION --labels '{out}/mask-*.png'`"
        )
