"""``mssegment fuse``."""

from __future__ import annotations

import time

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    chosen_format,
    console_options,
    files,
    format_option,
    output_option,
    refuse_keyboard,
)
from mssegment.documents import STANDARD, read_bytes, write_bytes
from mssegment.errors import UsageError


@click.command(
    short_help=COMMANDS["fuse"],
    epilog="Example:  mssegment fuse poses.txt --manifold se3",
)
@click.argument("poses", metavar="[POSES]", required=False, default=STANDARD, shell_complete=files)
@click.option(
    "--manifold",
    default="se3",
    show_default=True,
    metavar="NAME",
    help="Manifold of the measurements: se3, so3, se2, sphere, spd, euclidean, ...",
)
@click.option(
    "--bandwidth",
    default="auto",
    show_default=True,
    metavar="NUMBER|auto",
    help="Bandwidth of mean shift, in the distance of the manifold.",
)
@click.option(
    "--length-scale",
    default="auto",
    show_default=True,
    metavar="NUMBER|auto",
    help="Translation that counts as much as a rotation by one radian.",
)
@click.option(
    "--min-share",
    default=0.05,
    show_default=True,
    type=click.FloatRange(0.0, 1.0),
    help="Smallest support of a mode, as a share of the measurements.",
)
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0), help="Random seed.")
@output_option
@format_option
@console_options
def command(
    poses: str,
    manifold: str,
    bandwidth: str,
    length_scale: str,
    min_share: float,
    seed: int,
    output: str | None,
    form: str | None,
    console: Console,
) -> None:
    """Fuse repeated measurements, of which many may be wrong, by the modes of their density.

    POSES is a trajectory of TUM (time, position, quaternion) or KITTI (3 x 4 matrices), a table, a
    NumPy file or JSON; one measurement per row. Writes each value that measurements agree on, with
    its support, and the spread of one measurement; as JSON also covariances and labels. A column
    `weight` weighs the measurements. Without POSES, or if it is -, standard input is read.
    """
    refuse_keyboard(poses, "file of poses", "cat poses.txt")
    width, scale = _number(bandwidth, "--bandwidth"), _number(length_scale, "--length-scale")
    start = time.perf_counter()
    from mssegment.datasets.poses import read_measurements
    from mssegment.manifolds import MANIFOLDS, from_name
    from mssegment.meanshift.fusion import fuse
    from mssegment.rendering.fusion import format_fusion

    shape = None if manifold in MANIFOLDS else from_name(manifold).point_shape
    found = read_measurements(read_bytes(poses), poses, shape)
    fusion = fuse(
        found.points,
        manifold,
        found.weights,
        bandwidth=width,
        length_scale=scale,
        min_share=min_share,
        random_state=seed,
    )
    text = format_fusion(fusion, chosen_format(form, console))
    write_bytes(output or STANDARD, text.encode())
    supported = sum(len(mode.support) for mode in fusion.modes)
    sentence = (
        f"{len(found.points)} measurements, {len(fusion.modes)} modes, {supported} in support"
    )
    console.stage("fuse", sentence, time.perf_counter() - start)
    chance = "" if fusion.modes else "no measurements agree by more than chance"
    for note in (found.assumed, _correction(fusion.corrected), chance):
        if note:
            console.note(note)


def _number(text: str, flag: str) -> float | str:
    """The number of an option, or ``auto``."""
    if text == "auto":
        return text
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise UsageError(f"{flag} {text}: expected a positive number or auto")
    return value


def _correction(violation: float) -> str:
    """What was corrected, unless it is rounding in double precision."""
    return f"projected: up to {violation:.1g} away from the manifold" if violation > 1e-9 else ""
