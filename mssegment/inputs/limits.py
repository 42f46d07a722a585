"""Sizes that are checked before anything is allocated: each with a name, and a setting to raise it.

A damaged or hostile file can state any size. The limits are far above those of real work; the
setting ``limits.NAME``, or the variable ``MSSEGMENT_LIMITS_NAME``, raises one of them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

from mssegment.errors import DataError, MssegmentError
from mssegment.records import Record


class Limit(Record, frozen=True):
    """A limit: its default, the unit that it counts, and what it bounds."""

    default: int
    unit: str
    description: str


LIMITS: dict[str, Limit] = {
    "file_bytes": Limit(
        1_000_000_000, "bytes", "Largest file that is read as a whole; videos are not."
    ),
    "text_bytes": Limit(
        200_000_000, "bytes", "Largest table, JSON or XML file of another program."
    ),
    "unpacked_bytes": Limit(
        500_000_000, "bytes", "Largest content of a compressed file of tracks (.mat, .npz, HDF5)."
    ),
    "picture_pixels": Limit(
        128_000_000, "pixels", "Largest picture; detection needs about 12 bytes per pixel."
    ),
    "stack_pixels": Limit(
        500_000_000, "pixels", "All pictures of one animation or stack (GIF, WebP, PNG, TIFF)."
    ),
    "positions": Limit(
        50_000_000, "positions", "Tracks times frames of a file of tracks, 16 bytes each."
    ),
    "text_length": Limit(
        10_000, "characters", "Longest text in a document: a path, an identifier or a note."
    ),
    "yaml_values": Limit(
        100_000, "values", "Values in a YAML file, counted after its aliases are expanded."
    ),
    "polygon_vertices": Limit(
        200_000, "vertices", "Vertices of all polygons that the labelling page saves."
    ),
}
"""Every limit by name. They bound memory to about 1 GB, and are no tuning constants."""

_raised: ContextVar[Mapping[str, int] | None] = ContextVar("raised", default=None)


def limit(name: str) -> int:
    """The value of a limit: as set with ``using``, by its variable, or the default."""
    found = (_raised.get() or {}).get(name)
    if found is not None:
        return found
    text = os.environ.get(variable_of(name), "")
    # a value that is no number is reported with the other settings
    return int(text) if text.isascii() and text.isdecimal() else LIMITS[name].default


def variable_of(name: str) -> str:
    """The environment variable that sets a limit."""
    return f"MSSEGMENT_LIMITS_{name.upper()}"


@contextmanager
def using(values: Mapping[str, int]) -> Iterator[None]:
    """Set limits for the duration of a block, in this thread."""
    token = _raised.set({**(_raised.get() or {}), **values})
    try:
        yield
    finally:
        _raised.reset(token)


def check(name: str, found: int, where: str, error: type[MssegmentError] = DataError) -> None:
    """Raises ``error`` if ``found`` exceeds the limit; ``where`` opens the message.

    Examples
    --------
    >>> check("picture_pixels", 640 * 480, "frame.png")
    """
    if found > limit(name):
        raise error(exceeded(name, found, where))


def exceeded(name: str, found: int | None, where: str) -> str:
    """The message for a size above a limit; ``found`` is None where it is not known."""
    unit = LIMITS[name].unit
    size = f"more {unit} than" if found is None else f"{found:,} {unit}, more than"
    return (
        f"{where}: {size} the limit of {limit(name):,} (limits.{name}); if that is right, set "
        f"{variable_of(name)} to a larger number"
    )
