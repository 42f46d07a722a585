"""Progress: every stage says how far it has come, and says nothing where nobody listens."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mssegment import pipeline
from mssegment.cli import invoke
from mssegment.configuration import from_mapping, resolve
from mssegment.progress import listening, track

SAMPLES = Path(__file__).parents[1] / "sample_data"


@pytest.mark.parametrize(
    ("scene", "frames", "stages"),
    [("affine", 2, {"detect", "match", "hypothesize", "cluster"}), ("factorization", 5, set())],
)
def test_every_stage_counts_what_it_does(scene: str, frames: int, stages: set[str]) -> None:
    stages = stages or {"detect", "match", "hypothesize", "cluster"}
    images = [str(SAMPLES / scene / f"frame-{i}.png") for i in range(1, frames + 1)]
    stage = ["read"]
    heard: dict[str, list[tuple[int, int | None, str]]] = {}

    def listen(done: int, total: int | None, what: str) -> None:
        heard.setdefault(stage[0], []).append((done, total, what))

    def on_stage(name: str, document: object, timings: object) -> None:
        stage[0] = name

    with listening(listen):
        pipeline.run(resolve(from_mapping({"input.images": images}, "test")), on_stage=on_stage)
    assert {"read", *stages} <= set(heard)
    assert (frames, frames, "frames") in heard["detect"]
    for calls in heard.values():
        assert all(total is None or 0 <= done <= total for done, total, _ in calls)


def test_a_loop_that_ends_early_and_one_without_length() -> None:
    calls: list[tuple[int, int | None, str]] = []
    with listening(lambda *call: calls.append(call)):
        for letter in track("abc", "letters"):
            if letter == "b":
                break
        assert list(track(iter([1, 2]), "numbers")) == [1, 2]
    assert calls == [(0, 3, "letters"), (1, 3, "letters")] + [
        (done, None, "numbers") for done in range(3)
    ]
    assert list(track("ab", "letters")) == ["a", "b"]
    assert len(calls) == 5


def test_the_bar_is_alive_on_a_terminal_and_only_there(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    images = [str(SAMPLES / "factorization" / f"frame-{i}.png") for i in range(1, 6)]
    command = [sys.executable, "-c", "from mssegment.cli import main; main()", "run", *images]
    ours, theirs = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"}
    environment |= {"TERM": "xterm", "COLUMNS": "120"}
    process = subprocess.Popen(
        [*command, "--out", str(tmp_path / "out"), "--set", "report.html=no"],
        stdout=subprocess.DEVNULL,
        stderr=theirs,
        env=environment,
    )
    os.close(theirs)
    seen = b""
    while True:
        try:
            part = os.read(ours, 4096)
        except OSError:
            break
        if not part:
            break
        seen += part
    os.close(ours)
    assert process.wait() == 0
    text = re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", seen.decode())
    assert re.search(r"\d+/5 frames", text)
    assert invoke(["detect", *images[:2], "-o", str(tmp_path / "c.json")]) == 0
    assert "frames" not in capfd.readouterr().err
