"""Working on one item: the function that runs in a worker, on this machine or on another."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from pathlib import Path

import msgspec

from mssegment.batch.fingerprint import Fingerprint
from mssegment.clips.choice import clip_of, key_of
from mssegment.clips.track_clip import TrackClip
from mssegment.configuration import Configuration, limits_of
from mssegment.errors import DataError, ExitStatus, MssegmentError, OutputError
from mssegment.folders import result_folder, sweep
from mssegment.inputs import limits
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Record
from mssegment.rendering.report import Report
from mssegment.runs import ClipRun, Run, open_tracks, write_clip_run, write_run
from mssegment.version import __version__

FACTS = "item.json"
"""The file in the folder of an item that says what it was made from."""
WAIT = 60.0
"""Seconds to wait for a process of an earlier batch that still writes the folder of an item."""


class Task(Record, frozen=True):
    """What a worker has to do.

    Attributes
    ----------
    name : str
        The item.
    configuration : Configuration
        All settings.
    out : str
        The folder of the results.
    fingerprint : Fingerprint
        Of the item.
    folder : str
        The working folder of the sender, to which relative paths are relative.
    version : str
        That of the sender; the worker's must be the same.
    """

    name: str
    configuration: Configuration
    out: str
    fingerprint: Fingerprint
    folder: str
    version: str = __version__


class Facts(Record, frozen=True):
    """What an item was made from and what was found; equal for equal input and settings.

    Attributes
    ----------
    fingerprint : str
        Of its files, its settings and the version.
    files : dict
        SHA-256 of each file.
    frames, tracks, outliers, background, not_judged : int
        Counts.
    motions : list of int
        The number of tracks of each motion.
    camera_motion : int or None
        The label of the motion of the static world under a moving camera.
    misclassification : float or None
        Share of the evaluated tracks, with true labels.
    notes : list of str
        Notes of all stages.
    page, picture : str or None
        Names of the HTML report and of a picture among the files.
    """

    name: str
    version: str
    fingerprint: str
    files: dict[str, str]
    frames: int
    tracks: int
    motions: list[int]
    outliers: int
    background: int
    not_judged: int
    camera_motion: int | None
    misclassification: float | None
    notes: list[str]
    page: str | None
    picture: str | None


class Outcome(Record, frozen=True):
    """What became of an item in a worker.

    Attributes
    ----------
    facts : Facts or None
        None if it failed.
    error : str
        Why it failed.
    status : int
        The exit status of the same failure of ``mssegment run``; ``ExitStatus.USAGE`` if the
        results cannot be written, which is no fault of the item.
    was_there : bool
        Whether an earlier worker had finished it without being able to say so.
    """

    facts: Facts | None = None
    error: str = ""
    status: int = ExitStatus.DONE
    seconds: float = 0.0
    worker: str = ""
    was_there: bool = False
    cannot_write: bool = False


def segment_item(task: Task) -> Outcome:
    """Segment one item into its folder, unless its result is there already.

    Errors of the item are part of the outcome, so that they cross from process to process.
    """
    start = time.perf_counter()
    worker = f"{os.uname().nodename if hasattr(os, 'uname') else ''}:{os.getpid()}"
    was_there, cannot_write = False, False
    facts: Facts | None = None
    error, status = "", ExitStatus.DONE
    try:
        _check(task)
        sweep(task.out, wait=WAIT, keep=True)
        facts = read_facts(task.out)
        was_there = facts is not None and facts.fingerprint == task.fingerprint.digest
        if not was_there:
            facts = _run(task)
    except OutputError as failure:
        error, status, cannot_write = str(failure), failure.status, True
    except MssegmentError as failure:
        error, status = str(failure), failure.status
    except Exception as failure:  # a bug on one item must not end the others
        error, status = f"unexpected {type(failure).__name__}: {failure}", ExitStatus.UNFORESEEN
    return Outcome(
        facts=None if error else facts,
        error=" ".join(error.split()),
        status=status,
        seconds=time.perf_counter() - start,
        worker=worker,
        was_there=was_there,
        cannot_write=cannot_write,
    )


def _check(task: Task) -> None:
    """Raises DataError if this process cannot do what the sender would."""
    if task.version != __version__:
        raise DataError(
            f"a worker has mssegment {__version__}, expected {task.version} as where the batch was "
            "started; install the same version"
        )
    relative = next((path for path in task.fingerprint.files if not os.path.isabs(path)), None)
    if relative is not None and os.getcwd() != task.folder:
        raise DataError(
            f"{relative}: a path relative to {task.folder}, but a worker runs in {os.getcwd()}; "
            "name absolute paths, or start the workers in the same folder"
        )


def read_facts(out: str) -> Facts | None:
    """What the result in a folder was made from; None if there is no whole one."""
    try:
        return facts_of({FACTS: (Path(out) / FACTS).read_bytes()})
    except OSError:
        return None


def facts_of(files: Mapping[str, bytes]) -> Facts | None:
    """What some files were made from; None if they do not say so."""
    try:
        return msgspec.json.decode(files[FACTS], type=Facts)
    except (KeyError, msgspec.DecodeError):
        return None


def _run(task: Task) -> Facts:
    made: list[Facts] = []

    def as_file(facts: Facts) -> dict[str, bytes]:
        made.append(facts)
        return {FACTS: msgspec.json.format(msgspec.json.encode(facts), indent=1) + b"\n"}

    with limits.using(limits_of(task.configuration)):
        tracks = open_tracks(task.configuration)
        clip = clip_of(task.configuration, tracks)
        key = None if clip is None else key_of(clip, task.configuration)
        with result_folder(task.out, replace=True, wait=WAIT, key=key) as folder:
            if clip is not None:
                write_clip_run(
                    clip,
                    task.configuration,
                    folder,
                    task.out,
                    further=lambda run: as_file(_facts_of_clip(task, run)),
                )
            else:
                assert not isinstance(tracks, TrackClip)
                write_run(
                    task.configuration,
                    tracks,
                    folder,
                    task.out,
                    further=lambda run: as_file(_facts(task, run)),
                )
    return made[0]


def _facts_of_clip(task: Task, run: ClipRun) -> Facts:
    """The facts of a clip in windows: its objects are the motions."""
    document = run.document
    stills = [name for name in run.names if name.startswith("stills/")]
    return Facts(
        name=task.name,
        version=task.version,
        fingerprint=task.fingerprint.digest,
        files=task.fingerprint.files,
        frames=document.frames,
        tracks=document.tracks,
        motions=[one.tracks for one in document.whole_objects],
        outliers=0,
        background=0,
        not_judged=0,
        camera_motion=next((1 for one in document.whole_objects if one.identity == 0), None),
        misclassification=None,
        notes=document.notes,
        page="report.html" if "report.html" in run.names else None,
        picture=min(stills, default=None),
    )


def _facts(task: Task, run: Run) -> Facts:
    report: Report = run.results.report
    pictures = [name for name in run.names if name.rpartition(".")[0] in ("overlay", "points")]
    evaluation = report.evaluation
    return Facts(
        name=task.name,
        version=task.version,
        fingerprint=task.fingerprint.digest,
        files=task.fingerprint.files,
        frames=len(report.frames),
        tracks=len(report.labels),
        motions=[len(report.members(motion.label)) for motion in report.motions],
        outliers=len(report.members(OUTLIER)),
        background=len(report.members(BACKGROUND)),
        not_judged=len(report.members(NOT_JUDGED)),
        camera_motion=report.camera_motion,
        misclassification=None if evaluation is None else evaluation.misclassification,
        notes=list(report.notes),
        page="report.html" if "report.html" in run.names else None,
        picture=min(pictures, default=None),
    )
