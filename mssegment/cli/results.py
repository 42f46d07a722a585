"""The folder of the results, and the picture in a terminal."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
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


RECORD = "timings.json"
"""The file of a run that lists the files which it wrote."""


def recorded_files(out: str) -> list[str]:
    """The files that an earlier run wrote into the folder ``out``, by its own record."""
    import msgspec

    try:
        content = msgspec.json.decode((Path(out) / RECORD).read_bytes())
        names = content["files"]
    except (OSError, KeyError, TypeError, msgspec.MsgspecError):
        return []
    paths = [Path(name) for name in names if isinstance(name, str)]
    return [str(path) for path in paths if not path.is_absolute() and ".." not in path.parts]


def remove_stale(out: str, earlier: Iterable[str], kept: Iterable[str]) -> None:
    """Remove the files of an earlier run from ``out``, but none of ``kept``, by their real paths.

    What cannot be removed stays.
    """
    stay = {os.path.realpath(path) for path in kept}
    for name in earlier:
        path = Path(out) / name
        if os.path.realpath(path) not in stay:
            with suppress(OSError):
                path.unlink(missing_ok=True)


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
