"""The page of settings, made from their definitions."""

from __future__ import annotations

from itertools import groupby

from docs.reference import _keys_of, _shown
from mssegment.cli import COMMANDS
from mssegment.cli.common import flag_of
from mssegment.configuration import KEYS

HEAD = """\
# Settings

A command-line option overrides the environment, the environment overrides `config.yaml`, and
`config.yaml` overrides the default. The environment variable of a key is `MSSEGMENT_` and the key
in capitals with `_` instead of dots, as in `MSSEGMENT_CLUSTER_BANDWIDTH`. `run --set KEY=VALUE`
sets any key, also those without an option of their own; `mssegment init` writes a configuration
file with all keys and what they mean.
"""
TABLE = "| key, option | values | default | meaning |\n|---|---|---|---|"


def settings_page() -> str:
    """Every setting by section, and where values come from."""
    parts = [HEAD]
    for section, keys in groupby(KEYS, key=lambda key: key.rpartition(".")[0]):
        parts += [f"## {section or 'General'}\n", TABLE, *map(_row, keys), ""]
    return "\n".join(parts)


def _row(key: str) -> str:
    setting = KEYS[key]
    commands = [name for name in COMMANDS if key in _keys_of(name)]
    where = f"<br>`{flag_of(key)}` of {', '.join(commands)}" if commands else ""
    values = " or ".join(f"`{value}`" for value in setting.choices.split("|"))
    limits = setting.expected.removeprefix(setting.choices)
    default = "" if setting.default in (None, []) else f"`{_shown(setting.default)}`"
    return f"| `{key}`{where} | {values}{limits} | {default} | {setting.description} |"
