"""Batches: each item whole, once, the same whoever works on it; only what is missing is done."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from mssegment.batch import Batch, items_of, pools
from mssegment.batch.fingerprint import fingerprint
from mssegment.batch.ledger import LEDGER, Entry, Ledger
from mssegment.batch.shipping import packed, segment_parcel, unpacked
from mssegment.batch.work import Outcome, Task, segment_item
from mssegment.cli import invoke
from mssegment.configuration import Setting
from mssegment.errors import ConfigurationError, DataError, ExitStatus, MssegmentError

SAMPLES = Path(__file__).parents[1] / "sample_data" / "affine"
MSSEGMENT = [sys.executable, "-m", "mssegment"]
QUICK = ["--set", "report.pictures=no", "--set", "report.html=no", "--model", "affine"]
"""Options with which a small item takes a few hundredths of a second."""


def write_matches(path: Path, seed: int) -> Path:
    """Two motions and a few mismatches, as a table of matches."""
    rng = np.random.default_rng(seed)
    first = rng.uniform(0, 480, (90, 2))
    second = np.where(np.arange(90)[:, None] < 45, first + 12, 1.1 * first - 30)
    second[80:] = rng.uniform(0, 480, (10, 2))
    np.savetxt(path, np.hstack([first, second]), delimiter=",", header="x1,y1,x2,y2", comments="")
    return path


@pytest.fixture
def matches(tmp_path: Path) -> Path:
    """A folder with four files of tracks."""
    folder = tmp_path / "matches"
    folder.mkdir()
    for seed in range(4):
        write_matches(folder / f"{seed}.csv", seed)
    return folder


class Here:
    """A pool that does the work at once, in this process: no process has to be started."""

    width = 1
    is_lost = False

    def submit(self, task: Task) -> Future[Outcome]:
        future: Future[Outcome] = Future()
        future.set_result(segment_item(task))
        return future

    def stop(self) -> None: ...


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Batches without ``--scheduler`` work in this process."""
    monkeypatch.setattr(pools, "local_pool", lambda jobs, threads: nullcontext(Here()))


def run(*arguments: object) -> int:
    return invoke(["batch", *map(str, arguments), *QUICK, "-q"])


