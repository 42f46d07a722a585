"""One run: its input, and all stages into a folder of results."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from mssegment import pipeline
from mssegment.configuration import Configuration
from mssegment.documents import (
    STANDARD,
    Document,
    TracksDocument,
    read_document,
    write_bytes,
    write_document,
)
from mssegment.folders import ResultFolder
from mssegment.inputs.files import is_pipe, read_file
from mssegment.records import Record
from mssegment.resources import Timings
from mssegment.results import Results

if TYPE_CHECKING:
    from mssegment.clips.track_clip import TrackClip
    from mssegment.documents.clips import ClipDocument
    from mssegment.imaging.streams import Clip

RECORD = "timings.json"
"""The file of a run that lists the files which it wrote."""
_TRACK_FILES = (".csv", ".mat", ".json", ".npy", ".npz", ".tsv", ".txt", ".h5", ".hdf5", ".db")
"""Suffixes of files of tracks, for those that do not exist."""


class Run(Record, frozen=True):
    """What was written: the results, the names of the files, and how long each stage took."""

    results: Results
    names: list[str]
    timings: Timings


def write_run(
    configuration: Configuration,
    tracks: TracksDocument | None,
    folder: ResultFolder,
    out: str,
    *,
    threads: int = 1,
    on_stage: Callable[[str, Document | None, Timings], None] = lambda name, document, timings: (
        None
    ),
    further: Callable[[Run], dict[str, bytes]] = lambda run: {},
) -> Run:
    """Run all stages and write every file of the results.

    Parameters
    ----------
    configuration : Configuration
        The settings.
    tracks : TracksDocument, optional
        Tracks to segment, as from ``open_tracks``; by default they are detected in images.
    folder : ResultFolder
        Where to write. The files of an earlier run, by its own record, become stale.
    out : str
        The folder that ``folder`` becomes.
    threads : int
        Number of threads of mean shift.
    on_stage : callable
        As in ``pipeline.run``.
    further : callable
        Gives more files for the folder, by their names.

    Returns
    -------
    Run

    Raises
    ------
    DataError, ConfigurationError, UsageError
        Like the stages, and if a file cannot be written.
    """
    found = pipeline.run(configuration, tracks, threads=threads, on_stage=on_stage)
    on_stage("report", None, found.timings)
    with found.timings.stage("report"):
        results = Results.of(found.segmentation, configuration, found.source)
        results = results.with_masks()
        run = Run(results, write_files(found, results, folder, out), found.timings)
        for name, content in further(run).items():
            write_bytes(str(folder.path / name), content)
            run.names.append(name)
    _write_record(run, folder)
    return run


class ClipRun(Record, frozen=True):
    """What was written of a long clip, how long it took, and what is to be said of it."""

    document: ClipDocument
    names: list[str]
    timings: Timings
    said: list[str]


def write_clip_run(
    clip: Clip | TrackClip,
    configuration: Configuration,
    folder: ResultFolder,
    out: str,
    *,
    own_process: bool = False,
    further: Callable[[ClipRun], dict[str, bytes]] = lambda run: {},
) -> ClipRun:
    """Segment a long clip (``clips.choice.clip_of``) window by window, and write every file.

    With a ``folder`` of the key ``clips.choice.key_of``, an interrupted run goes on. With
    ``own_process``, windows are segmented in a process of their own, beside the tracking.
    ``further`` gives more files, as in ``write_run``.

    Raises DataError if a frame cannot be read, UsageError if a file cannot be written.
    """
    from mssegment.clips.results import write_results

    timings = Timings()
    with timings.stage("clip"):
        found = write_results(clip, configuration, folder.path, own_process=own_process)
        run = ClipRun(found.document, found.names, timings, found.said)
        for name, content in further(run).items():
            write_bytes(str(folder.path / name), content)
            run.names.append(name)
    timings.peak_bytes["clip"] += found.beside_bytes
    _mark_stale(folder, out, clip.paths)
    _write_record(run, folder)
    return run


def write_files(
    found: pipeline.Outcome, results: Results, folder: ResultFolder, out: str
) -> list[str]:
    """Write the document of each stage and the files of the results; their names.

    The files of an earlier run into ``out`` become stale, but none that was read.
    """
    names = []
    for document in (found.corners, found.tracks, found.hypotheses, found.segmentation):
        if document is not None:
            names.append(f"{document.kind}.json")
            write_document(str(folder.path / names[-1]), document)
    names += results.write(str(folder.path))
    _mark_stale(folder, out, [frame.path for frame in found.segmentation.frames])
    return names


def _mark_stale(folder: ResultFolder, out: str, paths: Iterable[str]) -> None:
    """Let the files of an earlier run into ``out`` become stale, but none that was read."""
    read = {os.path.realpath(path) for path in paths}
    folder.stale += [
        name for name in recorded_files(out) if os.path.realpath(Path(out) / name) not in read
    ]


def _write_record(run: Run | ClipRun, folder: ResultFolder) -> None:
    timings = run.timings
    content = {"seconds": timings.seconds, "peak_bytes": timings.peak_bytes, "files": run.names}
    encoded = msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n"
    write_bytes(str(folder.path / RECORD), encoded)


def recorded_files(out: str) -> list[str]:
    """The files that an earlier run wrote into the folder ``out``, by its own record; and that."""
    try:
        content = msgspec.json.decode((Path(out) / RECORD).read_bytes())
        names = content["files"]
    except (OSError, KeyError, TypeError, msgspec.MsgspecError):
        return []
    paths = [Path(name) for name in names if isinstance(name, str)]
    inside = [path for path in paths if not path.is_absolute() and ".." not in path.parts]
    return [*(str(path) for path in inside), RECORD]


def open_tracks(configuration: Configuration) -> TracksDocument | TrackClip | None:
    """Read the tracks of ``input.tracks``, put on the pictures of ``input.images`` if it has any.

    A clip if they have more frames than one window; None if the configuration names no tracks.
    Raises DataError if they cannot be read.
    """
    path = configuration.input.tracks
    if path is None:
        return None
    if path != STANDARD and not is_pipe(path) and _is_document(path):
        document = read_document(path, TracksDocument)
        if configuration.input.images:
            document = pipeline.put_on_pictures(document, pipeline.open_input(configuration))
        if not document.of_pictures or not _has_windows(len(document.frames), configuration):
            return document
        from mssegment.clips.open_tracks import clip_of_document

        return clip_of_document(path, document)
    if is_for_data(configuration):
        return pipeline.import_points(path)
    found = pipeline.read_tracks(path)
    source = pipeline.open_input(configuration) if configuration.input.images else None
    if not _has_windows(len(found.frames), configuration):
        return pipeline.document_of(found, source)
    from mssegment.clips.open_tracks import clip_of_tracks

    return clip_of_tracks(path, found, source)


def _has_windows(frames: int, configuration: Configuration) -> bool:
    """Whether so many frames are segmented in windows; without loading what two views need not."""
    if frames <= 2:
        return False
    from mssegment.clips.choice import has_windows

    return has_windows(frames, configuration)


def is_configuration(path: str) -> bool:
    """Whether an input is a configuration file: YAML, but not that of OpenCV's FileStorage."""
    if Path(path).suffix.lower() not in (".yaml", ".yml"):
        return False
    if not os.path.isfile(path):
        return True
    with Path(path).open("rb") as file:
        return not file.read(16).startswith(b"%YAML")


