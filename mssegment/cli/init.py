"""``mssegment init``."""

from __future__ import annotations

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, output_option
from mssegment.configuration import KEYS
from mssegment.documents import STANDARD, write_bytes

MODELS = KEYS["hypothesize.model"].choices.split("|")


@click.command(
    short_help=COMMANDS["init"],
    epilog="Example:  mssegment init --model translation -o config.yaml",
)
@click.option(
    "--model",
    type=click.Choice(MODELS),
    default="auto",
    show_default=True,
    help="Motion model of the configuration.",
)
@output_option
@console_options
def command(model: str, output: str | None, console: Console) -> None:
    """Write a commented config.yaml that lists every key with its default and description."""
    from mssegment.configuration.template import template

    write_bytes(output or STANDARD, template(model).encode())
    if output not in (None, STANDARD):
        console.note(
            f"wrote {output}; set the input in it, then run it with `mssegment run {output}`"
        )
