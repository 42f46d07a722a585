"""Settings from config.yaml, the environment and the command line as one typed configuration.

Precedence, highest first: command-line option, environment variable (for example
``MSSEGMENT_CLUSTER_BANDWIDTH``), config.yaml, default.
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
    LimitSettings,
    MatchSettings,
    ReportSettings,
    SegmentSettings,
    SequenceSettings,
    Setting,
    check_key,
)
from mssegment.errors import ConfigurationError, UsageError
from mssegment.inputs.limits import LIMITS
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
    "LimitSettings",
    "MatchSettings",
    "ReportSettings",
    "SegmentSettings",
    "SequenceSettings",
    "Setting",
    "camera_of",
    "camera_settings",
    "from_environment",
    "from_file",
    "from_mapping",
    "from_options",
    "from_text",
    "limits_of",
    "resolve",
]

_WORDS = {
    form: value
    for value, words in ((True, "yes true on"), (False, "no false off"), (None, "null"))
    for word in words.split()
    for form in (word, word.capitalize(), word.upper())
}
"""Words that YAML 1.1 does not read as text."""
LARGEST_NUMBER = 2**53
"""Whole numbers up to this one are exact in documents, whatever reads them."""
_PREFIX = "MSSEGMENT_"
_OTHER_VARIABLES = ("MSSEGMENT_DATA",)
"""Variables of the benchmarks and tests."""
_INTRINSICS = ("fx", "fy", "cx", "cy")


def resolve(settings: Iterable[Setting]) -> Configuration:
    """Combine settings into a configuration.

    Parameters
    ----------
    settings : iterable of Setting
        In order of increasing precedence: a later value of a key overrides an earlier one.

    Returns
    -------
    Configuration
        All settings; keys that are not given have their defaults.

    Raises
    ------
    MssegmentError
        For the first value that is not valid: the ``error`` type of its setting.
    ConfigurationError
        If two settings contradict each other.

    Examples
    --------
    >>> from mssegment.configuration import from_mapping, resolve
    >>> resolve(from_mapping({"segment.motions": 2}, "example")).segment.motions
    2
    """
    values: dict[str, Any] = {}
    for setting in settings:
        section, _, name = setting.key.rpartition(".")
        place = values.setdefault(section, {}) if section else values
        place[name] = _convert(setting)
    configuration = msgspec.convert(values, Configuration)
    _check_together(configuration)
    return configuration


def limits_of(configuration: Configuration) -> dict[str, int]:
    """The limits of a configuration that differ from their defaults, for ``limits.using``."""
    found: dict[str, int] = msgspec.structs.asdict(configuration.limits)
    return {name: value for name, value in found.items() if value != LIMITS[name].default}


def from_file(path: str) -> list[Setting]:
    """Read the settings in a YAML file.

    Parameters
    ----------
    path : str
        The file. Relative paths in it are relative to its folder.

    Returns
    -------
    list of Setting

    Raises
    ------
    ConfigurationError
        If the file cannot be read, is not YAML, or has an unknown key; with line and column.
    """
    from mssegment.configuration.files import read_settings

    return read_settings(path)


def from_text(assignments: Iterable[str]) -> list[Setting]:
    """Parse the arguments of ``--set KEY=VALUE``, where VALUE is YAML.

    Raises ConfigurationError if there is no ``=``, the key is unknown, or VALUE is not YAML.
    """
    settings = []
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals:
            raise ConfigurationError(f"--set {assignment}: expected KEY=VALUE")
        origin = f"--set {assignment}"
        check_key(key.strip(), origin)
        settings.append(Setting(key.strip(), _value(value, origin), origin))
    return settings


def from_environment(environment: Mapping[str, str] = os.environ) -> list[Setting]:
    """The settings in environment variables.

    The name of a variable is ``MSSEGMENT_`` followed by the key in capitals with ``_`` instead of
    dots. Raises ConfigurationError for a value that is not YAML, and for another variable that
    begins with ``MSSEGMENT_``, with the nearest name.
    """
    names = {key: f"{_PREFIX}{key.replace('.', '_').upper()}" for key in KEYS}
    for name in environment:
        if name.startswith(_PREFIX) and name not in (*names.values(), *_OTHER_VARIABLES):
            raise ConfigurationError(f"{name}: no setting has this variable; {_near(name, names)}")
    return [
        Setting(key, _value(environment[name], name), name)
        for key, name in names.items()
        if name in environment
    ]


def _near(name: str, names: Mapping[str, str]) -> str:
    import difflib

    near = difflib.get_close_matches(name, names.values(), n=1, cutoff=0.5)
    return f"did you mean {near[0]}?" if near else "`mssegment init` shows all keys"


def from_options(options: Mapping[str, Any], flags: Mapping[str, str]) -> list[Setting]:
    """The settings of command-line options.

    Parameters
    ----------
    options : mapping
        Value by key; None where the option was not given. Text is parsed as YAML.
    flags : mapping
        The flag of each key, for error messages.

    Returns
    -------
    list of Setting
        Those that were given; a value that is not valid will raise UsageError.
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
    """The settings of values by dotted key.

    ``origin`` opens the error messages. Raises ConfigurationError for an unknown key.
    """
    for key in values:
        check_key(key, origin)
    return [Setting(key, _plain(value), origin) for key, value in values.items()]


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy, and paths, as Python's own."""
    if type(value).__module__ == "numpy" and hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def camera_of(settings: CameraSettings) -> Camera | None:
    """The camera that the settings describe.

    Returns
    -------
    Camera or None
        None if no camera is set.

    Raises
    ------
    ConfigurationError
        If some but not all of fx, fy, cx, cy are set, both a file and numbers are set, or the
        file cannot be read.
    """
    if settings.file is not None:
        own = {f"camera.{k}": getattr(settings, k) for k in _INTRINSICS}
        given = [key for key, value in own.items() if value is not None]
        if given:
            raise ConfigurationError(f"camera.file and {given[0]} are both set; keep one of them")
        from mssegment.cameras import read_camera

        return read_camera(settings.file)
    found = {name: getattr(settings, name) for name in _INTRINSICS}
    missing = [name for name, value in found.items() if value is None]
    if len(missing) == len(_INTRINSICS):
        return None
    if missing:
        raise ConfigurationError(f"camera.{missing[0]} is missing; a camera needs fx, fy, cx, cy")
    return Camera(
        **found,
        distortion=tuple(settings.distortion),
        distortion_model=settings.distortion_model,
    )


