"""The documentation states what the program does: help texts, settings, examples, links."""

from __future__ import annotations

import doctest
import importlib
import re
import shlex
import tomllib
from pathlib import Path

import click
import cv2
import pytest

from docs.constants import page_with_lists
from docs.reference import commands_page, guide_with_lists, readme_with_tables
from mssegment.cli import COMMANDS, cli, invoke
from mssegment.configuration import KEYS
from mssegment.manifolds import Manifold
from mssegment.models import MotionModel

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
WITH_EXAMPLES = [
    path
    for path in sorted((ROOT / "mssegment").rglob("*.py"))
    if ">>> " in path.read_text(encoding="utf-8")
]


def command_named(name: str) -> click.Command:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    return command


def test_the_page_of_commands_is_the_help_of_the_program() -> None:
    written = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert written == commands_page(), "run `make docs`"


def test_the_table_of_settings_is_the_program() -> None:
    assert readme_with_tables(README) == README, "run `make docs`"
    table = README.split("<!-- settings: begin -->")[1].split("<!-- settings: end -->")[0]
    assert re.findall(r"^\| `([a-z_.]+)`", table, re.MULTILINE) == list(KEYS)


@pytest.mark.parametrize("page", sorted((ROOT / "docs" / "guide").glob("*.md")), ids=str)
def test_the_lists_of_formats_are_the_registries(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert guide_with_lists(text) == text, "run `make docs`"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_and_an_example(name: str) -> None:
    command = command_named(name)
    assert command.short_help == COMMANDS[name]
    assert command.help
    assert command.epilog
    assert command.epilog.startswith("Example:  mssegment ")
    for parameter in command.params:
        if isinstance(parameter, click.Option):
            assert parameter.help, f"{name} {parameter.opts}"


def test_the_readme_lists_every_command() -> None:
    table = README.split("## Commands")[1].split("\n## ")[0]
    assert re.findall(r"^\| `mssegment ([a-z]+)` \|", table, re.M) == list(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_options_of_every_example_exist(name: str) -> None:
    example = command_named(name).epilog or ""
    for part in example.removeprefix("Example:").split("|"):
        words = shlex.split(part)
        command = command_named(words[1])
        known = {opt for parameter in command.params for opt in parameter.opts}
        assert {word for word in words[2:] if word.startswith("-") and len(word) > 1} <= known


def test_every_file_that_the_readme_links_to_is_there() -> None:
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", README)
    assert links
    missing = [link for link in links if not (ROOT / link).exists()]
    assert not missing


def test_the_python_of_the_readme_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```python\n(.*?)```", README, re.S)
    assert len(blocks) >= 3
    for block in blocks:
        exec(compile(block, "README.md", "exec"), {})


def test_the_readme_lists_what_a_manifold_and_a_model_implement() -> None:
    guide = README.split("### Extending it")[1].split("###")[0]
    manifold, model = guide.split("- **A motion model**")
    for text, base in ((manifold, Manifold), (model, MotionModel)):
        missing = {name for name in base.__abstractmethods__ if f"`{name}`" not in text}
        assert not missing, f"{base.__name__}: {missing}"


def test_the_readme_lists_every_package() -> None:
    table = README.split("## Architecture")[1].split("###")[0]
    for path in (ROOT / "mssegment").iterdir():
        is_package = path.is_dir() and (path / "__init__.py").exists()
        if is_package or (path.suffix == ".py" and path.stem not in ("__init__", "version")):
            assert f"`{path.name}{'/' * is_package}`" in table


def test_the_readme_names_every_dependency() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    table = README.split("### Run-time dependencies")[1].split("##")[0]
    names = [re.split(r"[<>=]", entry)[0] for entry in project["dependencies"]]
    assert re.findall(r"^\| ([a-z-]+) \| ", table, re.MULTILINE)[1:] == names


@pytest.mark.parametrize("path", WITH_EXAMPLES, ids=lambda path: str(path.relative_to(ROOT)))
def test_the_examples_of_the_docstrings_run(path: Path) -> None:
    name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    outcome = doctest.testmod(importlib.import_module(name))
    assert outcome.attempted
    assert not outcome.failed


def without_numbers(text: str) -> list[str]:
    """The lines of a console output without their numbers, which depend on the processor."""
    return [" ".join(re.sub(r"[\d.]+", "#", line).split()) for line in text.splitlines()]


def test_the_consoles_of_the_readme_show_what_the_program_prints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    consoles = re.findall(r"```console\n\$ mssegment (.*?)\n(.*?)```", README, re.S)
    assert len(consoles) == 2
    if int(cv2.__version__.split(".")[0]) < 5:
        pytest.skip("OpenCV 4 finds a few other corners than the README shows")
    for command, shown in consoles:
        assert invoke([*shlex.split(command), "--format", "text"]) == 0
        outcome = capfd.readouterr()
        printed = without_numbers(outcome.err + outcome.out)
        for part in shown.split("...\n"):
            lines = without_numbers(part.strip("\n"))
            assert "\n".join(lines) in "\n".join(printed)


def test_the_list_of_constants_is_that_of_the_code() -> None:
    page = (ROOT / "docs" / "constants.md").read_text(encoding="utf-8")
    assert page_with_lists(page) == page, "run `make docs`"
    unexplained = re.findall(r"^\| `([A-Z_, ]+)` \| [^|]+ \|  \|$", page, re.MULTILINE)
    assert not unexplained, "write below each constant what it means, and where it comes from"
