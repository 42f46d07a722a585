"""The documentation says what the program does: help texts, settings, examples, links."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import click
import pytest

from docs.reference import BEGIN, END, commands_page, readme_with_table
from mssegment.cli import COMMANDS, cli
from mssegment.configuration import KEYS

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def command_named(name: str) -> click.Command:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    return command


def test_the_page_of_commands_is_the_help_of_the_program() -> None:
    written = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert written == commands_page(), "run `make docs`"


def test_the_table_of_settings_is_the_program() -> None:
    assert readme_with_table(README) == README, "run `make docs`"
    table = README.split(BEGIN)[1].split(END)[0]
    assert re.findall(r"^\| `([a-z_.]+)`", table, re.MULTILINE) == list(KEYS)


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