def camera_settings(text: str) -> list[Setting]:
    """Parse the argument of ``--camera``: ``fx,fy,cx,cy`` in pixels, or the name of a file.

    Raises UsageError for a list that does not have four numbers.
    """
    origin = f"--camera {text}"
    if "," not in text:
        return [Setting("camera.file", text, origin, UsageError)]
    numbers = text.split(",")
    if len(numbers) != len(_INTRINSICS):
        raise UsageError(f"{origin}: found {len(numbers)} numbers; expected fx,fy,cx,cy")
    return [
        Setting(f"camera.{name}", _value(number, origin), origin, UsageError)
        for name, number in zip(_INTRINSICS, numbers, strict=True)
    ]


def _value(text: str, origin: str) -> Any:
    """The value of ``text`` as YAML; a single word is parsed here, without loading PyYAML."""
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
        # YAML 1.1 reads 1e-2 as text
        with contextlib.suppress(ValueError):
            value = float(value)
    if isinstance(value, float) and not math.isfinite(value):
        raise setting.error(f"{setting.origin}: {setting.key} is {value}; expected a finite number")
    if isinstance(value, int) and abs(value) > LARGEST_NUMBER:
        raise setting.error(
            f"{setting.origin}: {setting.key} is {value}; expected at most {LARGEST_NUMBER}"
        )
    try:
        return msgspec.convert(value, key.type)
    except (msgspec.ValidationError, UnicodeEncodeError):
        raise setting.error(
            f"{setting.origin}: {setting.key} is {value!r}; expected {key.expected}"
        ) from None


def _check_together(configuration: Configuration) -> None:
    read = configuration.input
    if read.stop is not None and read.stop <= read.start:
        raise ConfigurationError(
            f"input.stop is {read.stop}; expected more than input.start ({read.start})"
        )
    segment = configuration.segment
    if isinstance(segment.motions, int) and segment.motions < segment.min_motions:
        raise ConfigurationError(
            f"segment.motions is {segment.motions}; expected at least segment.min_motions "
            f"({segment.min_motions})"
        )
