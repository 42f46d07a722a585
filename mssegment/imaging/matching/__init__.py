"""Matchers: each makes tracks out of the corners of two or more pictures.

A matcher is one file with a function ``match(pictures, corners, **options) -> Tracks`` and one
line in ``MATCHERS``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mssegment.errors import UsageError
from mssegment.imaging.matching import affine, klt, patches
from mssegment.imaging.pictures import Grey
from mssegment.imaging.threads import threads_for
from mssegment.records import Corners, Tracks

Matcher = Callable[..., Tracks]
"""A function ``(pictures, corners, **options)`` from grey pictures and corners to tracks."""

MATCHERS: dict[str, Matcher] = {
    "affine": affine.match,
    "patches": patches.match,
    "flow": klt.match,
}
"""Name (``match.method``) -> matcher."""


def default_matcher(frames: int) -> str:
    """The matcher for a number of frames: two views may lie far apart, a sequence does not."""
    return "affine" if frames == 2 else "flow"


def match(
    pictures: Sequence[Grey],
    corners: Sequence[Corners],
    method: str = "auto",
    **options: Any,
) -> Tracks:
    """Match with the matcher called ``method``; ``auto`` is the default for the number of frames.

    Raises ``UsageError`` for a method that is not there.
    """
    name = default_matcher(len(pictures)) if method == "auto" else method
    if name not in MATCHERS:
        raise UsageError(f"match method {name!r}: expected auto, {', '.join(MATCHERS)}")
    with threads_for(len(pictures)):
        return MATCHERS[name](pictures, corners, **options)
