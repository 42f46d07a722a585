"""The commented config.yaml that `mssegment init` writes, generated from the settings."""

from __future__ import annotations

import textwrap
from typing import Any

import yaml

from mssegment.configuration.settings import KEYS
from mssegment.registry import MODELS

_HEADER = """\
# Configuration of mssegment; run it with `mssegment run config.yaml --out out`.
# All keys are listed with their defaults; delete the ones you do not need.
# Relative paths are relative to this file.
"""


def template(model: str = "auto") -> str:
    """The text of a configuration file for the motion model ``model``."""
    values: dict[str, Any] = {key: setting.default for key, setting in KEYS.items()}
    values["hypothesize.model"] = model
    needs_camera, two_views = False, True
    if model in MODELS:
        needs_camera, two_views = MODELS[model].needs_camera, MODELS[model].accepts(2)
    if model in MODELS and not MODELS[model].of_pictures:
        values["input.tracks"] = "points.csv"
    else:
        values["input.images"] = ["1.png", "2.png"] if two_views else ["frames/"]
    if needs_camera:
        values["camera.file"] = "camera.yaml"
    lines = [_HEADER]
    current = ""
    for key, setting in KEYS.items():
        section, _, name = key.rpartition(".")
        if section != current:
            lines.append(f"\n{section}:")
            current = section
        indent = "  " if section else ""
        comment = f"{setting.description} ({setting.choices})"
        lines += textwrap.wrap(
            comment, 98, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# "
        )
        lines.append(f"{indent}{name}: {_yaml(values[key])}")
    return "\n".join(lines) + "\n"


def _yaml(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True).removesuffix("...\n").strip()