def contents(out: Path) -> dict[str, bytes]:
    """All files but those that hold times."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in out.rglob("*")
        if path.is_file() and path.name not in ("timings.json", LEDGER)
    }


def ledger_of(out: Path) -> list[Entry]:
    ledger = Ledger(out)
    ledger.close()
    return ledger.entries


def states(out: Path) -> list[tuple[str, str]]:
    return sorted((entry.name, entry.state) for entry in ledger_of(out))


# --- what is an item ----------------------------------------------------------------------------

MANIFESTS = {
    "pairs.csv": "name,images,segment.motions\nfirst,a/1.png; a/2.png,2\n\n,b/1.png;b/2.png,\n",
    "pairs.tsv": "name\timage1\timage2\tsegment.motions\nfirst\ta/1.png\ta/2.png\t2\n"
    "\tb/1.png\tb/2.png\t\n",
    "pairs.yaml": "# two\n- {name: first, images: [a/1.png, a/2.png], segment: {motions: 2}}\n"
    "- input.images: [b/1.png, b/2.png]\n",
    "pairs.jsonl": '{"name": "first", "images": ["a/1.png", "a/2.png"], "segment.motions": 2}\n'
    '{"input": {"images": ["b/1.png", "b/2.png"]}}\n',
}


@pytest.mark.parametrize("name", MANIFESTS)
def test_every_kind_of_manifest_says_the_same(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(MANIFESTS[name])
    items = items_of([str(tmp_path / name)], [Setting("segment.motions", 5, "config.yaml")])
    assert [item.name for item in items] == ["first", "1-2"]
    assert [item.configuration.input.images for item in items] == [
        [str(tmp_path / "a/1.png"), str(tmp_path / "a/2.png")],
        [str(tmp_path / "b/1.png"), str(tmp_path / "b/2.png")],
    ]
    assert [item.configuration.segment.motions for item in items] == [2, 5]  # a row overrides
    above = items_of([str(tmp_path / name)], above=[Setting("segment.motions", 7, "--motions")])
    assert [item.configuration.segment.motions for item in above] == [7, 7]


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        (
            "m.csv",
            "images,segment.motion\na.png;b.png,2\n",
            r"m\.csv:2: unknown key segment.motion",
        ),
        ("m.csv", "images,seed\na.png;b.png,x\n", r"m\.csv:2: seed is 'x'; expected INTEGER"),
        ("m.csv", "images,images\na,b\n", "two columns are named 'images'"),
        ("m.csv", "images\na.png;b.png,2\n", "2 cells, expected 1"),
        ("m.csv", "images\n", "no rows"),
        ("m.csv", "name,images\nx,\n", r"m\.csv:2: names neither images nor tracks"),
        ("m.csv", "name,images\nx,a\nX,b\n", r"m\.csv:2: another item is named x too"),
        ("m.csv", "name,images\n../x,a\n", r"the name '\.\./x' cannot be that of a folder"),
        ("m.csv", "name,tracks\nx,-\n", "standard input cannot be an item"),
        ("m.csv", "images,image1\na,b\n", "has images and image1"),
        ("m.jsonl", "{\n", r"m\.jsonl:1: .*expected a JSON object"),
        ("m.yaml", "- 1\n", "item 1: expected keys"),
        ("m.png", "", "a single picture"),
    ],
)
def test_a_wrong_manifest_is_said_in_words(
    name: str, text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(text)
    with pytest.raises((ConfigurationError, DataError), match=said):
        items_of([str(tmp_path / name)] if name == "m.csv" and "-" not in text else [name])


def test_folders_and_patterns_name_their_clips(tmp_path: Path) -> None:
    for name in ("a/1.png", "a/2.png", "b/clip.mp4", "b/clip.csv", "b/readme.txt", "c/clip.mp4"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"x1,y1,x2,y2\n1,2,3,4\n")
    assert [item.name for item in items_of([str(tmp_path)])] == ["a"]
    assert [item.name for item in items_of([str(tmp_path / "a")])] == ["a"]
    found = items_of([str(tmp_path / "b"), str(tmp_path / "c")])
    assert [item.name for item in found] == ["b-clip", "b-clip-2", "c-clip"]
    assert [item.configuration.input.tracks is None for item in found] == [False, True, True]
    assert [item.name for item in items_of([str(tmp_path / "*" / "*.csv")])] == ["clip"]
    for nothing in ("*/*.xyz", "nothing.mp4", "nothing.csv", "nothing.npz"):
        with pytest.raises(DataError, match=r"nothing matches|no such file"):
            items_of([str(tmp_path / nothing)])


def test_a_configuration_is_an_item_too(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text("input: {images: [1.png, 2.png]}\nseed: 3\n")
    (item,) = items_of([str(tmp_path / "one.yaml")])
    assert (item.name, item.configuration.seed) == ("one", 3)


# --- what is done -------------------------------------------------------------------------------


def test_one_and_two_processes_write_the_same_bytes(matches: Path, tmp_path: Path) -> None:
    for jobs in (1, 2):
        assert run(matches, "--out", tmp_path / str(jobs), "--jobs", jobs) == 0
    assert contents(tmp_path / "1") == contents(tmp_path / "2")
    assert states(tmp_path / "1") == [(str(seed), "done") for seed in range(4)]
    assert sorted(path.name for path in (tmp_path / "1").iterdir()) == [
        *"0123",
        "index.html",
        LEDGER,
        "summary.json",
    ]


@pytest.mark.usefixtures("here")
def test_only_what_is_missing_or_has_changed_is_done(matches: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run(matches, "--out", out, "--jobs", 1) == 0
    before, stamps = contents(out), {p: p.stat().st_mtime_ns for p in out.rglob("item.json")}
    assert run(matches, "--out", out, "--jobs", 1) == 0
    assert contents(out) == before
    assert {p: p.stat().st_mtime_ns for p in out.rglob("item.json")} == stamps
    assert Counter(entry.state for entry in ledger_of(out)) == {"done": 4, "skipped": 4}

    write_matches(matches / "2.csv", 20)  # another input
    (out / "3" / "item.json").unlink()  # no whole result
    assert run(matches, "--out", out, "--jobs", 1) == 0
    done = [entry.name for entry in ledger_of(out)[8:] if entry.state == "done"]
    assert sorted(done) == ["2", "3"]
    assert run(matches, "--out", out, "--jobs", 1, "--motions", 1) == 0  # other settings
    assert [entry.state for entry in ledger_of(out)[12:]] == ["done"] * 4
    summary = json.loads((out / "summary.json").read_bytes())
    assert [len(item["found"]["motions"]) for item in summary["items"]] == [1] * 4


@pytest.mark.usefixtures("here")
def test_failures_are_kept_said_and_retried_on_demand(
    matches: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    (matches / "1.csv").write_text("x1,y1,x2,y2\n1,2,3,no number\n")
    arguments = (matches, "--out", out, "--jobs", 1)
    assert run(*arguments) == ExitStatus.DATA
    said = capfd.readouterr().err
    assert said.startswith("mssegment: 1 of 4 items failed\n  1  ")
    assert "1.csv" in said
    assert "no number" in said
    assert len(said.splitlines()) == 2
    assert states(out) == [("0", "done"), ("1", "failed"), ("2", "done"), ("3", "done")]
    assert "Failed" in (out / "index.html").read_text()
    assert run(*arguments) == ExitStatus.DATA
    assert capfd.readouterr().err == said  # not tried again, but still said
    assert ledger_of(out)[-3].state == "skipped"
    assert run(*arguments, "--retry-failed") == ExitStatus.DATA
    assert [entry.state for entry in ledger_of(out)[8:]].count("failed") == 1
    write_matches(matches / "1.csv", 1)
    assert run(*arguments) == 0
    assert {str(seed) for seed in range(4)} <= set(os.listdir(out))
    assert "Failed" not in (out / "index.html").read_text()


@pytest.mark.usefixtures("here")
def test_fail_fast_stops_at_the_first_failure(matches: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    (matches / "0.csv").unlink()
    (matches / "0.csv").symlink_to("nowhere")
    assert run(matches, "--out", out, "--jobs", 1, "--fail-fast") == ExitStatus.DATA
    summary = json.loads((out / "summary.json").read_bytes())
    assert [item["state"] for item in summary["items"]] == ["failed", *["not started"] * 3]
    assert run(matches, "--out", out, "--jobs", 1) == ExitStatus.DATA
    assert states(out).count(("3", "done")) == 1


def test_a_worker_that_is_killed_loses_and_doubles_nothing(matches: Path, tmp_path: Path) -> None:
    undisturbed, out = tmp_path / "undisturbed", tmp_path / "out"
    assert run(matches, "--out", undisturbed, "--jobs", 2) == 0
    batch = subprocess.Popen(
        [*MSSEGMENT, "batch", str(matches), "--out", str(out), "--jobs", "2", "-q", *QUICK],
        stdout=subprocess.DEVNULL,
    )
    killed: set[int] = set()
    while batch.poll() is None and len(killed) < 2:
        for worker in set(workers_of(batch.pid)) - killed:
            # in the middle of its first item: the folder of that is being written
            if any(str(worker) in lock.read_text() for lock in out.glob(".*/lock")):
                os.kill(worker, signal.SIGKILL)
                killed.add(worker)
        time.sleep(0.001)
    assert batch.wait(60) == 0
    assert killed
    assert contents(out) == contents(undisturbed)
    assert states(out) == states(undisturbed)
    assert not list(out.glob(".*"))


def workers_of(process: int) -> list[int]:
    """The processes that a batch has started."""
    try:
        listed = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except FileNotFoundError:
        pytest.skip("needs /proc")
    return [int(number) for number in listed]


def test_a_second_batch_into_the_same_folder_is_refused(
    matches: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = [*MSSEGMENT, "batch", str(matches), "--out", str(out), "--jobs", "1", "-q", *QUICK]
    first = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    while not (out / LEDGER).exists() and first.poll() is None:
        time.sleep(0.01)
    assert run(matches, "--out", out) == ExitStatus.USAGE
    assert f"process {first.pid} " in capfd.readouterr().err
    assert first.wait(60) == 0


def test_a_folder_of_something_else_is_not_touched(matches: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("my own")
    assert run(matches, "--out", out) == ExitStatus.USAGE
    assert os.listdir(out) == ["mine.txt"]


def test_a_full_disk_ends_the_batch_and_loses_nothing(
    matches: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"

    class Full(Here):
        """A pool whose second item finds the disk full."""

        def submit(self, task: Task) -> Future[Outcome]:
            if task.name != "1":
                return super().submit(task)
            future: Future[Outcome] = Future()
            error = f"{task.out}/tracks.json: cannot be written (No space left on device)"
            future.set_result(Outcome(error=error, status=2, cannot_write=True))
            return future

    settings = [Setting("report.pictures", False, "test"), Setting("report.html", False, "test")]
    batch = Batch(items_of([str(matches)], settings), str(out))
    with batch.opened() as ledger, pytest.raises(MssegmentError, match="No space left"):
        batch.run(ledger, Full())
    assert states(out) == [("0", "done")]
    with batch.opened() as ledger:
        batch.run(ledger, Here())
    assert Counter(states(out)) == Counter(
        [("0", "done"), ("0", "skipped"), ("1", "done"), ("2", "done"), ("3", "done")]
    )


def test_a_line_that_was_cut_off_is_removed_from_the_ledger(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path)
    ledger.add(Entry("", "a", "done"))
    ledger.close()
    whole = (tmp_path / LEDGER).read_bytes()
    (tmp_path / LEDGER).write_bytes(whole + whole[:20])
    ledger = Ledger(tmp_path)
    assert [entry.name for entry in ledger.entries] == ["a"]
    ledger.add(Entry("", "b", "failed", error="why"))
    ledger.close()
    assert [entry.name for entry in ledger_of(tmp_path)] == ["a", "b"]
    assert ledger_of(tmp_path)[0].time <= ledger_of(tmp_path)[1].time
    (tmp_path / LEDGER).write_bytes(b"something else\n")
    with pytest.raises(DataError, match=r"ledger\.jsonl:1: not an entry"):
        Ledger(tmp_path)


# --- Dask ---------------------------------------------------------------------------------------


@pytest.fixture
def scheduler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> object:
    """The address of a scheduler with one worker, both started by the commands of Dask."""
    pytest.importorskip("distributed", reason="Dask is not installed (mssegment[dask])")
    monkeypatch.chdir(tmp_path)
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{found.getsockname()[1]}"
    start: Callable[..., subprocess.Popen[bytes]] = lambda *arguments: subprocess.Popen(  # noqa: E731
        [sys.executable, "-m", "dask", *arguments],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    port = address.rpartition(":")[2]
    processes = [start("scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard")]
    processes.append(start("worker", address, "--nthreads", "1", "--no-dashboard"))
    yield address
    for process in reversed(processes):
        process.terminate()
        process.wait(30)


@pytest.mark.usefixtures("here")
def test_a_dask_cluster_writes_the_same_bytes(
    scheduler: str, matches: Path, tmp_path: Path
) -> None:
    assert run(matches, "--out", tmp_path / "local", "--jobs", 2) == 0
    assert run(matches, "--out", tmp_path / "dask", "--scheduler", scheduler) == 0
    shipped = ("--out", tmp_path / "shipped", "--scheduler", scheduler, "--ship")
    assert run(matches, *shipped) == 0
    for name in ("dask", "shipped"):
        assert contents(tmp_path / name) == contents(tmp_path / "local")
        assert states(tmp_path / name) == states(tmp_path / "local")


def test_shipped_files_leave_no_trace_in_the_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(SAMPLES, tmp_path / "scene")
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    rows = [
        {"name": "folder", "images": ["../scene"], "labels": [f"{tmp_path}/scene/mask-*.png"]},
        {"name": "missing", "images": ["../scene/frame-1.png", f"{tmp_path}/scene/mask-1.txt"]},
    ]
    (tmp_path / "scene" / "mask-1.txt").write_text("no picture")
    (tmp_path / "here" / "m.jsonl").write_text("\n".join(map(json.dumps, rows)))
    items = items_of(["m.jsonl"])
    outcomes = []
    for item in items:
        of = fingerprint(item.configuration)
        for place in ("direct", "shipped"):
            out = str(tmp_path / place / item.name)
            task = Task(item.name, item.configuration, out, of, os.getcwd())
            if place == "direct":
                outcomes.append(segment_item(task))
            else:
                outcomes.append(unpacked(task, segment_parcel(packed(task))))
    assert outcomes[0].error == ""
    assert outcomes[0].facts == outcomes[1].facts
    assert outcomes[2].error == outcomes[3].error != ""
    assert contents(tmp_path / "direct") == contents(tmp_path / "shipped")


def test_a_pool_that_is_lost_ends_the_batch(matches: Path, tmp_path: Path) -> None:
    class Lost(Here):
        is_lost = True

        def submit(self, task: Task) -> Future[Outcome]:
            return Future()  # no answer will come

    batch = Batch(items_of([str(matches)]), str(tmp_path / "out"))
    with batch.opened() as ledger, pytest.raises(DataError, match="is lost; run the same batch"):
        batch.run(ledger, Lost())


def test_without_dask_the_extra_is_named(
    matches: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "dask", None)
    assert run(matches, "--out", tmp_path / "out", "--scheduler", "local") == ExitStatus.USAGE
    assert "pip install 'mssegment[dask]'" in capfd.readouterr().err
