"""Writes docs/commands.md and the table of settings in the README from the program itself.

``python -m docs.reference`` writes both anew; a test fails where they differ from the program.
"""

from __future__ import annotations

from pathlib import Path

import click
from click.testing import CliRunner

from mssegment.cli import COMMANDS, cli
from mssegment.cli.common import flag_of
from mssegment.configuration import KEYS

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- settings: begin -->", "<!-- settings: end -->"


def commands_page() -> str:
    """docs/commands.md: the help text of every command."""
    parts = ["# The commands\n\nThe output of `--help`, kept equal to the program by a test.\n"]
    for name in ("", *COMMANDS):
        arguments = [*name.split(), "--help"]
        text = CliRunner().invoke(cli, arguments, prog_name="mssegment", terminal_width=96).output
        parts.append(f"## {f'mssegment {name}'.strip()}\n\n```text\n{text.rstrip()}\n```\n")
    return "\n".join(parts)


def settings_table() -> str:
    """The table of the README: key, option, commands, values, default, meaning."""
    rows = ["| key | option | commands | values | default | |", "|---|---|---|---|---|---|"]
    for key, setting in KEYS.items():
        commands = [name for name in COMMANDS if key in _keys_of(name)]
        option = f"`{flag_of(key)}`" if commands else "`--set`"
        names = ", ".join(commands) or "run"
        values = setting.choices.replace("|", "\\|")
        default = "" if setting.default in (None, []) else f"`{_shown(setting.default)}`"
        rows.append(
            f"| `{key}` | {option} | {names} | `{values}` | {default} | {setting.description} |"
        )
    return "\n".join(rows)


def readme_with_table(text: str) -> str:
    """The README with its table written anew."""
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    return f"{before}{BEGIN}\n{settings_table()}\n{END}{after}"


def _shown(value: object) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


def _keys_of(name: str) -> set[str]:
    command = cli.get_command(click.Context(cli), name)
    assert command is not None
    names = {parameter.name for parameter in command.params}
    return {key for key in KEYS if key.replace(".", "__") in names}


def main() -> None:
    """Writes both files."""
    (ROOT / "docs" / "commands.md").write_text(commands_page(), encoding="utf-8")
    readme = ROOT / "README.md"
    readme.write_text(readme_with_table(readme.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
