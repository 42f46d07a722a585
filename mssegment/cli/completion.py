"""``mssegment completion``."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from mssegment.cli import COMMANDS, cli
from mssegment.cli.common import put

SHELLS = ("bash", "zsh", "fish")


@click.command(
    short_help=COMMANDS["completion"],
    epilog="Example:  mssegment completion fish",
)
@click.argument("shell", type=click.Choice(SHELLS))
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def command(shell: str, debug: bool) -> None:
    """Write the script that completes mssegment in a shell: commands, options and their values.

    For bash, put `eval "$(mssegment completion bash)"` into ~/.bashrc; for zsh, the same with zsh
    into ~/.zshrc.
    For fish: mssegment completion fish > ~/.config/fish/completions/mssegment.fish
    """
    found = get_completion_class(shell)
    assert found is not None
    put(found(cli, {}, "mssegment", "_MSSEGMENT_COMPLETE").source())
