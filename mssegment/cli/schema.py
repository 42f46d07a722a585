"""``mssegment schema``."""

from __future__ import annotations

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import Console, console_options, output_option
from mssegment.documents import STANDARD, write_bytes

NAMES = ("corners", "tracks", "hypotheses", "segmentation", "report", "configuration")
"""As in ``mssegment.schema``, repeated here so that ``--help`` need not import the types."""


@click.command(
    short_help=COMMANDS["schema"], epilog="Example:  mssegment schema tracks -o tracks.schema.json"
)
@click.argument("name", type=click.Choice(NAMES))
@output_option
@console_options
def command(name: str, output: str | None, console: Console) -> None:
    """Write the JSON Schema of a document, of report.json, or of the configuration.

    Validators, editors and code generators read it. An editor that knows the schema of the
    configuration completes and checks config.yaml.
    """
    import msgspec

    from mssegment.schema import json_schema

    content = msgspec.json.format(msgspec.json.encode(json_schema(name)), indent=2)
    write_bytes(output or STANDARD, content + b"\n")
