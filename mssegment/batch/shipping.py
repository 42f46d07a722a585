"""Items for workers that share no disk with this machine: files go there, results come back.

The files of an item are written below a temporary folder of the worker, at paths that end in those
that the user gave. In what comes back, the temporary folder is cut off again, so that the results
are those of a run on this machine.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from mssegment.batch.fingerprint import Fingerprint
from mssegment.batch.work import Outcome, Task, facts_of, segment_item
from mssegment.configuration import Configuration
from mssegment.documents import write_bytes
from mssegment.errors import DataError, OutputError
from mssegment.folders import result_folder
from mssegment.records import Record, replace
from mssegment.runs import recorded_files


class Parcel(Record, frozen=True):
    """A task with the content of its files, and the names of files that only have to be there."""

    task: Task
    files: dict[str, bytes]
    beside: list[str]


class Answer(Record, frozen=True):
    """What became of an item, and the files of its folder."""

    outcome: Outcome
    files: dict[str, bytes]


def packed(task: Task) -> Parcel:
    """A task with its files; raises DataError if one cannot be read any more."""
    files = {}
    for path in task.fingerprint.files:
        try:
            files[path] = Path(path).read_bytes()
        except OSError as error:
            raise DataError(f"{path}: cannot be read ({error.strerror})") from None
    folders = [given for given in task.configuration.input.images if os.path.isdir(given)]
    listed = [os.path.join(folder, name) for folder in folders for name in os.listdir(folder)]
    beside = [path for path in listed if path not in files and os.path.isfile(path)]
    return Parcel(task, files, sorted(beside))


def segment_parcel(parcel: Parcel) -> Answer:
    """Segment an item in a worker, in a temporary folder that is removed."""
    with tempfile.TemporaryDirectory(prefix="mssegment-") as folder:
        place = _Place(folder, [*parcel.files, *parcel.beside])
        for path, content in [*parcel.files.items(), *((path, b"") for path in parcel.beside)]:
            moved = Path(place.moved(path))
            moved.parent.mkdir(parents=True, exist_ok=True)
            moved.write_bytes(content)
        task = parcel.task
        out = Path(folder) / "out" / task.name
        of = task.fingerprint
        outcome = segment_item(
            replace(
                task,
                configuration=_with_paths(task.configuration, place.moved),
                out=str(out),
                fingerprint=Fingerprint(
                    of.digest, {place.moved(p): h for p, h in of.files.items()}
                ),
            )
        )
        names = [path for path in out.rglob("*") if path.is_file()] if out.exists() else []
        files = {str(path.relative_to(out)): place.cut_off(path.read_bytes()) for path in names}
    error = place.cut_off(outcome.error.encode()).decode()
    return Answer(replace(outcome, error=error, facts=facts_of(files)), files)


def unpacked(task: Task, answer: Answer) -> Outcome:
    """Write the folder of an item on this machine."""
    if answer.outcome.error:
        return answer.outcome
    try:
        with result_folder(task.out, replace=True) as folder:
            for name, content in answer.files.items():
                path = folder.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                write_bytes(str(path), content)
            folder.stale += recorded_files(task.out)
    except OutputError as error:
        return Outcome(error=str(error), status=error.status, cannot_write=True)
    return answer.outcome


class _Place:
    """Where the files of an item lie in a worker."""

    def __init__(self, folder: str, paths: Sequence[str]) -> None:
        upwards = max(os.path.normpath(path).split(os.sep).count("..") for path in [*paths, "."])
        self._absolute = f"{folder}/root"
        self._relative = "/".join([folder, "here", *["down"] * upwards])
        Path(self._relative).mkdir(parents=True)

    def moved(self, path: str) -> str:
        """The path in the worker."""
        return f"{self._absolute}{path}" if os.path.isabs(path) else f"{self._relative}/{path}"

    def cut_off(self, content: bytes) -> bytes:
        """Text with the paths that the user gave."""
        content = content.replace(self._absolute.encode(), b"")
        return content.replace(f"{self._relative}/".encode(), b"")


def _with_paths(configuration: Configuration, moved: Callable[[str], str]) -> Configuration:
    """The configuration with other paths."""
    read, camera, report = configuration.input, configuration.camera, configuration.report
    of = msgspec.structs.replace
    return of(
        configuration,
        input=of(
            read,
            images=[moved(path) for path in read.images],
            tracks=None if read.tracks is None else moved(read.tracks),
        ),
        camera=of(camera, file=None if camera.file is None else moved(camera.file)),
        report=of(report, labels=[moved(path) for path in report.labels]),
    )
