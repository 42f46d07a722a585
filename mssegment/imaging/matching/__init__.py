"""Matchers: each makes tracks out of the corners of two or more frames.

A new matcher is one module with a function ``match(pictures, corners, *, ...) -> Tracks``, whose
keyword-only parameters are its options, a ``Matcher`` in ``known`` that describes it, and one line
in ``MATCHERS``. Other packages register a ``Matcher`` as an entry point of the group
``mssegment.matchers``. Importing this package loads neither OpenCV nor any matcher.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mssegment.errors import ConfigurationError, UsageError
from mssegment.imaging.matching.base import Matcher
from mssegment.records import Corners, Tracks
from mssegment.registry import Registry

if TYPE_CHECKING:
    from mssegment.imaging.pictures import GreyPicture

__all__ = ["MATCHERS", "Matcher", "default_matcher", "match"]

MATCHERS: Registry[Matcher] = Registry(
    "matcher",
    {
        "affine": f"{__name__}.known:AFFINE",
        "patches": f"{__name__}.known:PATCHES",
        "flow": f"{__name__}.known:FLOW",
    },
    "mssegment.matchers",
)
"""The matchers by name, the value of ``match.method``."""


def default_matcher(frames: int) -> str:
    """Name of the matcher that ``auto`` selects for ``frames`` >= 2 frames.

    Examples
    --------
    >>> default_matcher(2), default_matcher(30)
    ('affine', 'flow')
    """
    return next(matcher.name for matcher in MATCHERS.values() if matcher.is_default_for(frames))


def match(
    pictures: Sequence[GreyPicture],
    corners: Sequence[Corners],
    method: str = "auto",
    **options: Any,
) -> Tracks:
    """Match the corners of two views, or track them through a sequence.

    Parameters
    ----------
    pictures : sequence of float32 array [height, width]
        Two or more grey pictures of one size.
    corners : sequence of Corners
        The corners of each picture.
    method : str
        A name in ``MATCHERS``; ``auto`` selects the default for the number of pictures.
    **options
        Options of the matcher, see ``Matcher.options``.

    Returns
    -------
    Tracks
        Positions [P, F, 2] in pixels, NaN where a track is not visible.

    Raises
    ------
    UsageError
        If there is no matcher of that name, or it does not take that number of pictures.
    ConfigurationError
        If the matcher does not accept one of the options.
    """
    frames = len(pictures)
    if frames < 2 or len(corners) != frames:
        raise UsageError(
            f"match: {frames} pictures and corners of {len(corners)}, expected two or more "
            "pictures and the corners of each"
        )
    name = default_matcher(frames) if method == "auto" else method
    if name not in MATCHERS:
        raise UsageError(f"match.method {name!r}: expected auto, {', '.join(MATCHERS)}")
    matcher = MATCHERS[name]
    if matcher.max_frames is not None and frames > matcher.max_frames:
        raise UsageError(
            f"match.method {name}: {frames} frames, expected at most {matcher.max_frames}; "
            f"use {default_matcher(frames)}"
        )
    for option in sorted(options.keys() - set(matcher.options)):
        raise ConfigurationError(_not_accepted(option, name))
    from mssegment.imaging.threads import threads_for

    with threads_for(frames):
        return matcher.function(pictures, corners, **options)


def _not_accepted(option: str, name: str) -> str:
    """The error for an option that the matcher ``name`` does not have."""
    others = [other for other, matcher in MATCHERS.items() if option in matcher.options]
    advice = f", or use match.method {' or '.join(others)}" if others else ""
    return f"match.{option}: the matcher {name} has no such option; leave it at auto{advice}"