def is_for_data(configuration: Configuration) -> bool:
    """Whether the model is one of data that is no picture, so that the input is such data."""
    from mssegment.models import MODELS

    name = configuration.hypothesize.model
    return name != "auto" and not MODELS[name].of_pictures


def are_tracks(path: str) -> bool:
    """Whether an input is a file of tracks rather than pictures or a video, from its content."""
    from mssegment.imaging.pictures import looks_like_picture

    name = path if os.path.exists(path) else path.rpartition("#")[0] or path
    if path == STANDARD or is_pipe(name):  # pictures are read more than once
        return True
    if not os.path.isfile(name):
        return Path(name).suffix.lower() in _TRACK_FILES
    with Path(name).open("rb") as file:
        head = file.read(1024)
    if not head or looks_like_picture(name, head):
        return False
    from mssegment.datasets.containers import holds_data

    return holds_data(name, head)


def _is_document(path: str) -> bool:
    """Whether a file is one that ``mssegment`` wrote, and not the tracks of another program."""
    try:
        with Path(path).open("rb") as file:
            return file.read(200).lstrip().startswith(b"{") and _names_a_schema(path)
    except OSError:
        return False


def _names_a_schema(path: str) -> bool:
    content = read_file(path)
    return b'"mssegment/' in content[:200] or b'"schema"' in content
