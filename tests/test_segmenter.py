"""Windows segmented by a process of its own: the same files, and no process left."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from passing_bodies import SIZE, passing_bodies

from mssegment.clips.process import process
from mssegment.clips.segmenter import ProcessSegmenter, Segmenter, Task, new_segmenter
from mssegment.clips.track_clip import TrackClip
from mssegment.configuration import from_mapping, resolve
from mssegment.documents.clips import WindowDocument
from mssegment.errors import ConfigurationError
from mssegment.records import Frame
from mssegment.runs import open_tracks

FRAMES = 60
WINDOWS = {"sequence.window": 24, "sequence.overlap": 8}
CONFIGURATION = resolve(from_mapping(WINDOWS, "test"))
ORPHANED = """
import os, signal, sys
from mssegment.clips.segmenter import ProcessSegmenter
segmenter = ProcessSegmenter()
segmenter.start()
print(segmenter.process_id, flush=True)
if sys.argv[1] == "killed":
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> TrackClip:
    path = tmp_path_factory.mktemp("tracks") / "tracks.npz"
    np.savez(path, tracks=passing_bodies(np.random.default_rng(0), FRAMES, life=30)[0])
    found = open_tracks(resolve(from_mapping({"input.tracks": str(path), **WINDOWS}, "test")))
    assert isinstance(found, TrackClip)
    return found


@pytest.fixture
def segmenter() -> Iterator[ProcessSegmenter]:
    own = ProcessSegmenter()
    yield own
    own.stop()


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def done(clip: TrackClip, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("clip")
    process(clip, CONFIGURATION, folder)
    return contents(folder)


def test_a_process_of_its_own_changes_no_byte(
    clip: TrackClip, done: dict[str, bytes], tmp_path: Path, segmenter: ProcessSegmenter
) -> None:
    process(clip, CONFIGURATION, tmp_path, segmenter=segmenter)
    assert contents(tmp_path) == done
    assert not segmenter.said
    assert segmenter.peak_bytes > 1e7
    assert is_gone(segmenter.process_id)


def test_the_windows_of_a_process_that_died_are_segmented_here(
    clip: TrackClip, done: dict[str, bytes], tmp_path: Path, segmenter: ProcessSegmenter
) -> None:
    def kill(window: WindowDocument) -> None:
        if window.index == 0:
            os.kill(segmenter.process_id, 9)

    process(clip, CONFIGURATION, tmp_path, kill, segmenter)
    assert contents(tmp_path) == done
    (said,) = segmenter.said
    assert "has ended" in said


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals")
def test_an_interrupt_does_not_wait_for_a_window(
    clip: TrackClip, done: dict[str, bytes], tmp_path: Path, segmenter: ProcessSegmenter
) -> None:
    def stop(window: WindowDocument) -> None:
        os.kill(segmenter.process_id, signal.SIGSTOP)  # it never answers again
        os.kill(os.getpid(), signal.SIGINT)

    earlier = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(KeyboardInterrupt):
        process(clip, CONFIGURATION, tmp_path, stop, segmenter)
    signal.signal(signal.SIGINT, earlier)
    assert is_gone(segmenter.process_id)
    assert not segmenter.said
    process(clip, CONFIGURATION, tmp_path)
    assert contents(tmp_path) == done


@pytest.mark.parametrize("made", [Segmenter, ProcessSegmenter])
def test_errors_are_raised_where_the_window_came_from(made: Callable[[], Segmenter]) -> None:
    settings = {"camera.file": "no-such-camera.yaml"}
    own = made()
    own.start()
    task = Task(
        np.zeros((12, 8, 2)),
        [Frame("", *SIZE, "", index, None) for index in range(8)],
        resolve(from_mapping(settings, "test")),
        np.zeros(12, bool),
        np.zeros(12, bool),
        None,
        (),
    )
    with pytest.raises(ConfigurationError, match=r"no-such-camera\.yaml"):
        own.segment(task)
    own.stop()


@pytest.mark.parametrize("end", ["killed", "done"])
def test_it_ends_with_whoever_asks(end: str) -> None:
    asks = subprocess.run(
        [sys.executable, "-c", ORPHANED, end], capture_output=True, text=True, check=False
    )
    assert is_gone(int(asks.stdout))
    assert asks.stderr == ""


def is_gone(number: int) -> bool:
    """Whether a process ends within some seconds."""
    until = time.monotonic() + 20
    while time.monotonic() < until:
        try:
            os.kill(number, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


def test_one_processor_has_no_use_for_a_process(monkeypatch: pytest.MonkeyPatch) -> None:
    for count, kind in ((1, Segmenter), (2, ProcessSegmenter)):
        monkeypatch.setattr("mssegment.clips.segmenter.processors", lambda count=count: count)
        assert type(new_segmenter(own_process=True)) is kind
    assert type(new_segmenter(own_process=False)) is Segmenter
