"""``mssegment compare``."""

from __future__ import annotations

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    chosen_format,
    console_options,
    files,
    format_option,
    put,
    settings_options,
)
from mssegment.configuration import Setting, resolve
from mssegment.documents import SegmentationDocument, read_document, write_bytes
from mssegment.errors import UsageError

KEYS = ("report.labels", "report.label_radius", "report.background_label")


@click.command(
    short_help=COMMANDS["compare"],
    epilog="Example:  mssegment compare a.json b.json --picture comparison.png",
)
@click.argument("segmentations", nargs=-1, metavar="SEGMENTATION...", shell_complete=files)
@settings_options(*KEYS)
@click.option(
    "--picture", metavar="FILE", help="Also draw them side by side, as .png, .jpg or .svg."
)
@format_option
@console_options
def command(
    segmentations: tuple[str, ...],
    settings: list[Setting],
    picture: str | None,
    form: str | None,
    console: Console,
) -> None:
    """Compare several segmentations, for example of different seeds, settings or models.

    Reads two or more segmentation documents, or folders of results, and writes a table. For
    documents with the same tracks it includes the percentage of tracks that differ from the first
    document.
    """
    if len(segmentations) < 2:
        raise UsageError(f"found {len(segmentations)} segmentation documents; expected two or more")
    from mssegment.rendering.compare import comparison_picture, format_comparison
    from mssegment.results import Results

    configuration = resolve(settings)
    reports = [
        Results.of(read_document(path, SegmentationDocument), configuration).report
        for path in segmentations
    ]
    if picture is not None:
        content = comparison_picture(segmentations, reports, _picture_format(picture))
        write_bytes(picture, content)
        console.note(f"wrote {picture}")
    text = format_comparison(segmentations, reports, chosen_format(form, console))
    put(text)


def _picture_format(path: str) -> str:
    from mssegment.rendering.pictures import FORMATS as PICTURE_FORMATS

    suffix = path.rpartition(".")[2].lower()
    if suffix not in PICTURE_FORMATS:
        known = ", ".join(f".{name}" for name in PICTURE_FORMATS)
        raise UsageError(f"--picture {path}: expected a name that ends in one of {known}")
    return suffix
