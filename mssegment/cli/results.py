"""The folder of the results, and the picture in a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from mssegment.errors import UsageError
from mssegment.rendering.report import Report


@contextmanager
def claimed_folder(out: str, force: bool) -> Iterator[None]:
    """Create the folder for the results; remove it if the block fails and it is new and empty.

    Raises UsageError if the folder is not empty and ``force`` is not set, or cannot be written.
    """
    is_new = not Path(out).exists()
    try:
        _claim(out, force)
        yield
    except BaseException:
        if is_new:
            with suppress(OSError):  # not empty: complete files are kept
                Path(out).rmdir()
        raise


def _claim(out: str, force: bool) -> None:
    folder = Path(out)
    if folder.is_file():
        raise UsageError(f"{out}: this is a file; expected a folder for --out")
    if folder.is_dir() and any(folder.iterdir()) and not force:
        raise UsageError(
            f"{out}: this folder is not empty; use --force to write into it, or --out to name "
            "another"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".mssegment"
        try:
            probe.touch()
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(
            f"{out}: cannot be written ({error.strerror}); choose another folder"
        ) from None


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
