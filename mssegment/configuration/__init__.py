"""config.yaml, the environment and the command line become one typed configuration.

Precedence: option > environment (``MSSEGMENT_CLUSTER_BANDWIDTH``) > config > default.
"""

from __future__ import annotations

import contextlib
import difflib
import math
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import yaml

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
)
from mssegment.errors import ConfigurationError, MssegmentError, UsageError
from mssegment.records import Camera, Record

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

_PATH_KEYS = ("input.images", "input.tracks", "camera.file", "report.labels")
_INTRINSICS = ("fx", "fy", "cx", "cy")


class Setting(Record, frozen=True):
    """A value for one key, where it came from, and the error it is when it is wrong."""

    key: str
    value: Any
    origin: str
    error: type[MssegmentError] = ConfigurationError


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
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise ConfigurationError(
            f"{path}: no such configuration; `mssegment init` writes one to start from"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: cannot be read ({error})") from None
    return [_relative_to(Path(path).parent, s) for s in _flatten(_compose(text, path), path)]


def from_text(assignments: Iterable[str]) -> list[Setting]:
    """The settings of ``--set KEY=VALUE``; VALUE is YAML. Raises ConfigurationError."""
    settings = []
    for assignment in assignments:
        key, equals, value = assignment.partition("=")
        if not equals:
            raise ConfigurationError(f"--set {assignment}: KEY=VALUE was expected")
        origin = f"--set {assignment}"
        _check_key(key.strip(), origin)
        settings.append(Setting(key.strip(), _scalar(value, origin), origin))
    return settings


def from_environment(environment: Mapping[str, str] = os.environ) -> list[Setting]:
    """The settings in the environment: ``MSSEGMENT_`` and the key in capitals, ``_`` for dots."""
    names = {key: f"MSSEGMENT_{key.replace('.', '_').upper()}" for key in KEYS}
    return [
        Setting(key, _scalar(environment[name], name), name)
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
            _scalar(value, flags[key]) if isinstance(value, str) else value,
            flags[key],
            UsageError,
        )
        for key, value in options.items()
        if value is not None
    ]


def from_mapping(values: Mapping[str, Any], origin: str) -> list[Setting]:
    """The settings of values by dotted key. Raises ConfigurationError for an unknown key."""
    for key in values:
        _check_key(key, origin)
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
        settings = resolve(_camera_file(settings.file)).camera
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
        Setting(f"camera.{name}", _scalar(number, origin), origin, UsageError)
        for name, number in zip(_INTRINSICS, numbers, strict=True)
    ]


def _camera_file(path: str) -> list[Setting]:
    try:
        node = _compose(Path(path).read_text(encoding="utf-8"), path)
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: the camera cannot be read ({error})") from None
    if not isinstance(node, yaml.MappingNode):
        raise ConfigurationError(f"{path}: fx, fy, cx, cy were expected")
    settings = _flatten(node, path, section="camera")
    if any(s.key in ("camera.file", "camera.derotate") for s in settings):
        raise ConfigurationError(f"{path}: a camera file holds fx, fy, cx, cy, distortion only")
    return settings


def _compose(text: str, path: str) -> yaml.Node | None:
    try:
        return yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigurationError(f"{path}{place}: not YAML ({error.problem})") from None
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: not YAML ({' '.join(str(error).split())})") from None


def _flatten(node: yaml.Node | None, path: str, section: str = "") -> list[Setting]:
    """The settings below a YAML node, each with its line and column."""
    if node is None or node.tag.endswith(":null"):
        return []
    if not isinstance(node, yaml.MappingNode):
        what = f"{section}: keys below it were" if section else "keys (`section: ...`) were"
        raise ConfigurationError(f"{path}{_place(node)}: {what} expected")
    settings: list[Setting] = []
    seen: set[str] = set()
    for key_node, value_node in node.value:
        origin = f"{path}{_place(key_node)}"
        name = str(key_node.value)
        key = f"{section}.{name}" if section else name
        if key in seen:
            raise ConfigurationError(f"{origin}: {key} is there twice; remove one")
        seen.add(key)
        if not section and any(k.startswith(f"{name}.") for k in KEYS):
            settings += _flatten(value_node, path, name)
            continue
        _check_key(key, origin)
        settings.append(Setting(key, _value(value_node, origin), origin))
    return settings


def _value(node: yaml.Node, origin: str) -> Any:
    loader = yaml.SafeLoader("")
    try:
        return loader.construct_document(node)
    except (yaml.YAMLError, ValueError) as error:
        # ValueError: a scalar that looks like a date or a number and is none
        reason = getattr(error, "problem", None) or error
        raise ConfigurationError(f"{origin}: no plain YAML value ({reason})") from None
    finally:
        loader.dispose()


def _place(node: yaml.Node) -> str:
    return f":{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def _scalar(text: str, origin: str) -> Any:
    node = _compose(text, origin)
    return "" if node is None else _value(node, origin)


def _check_key(key: str, origin: str) -> None:
    if key in KEYS:
        return
    near = difflib.get_close_matches(key, KEYS, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else "`mssegment init` shows all keys"
    raise ConfigurationError(f"{origin}: unknown key {key}; {hint}")


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


def _relative_to(folder: Path, setting: Setting) -> Setting:
    if setting.key not in _PATH_KEYS or setting.value is None:
        return setting
    several = setting.value if isinstance(setting.value, list) else [setting.value]
    moved = [os.path.normpath(folder / p) if isinstance(p, str) else p for p in several]
    value = moved if isinstance(setting.value, list) else moved[0]
    return Setting(setting.key, value, setting.origin, setting.error)
