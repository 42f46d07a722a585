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
    flag_of,
    format_option,
    put,
    read_argument,
    settings_options,
)
from mssegment.cli.output_checks import check_outputs
from mssegment.configuration import Configuration, Setting, resolve
from mssegment.documents import SegmentationDocument
from mssegment.errors import UsageError

KEYS = (
    "report.labels",
    "report.label_radius",
    "report.background_label",
    "report.pictures",
    "report.picture_format",
    "report.masks",
    "report.mask_style",
    "report.export",
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

    Reads a segmentation document, or the one in a folder of results. With ground-truth labels (a
    CSV of points, mask images, or the labels of imported tracks) the report includes the confusion
    matrix, the misclassification, and the residual errors (23) and (24) of the paper.
    """
    configuration = resolve(settings)
    if out is None:
        _refuse_without_folder(configuration)
    segmentation = read_argument(document, SegmentationDocument)
    check_outputs(configuration, segmentation.of_pictures)
    from mssegment.cli import results as console_results
    from mssegment.folders import result_folder
    from mssegment.rendering.tables import format_report
    from mssegment.results import Results

    with nullcontext() if out is None else result_folder(out, replace=force) as folder:
        results = Results.of(segmentation, configuration)
        if folder is not None:
            with console.working("report"):
                results = results.with_masks()
                written = results.write(str(folder.path))
            console.note(f"wrote {', '.join(written)} to {out}")
            for said in results.said:
                console.note(said)
    if show:
        console_results.show(results.report)
    put(format_report(results.report, chosen_format(form, console)))


def _refuse_without_folder(configuration: Configuration) -> None:
    """Raises UsageError if files are asked for, but no folder for them."""
    settings = configuration.report
    asked = [
        flag_of(f"report.{name}")
        for name in ("masks", "export", "regions", "video")
        if getattr(settings, name)
    ]
    if asked:
        raise UsageError(f"{asked[0]} writes files; name a folder for them with --out DIR")
