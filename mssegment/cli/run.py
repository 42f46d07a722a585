"""``mssegment run``."""

from __future__ import annotations

import sys
import time
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
from mssegment.cli.output_checks import check_outputs
from mssegment.cli.sentences import describe
from mssegment.configuration import (
    Configuration,
    Setting,
    from_file,
    from_text,
    limits_of,
    resolve,
)
from mssegment.documents import Document, TracksDocument
from mssegment.errors import ConfigurationError, UsageError
from mssegment.inputs import limits

if TYPE_CHECKING:
    from mssegment.clips.track_clip import TrackClip
    from mssegment.imaging.streams import Clip
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


@click.command(
    short_help=COMMANDS["run"],
    epilog="Example:  mssegment run 1.png 2.png --model affine --out out",
)
@click.argument(
    "inputs",
    nargs=-1,
    required=True,
    metavar="CONFIG.yaml | IMAGE... | TRACKS | POINTS",
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
    on the pictures that --images names. With a model of data that is no picture, such as plane, it
    is a table of points, a point cloud or an array. The output is the document of each stage,
    report.json, timings.json, annotated pictures and report.html.
    """
    configuration = _configuration(inputs, settings, assignments)
    click.get_current_context().with_resource(limits.using(limits_of(configuration)))
    tracks = _tracks(configuration, console)
    if configuration.report.labels:
        from mssegment.ground_truth import check_labels

        check_labels(configuration.report.labels)
    from mssegment.clips.choice import clip_of
    from mssegment.folders import result_folder
    from mssegment.results import FramePictures
    from mssegment.runs import write_run

    clip = clip_of(configuration, tracks)
    check_outputs(configuration, not isinstance(tracks, TracksDocument) or tracks.of_pictures)
    if clip is not None:
        _run_clip(clip, configuration, out, force, profile, chosen_format(form, console), console)
        return
    assert tracks is None or isinstance(tracks, TracksDocument)
    if configuration.report.masks and tracks is not None and FramePictures(tracks)(0) is None:
        raise UsageError(
            "--masks: there are no pictures of these tracks; name those that they were made from "
            "with --images"
        )
    with result_folder(out, replace=force) as folder:
        from mssegment.resources import keep_freed_memory

        keep_freed_memory()
        with console.working("read") as progress:

            def on_stage(name: str, document: Document | None, timings: Timings) -> None:
                if document is None:
                    progress(name)
                else:
                    console.stage(name, describe(document), timings.seconds[name])
                    console.details(document.history)

            run = write_run(configuration, tracks, folder, out, threads=threads, on_stage=on_stage)
        seconds = run.timings.seconds["report"]
        console.stage("report", f"{len(run.names)} files in {out}", seconds)
        for said in run.results.said:
            console.note(said)
    if profile:
        print(_profile(run.timings), file=sys.stderr)
    from mssegment.rendering.tables import format_report

    put(format_report(run.results.report, chosen_format(form, console)))


def _run_clip(
    clip: Clip | TrackClip,
    configuration: Configuration,
    out: str,
    force: bool,
    profile: bool,
    form: str,
    console: Console,
) -> None:
    """Segment a long clip in windows, going on with the windows of an interrupted run."""
    from mssegment.clips.choice import key_of
    from mssegment.folders import result_folder
    from mssegment.rendering.clip_tables import clip_summary, format_clip
    from mssegment.resources import keep_freed_memory
    from mssegment.runs import write_clip_run

    keep_freed_memory()

    with result_folder(out, replace=force, key=key_of(clip, configuration)) as folder:
        if folder.resumed:
            console.note(f"going on with the finished windows in {folder.path}")
        with console.working("clip"):
            try:
                run = write_clip_run(clip, configuration, folder, out, own_process=True)
            except KeyboardInterrupt:
                console.note(f"the finished windows are in {folder.path}; the same command goes on")
                raise
        console.stage("clip", clip_summary(run.document), run.timings.seconds["clip"])
        for said in run.said:
            console.note(said)
    if profile:
        print(_profile(run.timings), file=sys.stderr)
    put(format_clip(run.document, form))


def _configuration(
    inputs: tuple[str, ...], settings: list[Setting], assignments: tuple[str, ...]
) -> Configuration:
    """Precedence: option, environment, configuration file, default.

    The images on the command line count as an option.
    """
    from mssegment.runs import are_tracks, is_configuration, is_for_data

    layers: list[Setting] = []
    if any(is_configuration(path) for path in inputs):
        if len(inputs) > 1:
            raise UsageError(
                f"{' '.join(inputs)}: expected one configuration file, or images, not both"
            )
        layers = from_file(inputs[0])
    elif is_for_data(resolve([*settings, *from_text(assignments)])):
        if len(inputs) > 1:
            raise UsageError(f"{' '.join(inputs)}: expected one file of points")
        layers = [Setting("input.tracks", inputs[0], "POINTS")]
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


def _tracks(configuration: Configuration, console: Console) -> TracksDocument | TrackClip | None:
    if configuration.input.tracks is None:
        return None
    start = time.perf_counter()
    from mssegment.runs import open_tracks

    tracks = open_tracks(configuration)
    assert tracks is not None
    said = (
        describe(tracks)
        if isinstance(tracks, TracksDocument)
        else f"{len(tracks.ids)} tracks over {len(tracks.frames)} frames"
    )
    console.stage("import", said, time.perf_counter() - start)
    console.details(tracks.history)
    return tracks


def _profile(timings: Timings) -> str:
    total = sum(timings.seconds.values())
    lines = [f"{'stage':<12} {'seconds':>8} {'share':>6} {'peak MB':>8}"]
    for name, seconds in timings.seconds.items():
        peak = timings.peak_bytes[name] / 1e6
        lines.append(f"{name:<12} {seconds:8.3f} {seconds / total:6.0%} {peak:8.0f}")
    lines.append(f"{'total':<12} {total:8.3f}")
    return "\n".join(lines)
