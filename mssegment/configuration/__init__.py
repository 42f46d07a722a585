"""config.yaml, the environment and the command line become one typed configuration.

Precedence: option > environment (``MSSEGMENT_CLUSTER_BANDWIDTH``) > config > default.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Iterable, Mapping
from typing import Any

import msgspec

from mssegment.configuration.settings import (
    KEYS,
    BackgroundSettings,
    CameraSettings,
    ClusterSettings,
    Configuration,
    DetectSettings,
    HypothesizeSettings,
    InputSettings,
    Key,
    MatchSettings,
    ReportSettings,
    SegmentSettings,
    Setting,
    check_key,
)
from mssegment.errors import ConfigurationError, UsageError
from mssegment.records import Camera

__all__ = [
    "KEYS",
    "BackgroundSettings",
    "CameraSettings",
    "ClusterSettings",
    "Configuration",
    "DetectSettings",
    "HypothesizeSettings",
    "InputSettings",
    "Key",
    "MatchSettings",
    "ReportSettings",
    "SegmentSettings",
    "Setting",
    "camera_of",
    "camera_settings",
    "from_environment",
    "from_file",
    "from_mapping",
    "from_options",
    "from_text",
    "resolve",
]

_WORDS = {
    form: value
    for value, words in ((True, "yes true on"), (False, "no false off"), (None, "null"))
    for word in words.split()
    for form in (word, word.capitalize(), word.upper())
}
"""The words that YAML 1.1 takes for something else than text."""
_INTRINSICS = ("fx", "fy", "cx", "cy")


def resolve(settings: Iterable[Setting]) -> Configuration:
    """The configuration of the settings; a later one overrides an earlier one of the same key.

    Raises the error of the first setting that is wrong, in one line.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        section, _, name = setting.key.rpartition(".")
        place = values.setdefault(section, {}) if section else values
        place[name] = _convert(setting)
    configuration = msgspec.convert(values, Configuration)
    _check_together(configuration)
    return configuration


def from_file(path: str) -> list[Setting]:
    """The settings in a YAML file, paths taken relative to its folder.

    Raises ConfigurationError, with line and column, for what is not YAML, or not a known key.
    """
    from mssegment.configuration.files import read_settings

    return read_settings(path)


def from_text(assignments: Iterable[str]) -> list[Setting]:
    """The settings of ``--set KEY=VALUE``; VALUE is YAML. Raises ConfigurationError."""
    settings = []
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals:
            raise ConfigurationError(f"--set {assignment}: KEY=VALUE was expected")
        origin = f"--set {assignment}"
        check_key(key.strip(), origin)
        settings.append(Setting(key.strip(), _value(value, origin), origin))
    return settings


def from_environment(environment: Mapping[str, str] = os.environ) -> list[Setting]:
    """The settings in the environment: ``MSSEGMENT_`` and the key in capitals, ``_`` for dots."""
    names = {key: f"MSSEGMENT_{key.replace('.', '_').upper()}" for key in KEYS}
    return [
        Setting(key, _value(environment[name], name), name)
        for key, name in names.items()
        if name in environment
    ]


def from_options(options: Mapping[str, Any], flags: Mapping[str, str]) -> list[Setting]:
    """The settings of command-line options that were given (not None), by key.

    ``flags`` names each key's flag; text is read as YAML.
    """
    return [
        Setting(
            key,
            _value(value, flags[key]) if isinstance(value, str) else value,
            flags[key],
            UsageError,
        )
        for key, value in options.items()
        if value is not None
    ]


def from_mapping(values: Mapping[str, Any], origin: str) -> list[Setting]:
    """The settings of values by dotted key. Raises ConfigurationError for an unknown key."""
    for key in values:
        check_key(key, origin)
    return [Setting(key, value, origin) for key, value in values.items()]


def camera_of(settings: CameraSettings) -> Camera | None:
    """The camera that the settings describe, None where they describe none.

    Raises ConfigurationError where only a part of the four intrinsics is there.
    """
    if settings.file is not None:
        own = {f"camera.{k}": getattr(settings, k) for k in _INTRINSICS}
        given = [key for key, value in own.items() if value is not None]
        if given:
            raise ConfigurationError(f"camera.file and {given[0]} are both set; keep one of them")
        from mssegment.configuration.files import read_camera

        settings = resolve(read_camera(settings.file)).camera
    found = {name: getattr(settings, name) for name in _INTRINSICS}
    missing = [name for name, value in found.items() if value is None]
    if len(missing) == len(_INTRINSICS):
        return None
    if missing:
        raise ConfigurationError(f"camera.{missing[0]} is missing; a camera needs fx, fy, cx, cy")
    return Camera(**found, distortion=tuple(settings.distortion))


def camera_settings(text: str) -> list[Setting]:
    """The settings of ``--camera``: ``fx,fy,cx,cy`` in pixels, or the name of a file.

    Raises UsageError where it is neither.
    """
    origin = f"--camera {text}"
    if "," not in text:
        return [Setting("camera.file", text, origin, UsageError)]
    numbers = text.split(",")
    if len(numbers) != len(_INTRINSICS):
        raise UsageError(f"{origin}: {len(numbers)} numbers, fx,fy,cx,cy were expected")
    return [
        Setting(f"camera.{name}", _value(number, origin), origin, UsageError)
        for name, number in zip(_INTRINSICS, numbers, strict=True)
    ]


def _value(text: str, origin: str) -> Any:
    """What ``text`` stands for in YAML; PyYAML is not loaded for a single word."""
    if text.isascii() and text.isalpha():
        return _WORDS.get(text, text)
    from mssegment.configuration.files import value_of

    return value_of(text, origin)


def _convert(setting: Setting) -> Any:
    key = KEYS[setting.key]
    value = setting.value
    if isinstance(value, str) and "..." in key.choices:
        value = [value]
    if isinstance(value, str) and "NUMBER" in key.choices:
        # YAML 1.1 takes 1e-2 for text, people do not
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise setting.error(f"{setting.origin}: {setting.key} is {value}, which is no number")
    try:
        return msgspec.convert(value, key.type)
    except msgspec.ValidationError:
        raise setting.error(
            f"{setting.origin}: {setting.key} is {value!r}, {key.expected} was expected"
        ) from None


def _check_together(configuration: Configuration) -> None:
    read = configuration.input
    if read.stop is not None and read.stop <= read.start:
        raise ConfigurationError(
            f"input.stop is {read.stop}, more than input.start ({read.start}) was expected"
        )
    segment = configuration.segment
    if isinstance(segment.motions, int) and segment.motions < segment.min_motions:
        raise ConfigurationError(
            f"segment.motions is {segment.motions}, less than segment.min_motions "
            f"({segment.min_motions})"
        )
