"""Reading YAML: a configuration or a single value, with the position of each error.

A module of its own because most commands read no YAML, and importing PyYAML takes longer than the
rest of the configuration.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import yaml

from mssegment.configuration.settings import KEYS, Setting, check_key
from mssegment.errors import ConfigurationError
from mssegment.inputs.files import read_file
from mssegment.inputs.yaml_nodes import check_nodes, check_text

_NO_VALUE = (
    *(yaml.YAMLError, ValueError, OverflowError, TypeError, RecursionError),
    *(AttributeError, KeyError, IndexError),
)
"""What PyYAML raises for a scalar that is not what its form or its tag says."""
_PATH_KEYS = ("input.images", "input.tracks", "camera.file", "report.labels")


def read_settings(path: str) -> list[Setting]:
    """The settings in a configuration file; see ``configuration.from_file``."""
    content = read_file(
        path,
        error=ConfigurationError,
        expected="a configuration file",
        missing="no such configuration file; `mssegment init` writes one to start from",
    )
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigurationError(f"{path}: not UTF-8 ({error}); save it as UTF-8") from None
    return [relative_to(Path(path).parent, s) for s in _flatten(_compose(text, path), path)]


def value_of(text: str, origin: str) -> Any:
    """The value of ``text`` as YAML; raises ConfigurationError if it is not plain YAML."""
    node = _compose(text, origin)
    return "" if node is None else _value(node, origin)


def _compose(text: str, path: str) -> yaml.Node | None:
    check_text(text, path, ConfigurationError)
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
        check_nodes(node, path, ConfigurationError)
        return node
    except RecursionError:
        raise ConfigurationError(f"{path}: nested too deeply; expected `section: key`") from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigurationError(f"{path}{place}: not YAML ({error.problem})") from None
    except yaml.YAMLError as error:
        raise ConfigurationError(f"{path}: not YAML ({' '.join(str(error).split())})") from None


def _flatten(node: yaml.Node | None, path: str, section: str = "") -> list[Setting]:
    """The settings below a YAML node, each with its line and column as origin."""
    if node is None or node.tag.endswith(":null"):
        return []
    if not isinstance(node, yaml.MappingNode):
        what = f"{section}: expected keys below it" if section else "expected keys (`section: ...`)"
        raise ConfigurationError(f"{path}{_place(node)}: {what}")
    settings: list[Setting] = []
    seen: set[str] = set()
    for key_node, value_node in node.value:
        origin = f"{path}{_place(key_node)}"
        name = str(key_node.value)
        key = f"{section}.{name}" if section else name
        if key in seen:
            raise ConfigurationError(f"{origin}: {key} is set twice; remove one of them")
        seen.add(key)
        if not section and any(k.startswith(f"{name}.") for k in KEYS):
            settings += _flatten(value_node, path, name)
            continue
        check_key(key, origin)
        settings.append(Setting(key, _value(value_node, origin), origin))
    return settings


def _value(node: yaml.Node, origin: str) -> Any:
    loader = yaml.SafeLoader("")
    try:
        return loader.construct_document(node)
    except _NO_VALUE as error:
        # a scalar that looks like a date or a number but is not one, or a mapping as a key
        reason = getattr(error, "problem", None) or error
        raise ConfigurationError(f"{origin}: not a plain YAML value ({reason})") from None
    finally:
        loader.dispose()


def _place(node: yaml.Node) -> str:
    return f":{node.start_mark.line + 1}:{node.start_mark.column + 1}"


def relative_to(folder: Path, setting: Setting) -> Setting:
    """The setting with relative paths, if it has any, as paths below the folder."""
    if setting.key not in _PATH_KEYS or setting.value is None:
        return setting
    several = setting.value if isinstance(setting.value, list) else [setting.value]
    moved = [os.path.normpath(folder / p) if isinstance(p, str) else p for p in several]
    value = moved if isinstance(setting.value, list) else moved[0]
    return Setting(setting.key, value, setting.origin, setting.error)
