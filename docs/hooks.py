"""What mkdocs calls while it builds the site: generated pages, formulas, output of commands.

- Settings, formats, models, manifolds, the API, CONTRIBUTING.md and CHANGELOG.md become pages.
- Formulas in LaTeX become MathML, which browsers show without a script.
- A fenced block ``sh run`` is executed, and what it prints is shown below each command.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from docs.api import PUBLIC, api_pages
from docs.formats import formats_page
from docs.registries import manifolds_page, models_page
from docs.settings import settings_page
from mssegment.schema import NAMES, json_schema

ROOT = Path(__file__).parents[1]

ENVIRONMENT = {
    "PYTHON": sys.executable,
    "PROGRAM": "from mssegment.cli import main; main()",
    "PYTHONPATH": str(ROOT),
    "COLUMNS": "88",
    "NO_COLOR": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
}
"""In which the commands of the pages run: this very program, with the same output everywhere."""

_FORMULA = re.compile(r'<(span|div) class="arithmatex">(\\[(\[])(.*?)\\[)\]]</\1>', re.S)
_RUN = re.compile(r"^```sh run\n(.*?)^```$", re.M | re.S)
_TIME = re.compile(r" +\d+\.\d\d s$", re.M)


@cache
def pages() -> dict[str, str]:
    """The generated pages: path in the site -> Markdown."""
    return {
        "settings.md": settings_page(),
        "formats.md": formats_page(),
        "models.md": models_page(),
        "manifolds.md": manifolds_page(),
        "contributing.md": _in_the_site("CONTRIBUTING.md"),
        "changelog.md": _in_the_site("CHANGELOG.md"),
        **api_pages(),
    }


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Puts the pages of the API into the navigation, in place of the word ``api``."""
    paths = [path for path in pages() if path.startswith("api/")]
    named = {Path(path).stem: path for path in paths[1:]}
    main = [{name: path} for name, path in named.items() if name in PUBLIC]
    others = [{name: path} for name, path in named.items() if name not in PUBLIC]
    for entry in config.nav or ():
        if isinstance(entry, dict) and "API" in entry:
            entry["API"] = [paths[0], *main, {"Internal": others}]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the generated pages, and the JSON Schemas."""
    for path, content in pages().items():
        files.append(File.generated(config, path, content=content))
    for name in NAMES:
        content = json.dumps(json_schema(name), indent=2)
        files.append(File.generated(config, f"schemas/{name}.json", content=content))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Runs the commands of ``sh run`` blocks."""
    if not _RUN.search(markdown):
        return markdown
    with tempfile.TemporaryDirectory(prefix="mssegment-docs-") as folder:
        for name in ("sample_data", "configs"):
            (Path(folder) / name).symlink_to(ROOT / name)
        return _RUN.sub(lambda block: _session(block[1], folder), markdown)


def on_page_content(html: str, **_: Any) -> str:
    """Formulas as MathML."""
    return _FORMULA.sub(_mathml, html)


def _in_the_site(name: str) -> str:
    """A file of the repository as a page: links into docs/ lead to pages, others become text."""
    text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
    return re.sub(r"\[([^\]]+)\]\((?!https?:|#|[\w/-]+\.md)[^)]+\)", r"\1", text)


def _mathml(match: re.Match[str]) -> str:
    display = "block" if match[2] == "\\[" else "inline"
    formula = convert(unescape(match[3]).strip(), display=display)
    return f'<div class="formula">{formula}</div>' if display == "block" else formula


def _session(commands: str, folder: str) -> str:
    """A console session: each command and what it prints, without the times of the stages."""
    lines = []
    for command in commands.strip().split("\n\n"):
        prompt = "$ " + command.replace("\n", "\n> ")
        lines.append(f"{prompt}\n{_output(command, folder)}".rstrip())
    text = "\n\n".join(lines)
    return f"```console\n{text}\n```"


def _output(command: str, folder: str) -> str:
    script = f'exec 2>&1; mssegment() {{ "$PYTHON" -c "$PROGRAM" "$@"; }}; {command}'
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script],
        cwd=folder,
        env=os.environ | ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{command}\n{done.stdout}")
    return _TIME.sub("", done.stdout).rstrip()
