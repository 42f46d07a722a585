"""The picture in a terminal."""

from __future__ import annotations

import os
import sys

from mssegment.errors import UsageError
from mssegment.rendering.report import Report


def show(report: Report) -> None:
    """Show the motions in the terminal; raises UsageError if it cannot display pictures."""
    from mssegment.rendering.pictures import scenes_of
    from mssegment.rendering.raster import paint
    from mssegment.rendering.terminal import protocol_of, show

    protocol = protocol_of(os.environ)
    if protocol is None or not sys.stdout.isatty():
        raise UsageError(
            "--show: this terminal cannot display pictures; use --out DIR to write them"
        )
    for _, scene in scenes_of(report, ["side-by-side"]):
        sys.stdout.buffer.write(show(paint(scene), protocol))
    sys.stdout.flush()
