"""Which inputs are long clips, to be segmented in windows. Light: every run asks."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import msgspec

from mssegment.configuration import Configuration
from mssegment.errors import ConfigurationError
from mssegment.imaging.streams import Clip, long_clip
from mssegment.pipeline import check_settings
from mssegment.sequences.lifetimes import ONE_WINDOW, WindowLimits
from mssegment.version import __version__

EXPORTS = ("tracks", "objects", "mot")
"""The values of ``report.export`` that clips in windows have."""


def limits_of(configuration: Configuration) -> WindowLimits:
    """How long windows are, by the settings."""
    window, overlap = configuration.sequence.window, configuration.sequence.overlap
    return WindowLimits("auto" if window == "none" else window, overlap)


def clip_of(configuration: Configuration) -> Clip | None:
    """The clip of a configuration, if it is to be segmented in windows.

    Raises DataError if the input cannot be read, ConfigurationError for a setting of the results
    that needs all frames at once, or a window of tracks.
    """
    read, window = configuration.input, configuration.sequence.window
    if read.tracks is not None and not isinstance(window, str):
        raise ConfigurationError(
            f"sequence.window is {window}, but tracks of another program are segmented over all "
            "frames at once; leave it at auto"
        )
    if window == "none" or read.tracks is not None:
        return None
    limits = limits_of(configuration)
    longest = ONE_WINDOW if limits.length == "auto" else limits.length
    clip = long_clip(read.images, read.start, read.stop, read.step, longest)
    if clip is not None:
        _check(configuration)
    return clip


def _check(configuration: Configuration) -> None:
    """Raise an error for settings that a clip in windows does not have."""
    settings = configuration.report
    for key, given in (
        ("report.masks", settings.masks),
        ("report.regions", settings.regions),
        ("report.labels", bool(settings.labels)),
    ):
        if given:
            raise ConfigurationError(
                f"{key} is set, but a clip of more than {ONE_WINDOW} frames is segmented in "
                "windows, which have none; choose fewer frames (input.start, input.stop, "
                "input.step), or set sequence.window to none"
            )
    _check_exports(settings.export)
    if configuration.match.method not in ("auto", "flow"):
        raise ConfigurationError(
            f"match.method is {configuration.match.method}; expected flow for a clip"
        )
    check_settings(configuration, ONE_WINDOW)


def key_of(clip: Clip, configuration: Configuration) -> str:
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
