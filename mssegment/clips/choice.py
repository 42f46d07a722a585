"""Which inputs are long clips, to be segmented in windows. Light: every run asks."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import TYPE_CHECKING

import msgspec

from mssegment.configuration import Configuration
from mssegment.documents import TracksDocument
from mssegment.errors import ConfigurationError
from mssegment.imaging.streams import Clip, long_clip
from mssegment.pipeline import check_settings
from mssegment.sequences.lifetimes import ONE_WINDOW, WindowLimits
from mssegment.version import __version__

if TYPE_CHECKING:
    from mssegment.clips.track_clip import TrackClip

EXPORTS = ("tracks", "objects", "mot")
"""The values of ``report.export`` that clips in windows have."""


def limits_of(configuration: Configuration) -> WindowLimits:
    """How long windows are, by the settings."""
    window, overlap = configuration.sequence.window, configuration.sequence.overlap
    return WindowLimits("auto" if window == "none" else window, overlap)


def has_windows(frames: int, configuration: Configuration) -> bool:
    """Whether so many frames are segmented in windows, by the settings."""
    if configuration.sequence.window == "none":
        return False
    return not limits_of(configuration).is_one_window(frames)


def clip_of(
    configuration: Configuration, tracks: TracksDocument | TrackClip | None = None
) -> Clip | TrackClip | None:
    """The clip of a configuration, if it is to be segmented in windows.

    Parameters
    ----------
    configuration : Configuration
        The settings.
    tracks : TracksDocument or TrackClip, optional
        The tracks of ``input.tracks``, as from ``runs.open_tracks``.

    Raises DataError if the input cannot be read, ConfigurationError for a setting of the results
    that needs all frames at once.
    """
    clip: Clip | TrackClip | None
    if tracks is not None:
        clip = None if isinstance(tracks, TracksDocument) else tracks
    elif configuration.sequence.window == "none":
        return None
    else:
        read, longest = configuration.input, longest_window(configuration)
        clip = long_clip(read.images, read.start, read.stop, read.step, longest)
    if clip is not None:
        _check(configuration, of_pixels=tracks is None)
    return clip


def _check(configuration: Configuration, of_pixels: bool) -> None:
    """Raise an error for settings that a clip in windows does not have."""
    settings = configuration.report
    fewer = (
        "choose fewer frames (input.start, input.stop, input.step), or set sequence.window to none"
        if of_pixels
        else "set sequence.window to none"
    )
    for key, given in (
        ("report.masks", settings.masks),
        ("report.regions", settings.regions),
        ("report.labels", bool(settings.labels)),
    ):
        if given:
            raise ConfigurationError(
                f"{key} is set, but a clip of more than {longest_window(configuration)} frames is "
                f"segmented in windows, which have none; {fewer}"
            )
    _check_exports(settings.export)
    if of_pixels and configuration.match.method not in ("auto", "flow"):
        raise ConfigurationError(
            f"match.method is {configuration.match.method}; expected flow for a clip"
        )
    check_settings(configuration, ONE_WINDOW)


def longest_window(configuration: Configuration) -> int:
    """Frames up to which a sequence is a single window, by the settings."""
    length = limits_of(configuration).length
    return ONE_WINDOW if length == "auto" else length


def key_of(clip: Clip | TrackClip, configuration: Configuration) -> str:
    """What the windows depend on: the frames, the settings and the version."""
    settings = msgspec.to_builtins(configuration)
    settings.pop("report")
    content = msgspec.json.encode([clip.sha256, settings, __version__], order="sorted")
    return hashlib.sha256(content).hexdigest()


def _check_exports(names: Sequence[str]) -> None:
    """Raises ConfigurationError for a format that long clips do not have."""
    for name in names:
        if name not in EXPORTS:
            raise ConfigurationError(
                f"report.export is {name}, but a clip in windows has no such file: its arrays are "
                f"in windows/*.npz; choose {', '.join(EXPORTS)}, or set sequence.window to none"
            )
