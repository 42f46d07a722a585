"""``mssegment run``."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import click

from mssegment.cli import COMMANDS
from mssegment.cli.common import (
    Console,
    chosen_format,
    complete_assignment,
    console_options,
    files,
    format_option,
    put,
    settings_options,
)
from mssegment.cli.sentences import describe
from mssegment.configuration import (
    Configuration,
    Setting,
    from_file,
    from_text,
    resolve,
)
from mssegment.documents import STANDARD, Document, TracksDocument
from mssegment.errors import ConfigurationError, UsageError

if TYPE_CHECKING:
    from mssegment import pipeline
    from mssegment.resources import Timings

KEYS = (
    "hypothesize.model",
    "segment.motions",
    "segment.camera_motion",
    "camera.file",
    "report.labels",
    "report.masks",
    "report.mask_style",
    "report.export",
    "seed",
    "input.images",
)
_TRACK_FILES = (".csv", ".mat", ".json", ".npy", ".npz", ".tsv", ".txt", ".h5", ".hdf5", ".db")
"""Suffixes of files of tracks, for those that do not exist."""


@click.command(
    short_help=COMMANDS["run"],
    epilog="Example:  mssegment run 1.png 2.png --model affine --out out",
)
@click.argument(
    "inputs",
    nargs=-1,
    required=True,
    metavar="CONFIG.yaml | IMAGE... | TRACKS",
    shell_complete=files,
)
@settings_options(*KEYS)
@click.option(
    "--set",
    "assignments",
    multiple=True,
    metavar="KEY=VALUE",
    help="Set any key; repeatable.",
    shell_complete=complete_assignment,
)
@click.option(
    "--out",
    default="mssegment-out",
    show_default=True,
    metavar="DIR",
    help="Folder for the results.",
)
@click.option("--force", is_flag=True, help="Write into a folder that is not empty.")
@click.option(
    "--threads",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Number of threads; the result does not depend on it.",
)
@click.option("--profile", is_flag=True, help="Print time and peak memory of every stage.")
@format_option
@console_options
def command(
    inputs: tuple[str, ...],
    settings: list[Setting],
    assignments: tuple[str, ...],
    out: str,
    force: bool,
    threads: int,
    profile: bool,
    form: str | None,
    console: Console,
) -> None:
    """Run all stages and write the results to a folder.

    The input is a configuration file, images (two files, a folder, a glob pattern or a video), or
    tracks (a table, an array, a tracks document, ...; `mssegment import --help` lists them), drawn
    on the pictures that --images names. The output is the document of each stage,
    report.json, timings.json, annotated pictures and report.html.
    """
    configuration = _configuration(inputs, settings, assignments)
    tracks = _tracks(configuration, console)
    if configuration.report.labels:
        from mssegment.ground_truth import check_labels

        check_labels(configuration.report.labels)
    from mssegment.cli.results import claimed_folder, recorded_files, remove_stale
    from mssegment.results import FramePictures, Results

    if configuration.report.masks and tracks is not None and FramePictures(tracks)(0) is None:
        raise UsageError(
            "--masks: there are no pictures of these tracks; name those that they were made from "
            "with --images"
        )
    with claimed_folder(out, force):
        from mssegment import pipeline
        from mssegment.resources import keep_freed_memory

        keep_freed_memory()
        earlier = recorded_files(out)
        with console.working("read") as progress:

            def on_stage(name: str, document: Document | None, timings: Timings) -> None:
                if document is None:
                    progress(name)
                else:
                    console.stage(name, describe(document), timings.seconds[name])
                    console.details(document)

            result = pipeline.run(configuration, tracks, threads=threads, on_stage=on_stage)
            progress("report")
            with result.timings.stage("report"):
                names = _write_documents(result, out)
                results = Results.of(result.segmentation, configuration, result.source)
                results = results.with_masks()
                names += results.write(out)
        _finish(result.timings, names, out, console)
        sources = [frame.path for frame in result.segmentation.frames]
        remove_stale(out, earlier, [*(str(Path(out) / name) for name in names), *sources])
        for said in results.said:
            console.note(said)
    if profile:
        print(_profile(result.timings), file=sys.stderr)
    from mssegment.rendering.tables import format_report

    put(format_report(results.report, chosen_format(form, console)))


def _configuration(
    inputs: tuple[str, ...], settings: list[Setting], assignments: tuple[str, ...]
) -> Configuration:
    """Precedence: option, environment, configuration file, default.

    The images on the command line count as an option.
    """
    layers: list[Setting] = []
    if any(Path(path).suffix.lower() in (".yaml", ".yml") for path in inputs):
        if len(inputs) > 1:
            raise UsageError(
                f"{' '.join(inputs)}: expected one configuration file, or images, not both"
            )
        layers = from_file(inputs[0])
    elif any(are_tracks(path) for path in inputs):
        if len(inputs) > 1:
            raise UsageError(
                f"{' '.join(inputs)}: expected one file of tracks; name the pictures that they "
                "were made from with --images"
            )
        layers = [Setting("input.tracks", inputs[0], "TRACKS")]
    else:
        if any(setting.origin == "--images" for setting in settings):
            raise UsageError(
                f"--images: it goes with a file of tracks, but {inputs[0]} is an image; name all "
                "images without the option"
            )
        layers = [Setting("input.images", list(inputs), "IMAGE")]
    configuration = resolve([*layers, *settings, *from_text(assignments)])
    read = configuration.input
    if not read.images and read.tracks is None:
        raise ConfigurationError(
            f"{inputs[0]}: input.images is not set; name two images, a folder, a glob pattern or "
            "a video"
        )
    return configuration


def are_tracks(path: str) -> bool:
    """Whether an input is a file of tracks rather than pictures or a video, from its content."""
    from mssegment.imaging.pictures import looks_like_picture

    name = path if os.path.exists(path) else path.rpartition("#")[0] or path
    if path == STANDARD:
        return True
    if not os.path.isfile(name):
        return Path(name).suffix.lower() in _TRACK_FILES
    with Path(name).open("rb") as file:
        head = file.read(1024)
    if not head or looks_like_picture(name, head):
        return False
    from mssegment.datasets.containers import holds_data

    return holds_data(name, head)


def _tracks(configuration: Configuration, console: Console) -> TracksDocument | None:
    path = configuration.input.tracks
    if path is None:
        return None
    start = time.perf_counter()
    from mssegment import pipeline
    from mssegment.documents import read_document

    if path != STANDARD and _is_document(path):
        document = read_document(path, TracksDocument)
    else:
        document = pipeline.import_tracks(path)
    if configuration.input.images:
        document = pipeline.put_on_pictures(document, pipeline.open_input(configuration))
    console.stage("import", describe(document), time.perf_counter() - start)
    console.details(document)
    return document


def _is_document(path: str) -> bool:
    """Whether a file is one that ``mssegment`` wrote, and not the tracks of another program."""
    try:
        with Path(path).open("rb") as file:
            return file.read(200).lstrip().startswith(b"{") and _names_a_schema(path)
    except OSError:
        return False


def _names_a_schema(path: str) -> bool:
    content = Path(path).read_bytes()
    return b'"mssegment/' in content[:200] or b'"schema"' in content


def _write_documents(result: pipeline.Outcome, out: str) -> list[str]:
    """Write the document of each stage; the names of the files."""
    from mssegment.documents import write_document

    names = []
    for document in (result.corners, result.tracks, result.hypotheses, result.segmentation):
        if document is not None:
            names.append(f"{document.kind}.json")
            write_document(str(Path(out) / names[-1]), document)
    return names


def _finish(timings: Timings, names: list[str], out: str, console: Console) -> None:
    """Write timings.json and print the line of the report."""
    import msgspec

    from mssegment.documents import write_bytes

    content = {"seconds": timings.seconds, "peak_bytes": timings.peak_bytes, "files": names}
    write_bytes(
        str(Path(out) / "timings.json"),
        msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n",
    )
    console.stage("report", f"{len(names)} files in {out}", timings.seconds["report"])


def _profile(timings: Timings) -> str:
    total = sum(timings.seconds.values())
    lines = [f"{'stage':<12} {'seconds':>8} {'share':>6} {'peak MB':>8}"]
    for name, seconds in timings.seconds.items():
        peak = timings.peak_bytes[name] / 1e6
        lines.append(f"{name:<12} {seconds:8.3f} {seconds / total:6.0%} {peak:8.0f}")
    lines.append(f"{'total':<12} {total:8.3f}")
    return "\n".join(lines)
