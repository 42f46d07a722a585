"""Who segments windows: the thread that asks, or a process of its own beside the tracking.

Following tracks and segmenting windows take about as long as each other, and in one process Python
runs one of them at a time. The process is this module, started anew: it does not import the program
that asks, so that no guard of ``__main__`` is needed. It has no files; it gets windows through a
pipe and answers through another one, so it ends with whoever asks, however that ends.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import traceback
import warnings
from collections.abc import Sequence
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from mssegment.clips.segment import SegmentedWindow, segment_window
from mssegment.configuration import Configuration, limits_of
from mssegment.documents import HistoryEntry
from mssegment.inputs import limits
from mssegment.records import Camera, Floats, Frame, Record
from mssegment.resources import keep_freed_memory, peak_bytes, processors

_PROGRAM = "import sys; sys.path[:] = {paths!r}; from {module} import serve; serve()"


class Task(Record, frozen=True):
    """A window to be segmented: the arguments of ``segment_window``."""

    points: Floats
    frames: Sequence[Frame]
    configuration: Configuration
    earlier_background: npt.NDArray[np.bool_]
    moved_before: npt.NDArray[np.bool_]
    camera: Camera | None
    history: Sequence[HistoryEntry]

    def segment(self) -> SegmentedWindow:
        """Do it here."""
        return segment_window(
            self.points,
            self.frames,
            self.configuration,
            earlier_background=self.earlier_background,
            moved_before=self.moved_before,
            camera=self.camera,
            history=self.history,
        )


class _Answer(Record, frozen=True):
    """What became of a window: its segmentation, or the error; and the peak memory so far."""

    found: SegmentedWindow | None
    error: Exception | None
    peak_bytes: int


class Segmenter:
    """Segments windows in the thread that asks.

    Attributes
    ----------
    said : list of str
        What the user should know.
    peak_bytes : int
        The peak memory of other processes.
    """

    def __init__(self) -> None:
        self.said: list[str] = []
        self.peak_bytes = 0

    def start(self) -> None:
        """Prepare for the first window."""

    def segment(self, task: Task) -> SegmentedWindow:
        """Segment a window; raises what ``segment_window`` raises."""
        return task.segment()

    def stop(self) -> None:
        """There are no more windows; what is being segmented is not wanted."""


class ProcessSegmenter(Segmenter):
    """Segments windows in a process of its own, with the same result.

    If that process dies, as where memory is short, windows are segmented in this one, which is
    ``said``.
    """

    def __init__(self) -> None:
        super().__init__()
        self._child: subprocess.Popen[bytes] | None = None
        self._stopped = self._died = False

    def start(self) -> None:
        """Start the process, which loads its modules by the time of the first window."""
        program = _PROGRAM.format(paths=[str(path) for path in sys.path], module=__name__)
        # Ctrl-C goes to the group of this process
        group: dict[str, Any] = (
            {"creationflags": getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0)}
            if sys.platform == "win32"
            else {"process_group": 0}
        )
        self._child = subprocess.Popen(
            [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, **group
        )

    @property
    def process_id(self) -> int:
        """The number of the process."""
        assert self._child is not None
        return self._child.pid

    def segment(self, task: Task) -> SegmentedWindow:
        """Have the process segment a window; raises what ``segment_window`` raises."""
        child = self._child
        if child is None or self._died:
            return task.segment()
        try:
            answer = _ask(child, task)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            if self._stopped:
                raise InterruptedError("stopped") from error
            self._died = True
            self.said.append(
                f"the process that segments windows has ended (status {child.wait()}); the others "
                "were segmented in the main process, which takes longer"
            )
            return task.segment()
        self.peak_bytes = answer.peak_bytes
        if answer.error is not None:
            raise answer.error
        assert answer.found is not None
        return answer.found

    def stop(self) -> None:
        """End the process."""
        self._stopped = True
        child = self._child
        if child is not None:
            child.kill()
            child.wait()


def _ask(child: subprocess.Popen[bytes], task: Task) -> _Answer:
    assert child.stdin is not None
    assert child.stdout is not None
    pickle.dump(task, child.stdin, pickle.HIGHEST_PROTOCOL)
    child.stdin.flush()
    answer: _Answer = pickle.load(child.stdout)
    return answer


def new_segmenter(*, own_process: bool) -> Segmenter:
    """A segmenter; with ``own_process``, where there is a second core and a Python, a process."""
    has_python = bool(sys.executable) and not getattr(sys, "frozen", False)
    return ProcessSegmenter() if own_process and has_python and processors() > 1 else Segmenter()


def serve() -> None:
    """In the process: answer windows until whoever asks is gone."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # they are for whoever asks
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # whatever a library prints
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(sys.stdin.buffer, tasks), daemon=True).start()
    warnings.simplefilter("ignore", RuntimeWarning)
    keep_freed_memory()
    while True:
        pickle.dump(_answer(tasks.get()), answers, pickle.HIGHEST_PROTOCOL)
        answers.flush()


def _receive(pipe: IO[bytes], tasks: queue.SimpleQueue[Task]) -> None:
    """Take in tasks; the end of the pipe is that of this process, whatever it is doing."""
    while True:
        try:
            tasks.put(pickle.load(pipe))
        except (EOFError, OSError, pickle.UnpicklingError):
            os._exit(0)


def _answer(task: Task) -> _Answer:
    try:
        with limits.using(limits_of(task.configuration)):
            return _Answer(task.segment(), None, peak_bytes())
    except Exception as error:  # it is raised where the window came from
        error.add_note(traceback.format_exc())
        return _Answer(None, error, peak_bytes())
