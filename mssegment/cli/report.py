"""``mssegment report``."""

from __future__ import annotations

from contextlib import nullcontext

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    chosen_format,
    console_options,
    document_argument,
    format_option,
    put,
    read_argument,
    settings_options,
)
from mssegment.configuration import Setting, resolve
from mssegment.documents import SegmentationDocument

KEYS = (
    "report.labels",
    "report.label_radius",
    "report.pictures",
    "report.picture_format",
    "report.regions",
    "report.video",
    "report.html",
)


@click.command(
    short_help=COMMANDS["report"],
    epilog="Example:  mssegment report segmentation.json --labels labels.csv --out report",
)
@document_argument("segmentation")
@settings_options(*KEYS)
@click.option("--out", metavar="DIR", help="Folder for report.json, report.html and the pictures.")
@click.option("--force", is_flag=True, help="Write into a folder that is not empty.")
@format_option
@click.option("--show", is_flag=True, help="Show the picture in the terminal, if it supports that.")
@console_options
def command(
    document: str,
    settings: list[Setting],
    out: str | None,
    force: bool,
    form: str | None,
    show: bool,
    console: Console,
) -> None:
    """Report a segmentation: the tables of the paper, annotated pictures, an HTML report.

    Reads a segmentation document. With ground-truth labels (a CSV of points, mask images, or the
    labels of imported tracks) the report includes the confusion matrix, the misclassification, and
    the residual errors (23) and (24) of the paper.
    """
    configuration = resolve(settings)
    segmentation = read_argument(document, SegmentationDocument)
    from mssegment.cli.results import Results, claimed_folder
    from mssegment.rendering.tables import format_report

    with nullcontext() if out is None else claimed_folder(out, force):
        results = Results.of(segmentation, configuration)
        if out is not None:
            with console.working("report"):
                written = results.write(out)
            console.note(f"wrote {', '.join(written)} to {out}")
    if show:
        results.show()
    put(format_report(results.report, chosen_format(form, console)))
