"""The command line as a user meets it: the stages, the pipe, and every kind of bad input."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mssegment.cli import COMMANDS, invoke
from mssegment.errors import ExitStatus

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"
AFFINE = [str(SAMPLES / "affine" / f"frame-{i}.png") for i in (1, 2)]
MSSEGMENT = [sys.executable, "-c", "from mssegment.cli import main; main()"]


@dataclass(frozen=True)
class Outcome:
    """What a command left behind."""

    status: int
    out: str
    err: str


Call = Callable[..., Outcome]


@pytest.fixture
def call(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs a command line in this process, with ``stdin`` as its standard input."""

    def run(*arguments: str, stdin: str = "") -> Outcome:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(stdin.encode())))
        status = invoke(list(arguments))
        captured = capfd.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run


@pytest.fixture(scope="session")
def affine_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one run over the affine sample, with its masks as labels."""
    out = tmp_path_factory.mktemp("run") / "out"
    assert invoke(["run", str(ROOT / "configs" / "affine.yaml"), "--out", str(out), "-q"]) == 0
    return out


@pytest.fixture
def tracks_csv(tmp_path: Path, rng: np.random.Generator) -> str:
    """Two rigid motions and a few mismatches, as matches in a CSV with labels."""
    first = rng.uniform(0, 200, (60, 2))
    labels = np.repeat([1, 2, 0], [25, 25, 10])
    first[labels == 2] += 300
    turned = (first - 400) @ np.array([[0.94, 0.34], [-0.34, 0.94]]) + 400
    second = np.where(labels[:, None] == 1, first, turned) + np.array([20, 5])
    second[labels == 0] = rng.uniform(0, 500, (10, 2))
    rows = np.column_stack([first, second, labels])
    path = tmp_path / "tracks.csv"
    np.savetxt(path, rows, "%.3f,%.3f,%.3f,%.3f,%d", header="x1,y1,x2,y2,label", comments="")
    return str(path)


def write_picture(path: Path, picture: np.ndarray) -> str:
    assert cv2.imwrite(str(path), picture)
    return str(path)


def noise(seed: int, size: tuple[int, int] = (120, 160)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 255, size, dtype=np.uint8)


# --- the main job -------------------------------------------------------------------------------


@pytest.mark.parametrize("model", ["translation", "factorization", "affine"])
def test_every_sample_scene_is_segmented(model: str, tmp_path: Path) -> None:
    config = str(ROOT / "configs" / f"{model}.yaml")
    assert invoke(["run", config, "--out", str(tmp_path / "out"), "-q"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["motions"] == 3
    assert report["misclassification"] <= 0.03
    assert len(report["confusion"]) == 4
    assert len(report["res"]) == len(report["res_hat"]) == 3


def test_the_folder_of_results_is_complete(affine_run: Path) -> None:
    names = {path.name for path in affine_run.iterdir()}
    documents = {f"{kind}.json" for kind in ("corners", "tracks", "hypotheses", "segmentation")}
    assert documents | {"report.json", "timings.json", "report.html"} <= names
    assert any(name.endswith(".png") for name in names)
    report = json.loads((affine_run / "report.json").read_text())
    labels = json.loads((affine_run / "segmentation.json").read_text())["labels"]
    tracks = json.loads((affine_run / "tracks.json").read_text())["tracks"]["points"]
    assert len(labels) == len(tracks)
    assert report["motions"] == len({label for label in labels if label > 0})
    assert {"hypotheses", "kde"} <= set(report["modes"][0])


def test_a_folder_of_results_stands_for_its_documents(
    affine_run: Path, tmp_path: Path, call: Call
) -> None:
    again = str(tmp_path / "again.json")
    assert call("cluster", str(affine_run), "-o", again).status == 0
    assert Path(again).read_bytes() == (affine_run / "segmentation.json").read_bytes()
    assert call("report", str(affine_run), "--json").out == call("report", again, "--json").out


def test_drawings_of_an_earlier_run_are_no_pictures(
    affine_run: Path, tmp_path: Path, call: Call
) -> None:
    ran = call("run", str(affine_run), "--out", str(tmp_path / "out"))
    assert ran.status == ExitStatus.DATA
    assert "the results of a run" in ran.err
    assert "tracks.json" in ran.err


def test_no_document_names_a_time_or_the_output_folder(affine_run: Path) -> None:
    for path in affine_run.glob("*.json"):
        if path.name != "timings.json":
            assert str(affine_run) not in path.read_text()


def test_the_pipe_gives_the_same_labels_as_run(affine_run: Path, call: Call) -> None:
    stages = (["detect", *AFFINE], ["match"], ["hypothesize", "--model", "affine"], ["cluster"])
    text = ""
    for stage in stages:
        outcome = call(*stage, "-q", stdin=text)
        assert outcome.status == 0
        text = outcome.out
    piped = json.loads(text)
    run = json.loads((affine_run / "segmentation.json").read_text())
    assert piped["labels"] == run["labels"]
    assert piped["modes"] == run["modes"]
    report = json.loads(call("report", "--json", "-q", stdin=text).out)
    assert report["motions"] == len(run["motions"])
    assert report["misclassification"] is report["confusion"] is report["res"] is None


def test_the_same_seed_gives_the_same_bytes_with_any_number_of_threads(
    affine_run: Path, tmp_path: Path
) -> None:
    for threads in ("1", "2"):
        out = tmp_path / threads
        config = str(ROOT / "configs" / "affine.yaml")
        assert invoke(["run", config, "--out", str(out), "--threads", threads, "-q"]) == 0
        for name in ("corners", "tracks", "hypotheses", "segmentation", "report"):
            one, other = affine_run / f"{name}.json", out / f"{name}.json"
            assert one.read_bytes() == other.read_bytes(), name


def test_the_seed_is_handed_on_through_the_documents(tracks_csv: str, call: Call) -> None:
    tracks = call("import", tracks_csv).out
    hypotheses = call("hypothesize", "--seed", "7", stdin=tracks).out
    document = json.loads(call("cluster", stdin=hypotheses).out)
    assert [entry["settings"].get("seed") for entry in document["history"]] == [None, 7, 7]


def test_tracks_of_ones_own_are_segmented_and_judged(tracks_csv: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert invoke(["run", tracks_csv, "--out", str(out), "-q"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["motions"] == 2
    assert report["misclassification"] <= 0.1
    assert not (out / "corners.json").exists()


def test_set_and_options_reach_the_stages(tracks_csv: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    arguments = ["run", tracks_csv, "--out", str(out), "-q", "--motions", "1", "--model", "affine"]
    assert invoke([*arguments, "--set", "cluster.bandwidth=0.05"]) == 0
    document = json.loads((out / "segmentation.json").read_text())
    assert document["bandwidths"] == [0.05]
    assert len(document["motions"]) == 1


def test_a_profile_names_every_stage(tracks_csv: str, tmp_path: Path, call: Call) -> None:
    outcome = call("run", tracks_csv, "--out", str(tmp_path / "out"), "--profile")
    assert outcome.status == 0
    for stage in ("hypothesize", "cluster", "report", "peak MB"):
        assert stage in outcome.err
    timings = json.loads((tmp_path / "out" / "timings.json").read_text())
    assert set(timings["seconds"]) == {"hypothesize", "cluster", "report"}


@pytest.mark.parametrize("form", ["text", "json", "csv", "markdown", "latex"])
def test_report_has_every_format(affine_run: Path, call: Call, form: str) -> None:
    outcome = call("report", str(affine_run / "segmentation.json"), "--format", form)
    assert outcome.status == 0
    assert outcome.out.strip()


def test_report_reads_labels_from_a_csv(
    affine_run: Path, tracks_csv: str, tmp_path: Path, call: Call
) -> None:
    document = json.loads((affine_run / "segmentation.json").read_text())
    points, labels = document["tracks"]["points"], document["labels"]
    rows = [f"{p[0][0]},{p[0][1]},{max(label, 0)}" for p, label in zip(points, labels, strict=True)]
    path = tmp_path / "labels.csv"
    path.write_text("\n".join(["x,y,label", *rows]))
    report = call("report", str(affine_run / "segmentation.json"), "--labels", str(path), "--json")
    assert report.status == 0
    assert json.loads(report.out)["misclassification"] <= 0.05
    far = tmp_path / "far.csv"
    far.write_text("x,y,label\n-900,-900,1\n")
    outcome = call("report", str(affine_run / "segmentation.json"), "--labels", str(far))
    assert outcome.status == ExitStatus.DATA
    assert "match no track" in outcome.err


def test_init_writes_a_configuration_that_can_be_read(tmp_path: Path, call: Call) -> None:
    path = tmp_path / "config.yaml"
    assert call("init", "--model", "translation", "-o", str(path)).status == 0
    assert "model: translation" in path.read_text()
    assert call("run", str(path), "--out", str(tmp_path / "out")).status == ExitStatus.DATA


# --- bad input: one clear line, the right status, no half-written file ---------------------------


def bad_pictures(folder: Path) -> dict[str, tuple[list[str], str]]:
    """Arguments of ``detect`` that cannot work, and what must be said."""
    good = write_picture(folder / "good.png", noise(1))
    small = write_picture(folder / "small.png", noise(2, (60, 80)))
    blank = write_picture(folder / "blank.png", np.full((120, 160), 90, np.uint8))
    (folder / "empty.png").touch()
    (folder / "cut.png").write_bytes(Path(good).read_bytes()[:800])
    (folder / "text.png").write_text("no picture at all")
    (folder / "nothing").mkdir()
    return {
        "none": ([], "no images given"),
        "missing": ([good, str(folder / "no.png")], "no.png"),
        "empty": ([good, str(folder / "empty.png")], "empty.png"),
        "truncated": ([good, str(folder / "cut.png")], "cut.png"),
        "not an image": ([good, str(folder / "text.png")], "text.png"),
        "two sizes": ([good, good, small], "small.png has 80x60"),
        "one picture": ([good], "at least 2"),
        "empty folder": ([str(folder / "nothing")], "no pictures in this folder"),
        "no glob": ([str(folder / "*.jpg")], "no file matches"),
        "no corners": ([good, blank], "blank.png: no corners"),
    }


BAD_PICTURES = (
    "none,missing,empty,truncated,not an image,two sizes,one picture,empty folder,no glob"
)


@pytest.mark.parametrize("case", [*BAD_PICTURES.split(","), "no corners"])
def test_bad_pictures(case: str, tmp_path: Path, call: Call) -> None:
    arguments, said = bad_pictures(tmp_path)[case]
    target = tmp_path / "corners.json"
    outcome = call("detect", *arguments, "-o", str(target))
    assert outcome.status == (ExitStatus.USAGE if case == "none" else ExitStatus.DATA)
    assert said in outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert not target.exists()


def test_a_range_without_a_frame(tmp_path: Path, call: Call) -> None:
    for i in range(4):
        write_picture(tmp_path / f"{i}.png", noise(i))
    outcome = call("detect", str(tmp_path), "--start", "3")
    assert outcome.status == ExitStatus.DATA
    assert "at least 2" in outcome.err


def csv_of(folder: Path, rows: list[list[float]]) -> str:
    path = folder / "t.csv"
    lines = [",".join(map(str, row)) for row in rows]
    path.write_text("\n".join(["x1,y1,x2,y2", *lines]))
    return str(path)


def test_fewer_tracks_than_an_elemental_subset(tmp_path: Path, call: Call) -> None:
    tracks = call("import", csv_of(tmp_path, [[1, 2, 3, 4], [5, 6, 9, 9]])).out
    outcome = call("hypothesize", "--model", "affine", stdin=tracks)
    assert outcome.status == ExitStatus.DATA
    assert "affine needs at least 4 tracks" in outcome.err
    assert "needs at least" in outcome.err


def test_only_degenerate_subsets(tmp_path: Path, call: Call) -> None:
    tracks = call("import", csv_of(tmp_path, [[i, 2 * i, i + 9, 2 * i] for i in range(30)])).out
    outcome = call("hypothesize", "--model", "affine", stdin=tracks)
    assert outcome.status == ExitStatus.DATA
    assert "degenerate" in outcome.err


def test_translation_without_a_camera(tracks_csv: str, call: Call) -> None:
    tracks = call("import", tracks_csv).out
    outcome = call("hypothesize", "--model", "translation", stdin=tracks)
    assert outcome.status == ExitStatus.DATA
    assert "--camera" in outcome.err


def test_translation_with_more_than_two_frames(tmp_path: Path, call: Call) -> None:
    rows = [f"{t},{f},{t * 7 % 50 + f},{t * 13 % 40}" for t in range(20) for f in range(3)]
    (tmp_path / "t.csv").write_text("\n".join(["track,frame,x,y", *rows]))
    tracks = call("import", str(tmp_path / "t.csv")).out
    outcome = call(
        "hypothesize", "--model", "translation", "--camera", "500,500,20,20", stdin=tracks
    )
    assert outcome.status == ExitStatus.DATA
    assert "3" in outcome.err


def test_a_document_of_another_stage(tracks_csv: str, call: Call) -> None:
    tracks = call("import", tracks_csv).out
    for command, said in (
        ("cluster", "run `mssegment hypothesize` on it first"),
        ("report", "run `mssegment hypothesize | mssegment cluster` on it first"),
        ("match", "written by `mssegment detect`"),
    ):
        outcome = call(command, stdin=tracks)
        assert outcome.status == ExitStatus.DATA
        assert said in outcome.err
        assert outcome.out == ""


@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["cluster", "--bandwidth", "-1"], ExitStatus.USAGE, "cluster.bandwidth is -1"),
        (["cluster", "--bandwith", "1"], ExitStatus.USAGE, "--bandwidth"),
        (["clutser"], ExitStatus.USAGE, "did you mean cluster?"),
        (["."], ExitStatus.USAGE, "`mssegment run .`"),
        (["run"], ExitStatus.USAGE, "Missing argument"),
        (["run", "none.yaml"], ExitStatus.CONFIGURATION, "mssegment init"),
        (["run", "a.png", "b.yaml"], ExitStatus.USAGE, "not both"),
        (
            ["run", "a.png", "b.png", "--set", "sed=1"],
            ExitStatus.CONFIGURATION,
            "did you mean seed",
        ),
        (["cluster", "none.json"], ExitStatus.DATA, "none.json: no such file"),
        (["import", "none.csv"], ExitStatus.DATA, "none.csv"),
        (["report", "x.json", "--format", "pdf"], ExitStatus.USAGE, "'pdf' is not one of"),
    ],
)
def test_what_is_typed_wrong(
    arguments: list[str],
    status: ExitStatus,
    said: str,
    call: Call,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = call(*arguments, stdin="{}")
    assert outcome.status == status
    assert said in outcome.err
    assert len(outcome.err.splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_an_existing_output_folder_needs_force(tracks_csv: str, tmp_path: Path, call: Call) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine.txt").write_text("keep me")
    outcome = call("run", tracks_csv, "--out", str(out))
    assert outcome.status == ExitStatus.USAGE
    assert "--force" in outcome.err
    assert [path.name for path in out.iterdir()] == ["mine.txt"]
    assert call("run", tracks_csv, "--out", str(out), "--force").status == 0
    assert (out / "mine.txt").read_text() == "keep me"
    outcome = call("run", tracks_csv, "--out", str(out / "mine.txt"))
    assert outcome.status == ExitStatus.USAGE


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_an_unwritable_output_folder(tracks_csv: str, tmp_path: Path, call: Call) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    outcome = call("run", tracks_csv, "--out", str(tmp_path / "locked" / "out"))
    assert outcome.status == ExitStatus.USAGE
    assert "cannot be written" in outcome.err


def test_no_motion_is_an_answer_and_not_an_error(
    tmp_path: Path, call: Call, rng: np.random.Generator
) -> None:
    rows = rng.uniform(0, 500, (40, 4)).round(3).tolist()
    outcome = call("run", csv_of(tmp_path, rows), "--out", str(tmp_path / "out"))
    report = tmp_path / "out" / "report.json"
    if outcome.status == ExitStatus.DONE:
        assert json.loads(report.read_text())["motions"] == 0
    else:
        # not one elemental subset was confirmed by its neighbours
        assert outcome.status == ExitStatus.DATA
        assert not report.exists()


def test_debug_shows_the_traceback_and_nothing_else_does(tmp_path: Path, call: Call) -> None:
    assert "Traceback" not in call("cluster", "none.json").err
    assert "Traceback" in call("cluster", "none.json", "--debug").err


def test_something_unforeseen_has_its_own_status(
    tracks_csv: str, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mssegment.pipeline

    def broken(path: str, source: object = None) -> Any:
        raise RuntimeError("the roof is leaking")

    monkeypatch.setattr(mssegment.pipeline, "import_tracks", broken)
    outcome = call("import", tracks_csv)
    assert outcome.status == ExitStatus.UNFORESEEN
    assert "the roof is leaking" in outcome.err
    assert len(outcome.err.splitlines()) == 1


@pytest.mark.parametrize(
    ("number", "status", "word"),
    [
        (signal.SIGINT, ExitStatus.INTERRUPTED, "interrupted"),
        (signal.SIGTERM, ExitStatus.TERMINATED, "terminated"),
    ],
)
def test_a_signal_that_ends_a_run_leaves_nothing(
    number: int, status: int, word: str, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*MSSEGMENT, "run", *AFFINE, "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
        # a shell starts what runs in its background with SIGINT ignored, and children inherit that
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60
    while not any(tmp_path.iterdir()) and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.01)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert err.splitlines()[-1] == f"mssegment: {word}"
    assert not list(tmp_path.iterdir())


def test_a_closed_pipe_ends_with_141_and_no_word(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [*MSSEGMENT, "detect", *AFFINE, "-q"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(timeout=60) == ExitStatus.CLOSED_PIPE
    assert process.stderr is not None
    assert process.stderr.read() == b""


def test_quiet_says_nothing_and_data_goes_to_stdout(tracks_csv: str, call: Call) -> None:
    outcome = call("import", tracks_csv, "--quiet")
    assert outcome.err == ""
    assert json.loads(outcome.out)["schema"] == "mssegment/tracks/1"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_every_command(name: str, call: Call) -> None:
    outcome = call(name, "--help")
    assert outcome.status == 0
    assert "Example:" in outcome.out


@pytest.mark.skipif(shutil.which("mssegment") is None, reason="the package is not installed")
def test_the_installed_command_starts() -> None:
    done = subprocess.run(["mssegment", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("mssegment, version ")


def test_labels_are_read_before_the_long_stages_and_no_folder_is_left(
    tmp_path: Path, call: Call
) -> None:
    out = tmp_path / "out"
    outcome = call("run", *AFFINE, "--labels", str(tmp_path / "none.csv"), "--out", str(out))
    assert outcome.status == ExitStatus.DATA
    assert len(outcome.err.splitlines()) == 1
    blank = write_picture(tmp_path / "blank.png", np.full((120, 160), 90, np.uint8))
    assert call("run", blank, blank, "--out", str(out)).status == ExitStatus.DATA
    assert not out.exists()


def test_verbose_says_the_settings_of_the_stage(tracks_csv: str, call: Call) -> None:
    tracks = call("import", tracks_csv).out
    assert "hypothesize.sampling = local" in call("hypothesize", "-v", stdin=tracks).err
    assert "hypothesize.sampling" not in call("hypothesize", stdin=tracks).err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_is_one_line(tracks_csv: str) -> None:
    with open("/dev/full", "wb") as full:
        done = subprocess.run(
            [*MSSEGMENT, "import", tracks_csv], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert done.returncode == ExitStatus.USAGE
    assert done.stderr.startswith("mssegment: standard output: cannot be written")
    assert len(done.stderr.splitlines()) == 1


def test_import_reads_a_csv_from_standard_input(call: Call, tmp_path: Path) -> None:
    text = "x1,y1,x2,y2\n1,2,3,4\n5,6,7,8\n"
    (tmp_path / "tracks.csv").write_text(text)
    piped = json.loads(call("import", "-", stdin=text).out)
    read = json.loads(call("import", str(tmp_path / "tracks.csv")).out)
    assert piped["tracks"] == read["tracks"]
    assert [frame["path"] for frame in piped["frames"]] == ["standard input"] * 2
    broken = call("import", stdin=text.replace("8", "eight"))
    assert broken.status == 4
    assert "standard input: line 3: 'eight'" in broken.err


def test_no_command_at_all_shows_the_whole_help(call: Call) -> None:
    outcome = call()
    assert outcome.status == 2
    assert "\n  benchmark " in outcome.err


def test_tracks_are_drawn_on_their_pictures(tmp_path: Path, call: Call) -> None:
    frames = [cv2.imread(path) for path in AFFINE]
    size = frames[0].shape[1], frames[0].shape[0]
    tracks = tmp_path / "tracks.npy"
    points = np.random.default_rng(0).uniform(50, 300, (60, 1, 2)).repeat(2, axis=1)
    points[:, 1] += [7.0, 3.0]
    np.save(tracks, points)
    out = tmp_path / "out"
    images = ["--images", AFFINE[0], "--images", AFFINE[1]]
    assert call("run", str(tracks), *images, "--out", str(out)).status == 0
    document = json.loads((out / "segmentation.json").read_text())
    assert [(frame["path"], frame["width"]) for frame in document["frames"]] == [
        (path, size[0]) for path in AFFINE
    ]
    drawn = cv2.imread(str(out / "overlay.png"))
    assert len(np.unique(drawn.reshape(-1, 3), axis=0)) > 1000, "the picture is below the tracks"
    again = call("report", str(out / "segmentation.json"), "--out", str(tmp_path / "again"))
    assert again.status == 0
    assert (tmp_path / "again" / "overlay.png").read_bytes() == (out / "overlay.png").read_bytes()


def test_pictures_that_do_not_fit_the_tracks(tmp_path: Path, call: Call) -> None:
    np.save(tmp_path / "tracks.npy", np.random.default_rng(0).uniform(50, 300, (60, 5, 2)))
    images = ["--images", AFFINE[0], "--images", AFFINE[1]]
    outcome = call("run", str(tmp_path / "tracks.npy"), *images, "--out", str(tmp_path / "out"))
    assert outcome.status == ExitStatus.DATA
    assert "5 frames, numbered 0 to 4, but --images names 2 pictures" in outcome.err
    np.save(tmp_path / "far.npy", np.random.default_rng(0).uniform(5000, 6000, (60, 2, 2)))
    outcome = call("run", str(tmp_path / "far.npy"), *images, "--out", str(tmp_path / "out"))
    assert "100% of the positions lie outside the pictures" in outcome.err
    outcome = call("run", AFFINE[0], "--images", AFFINE[1], "--out", str(tmp_path / "out"))
    assert outcome.status == ExitStatus.USAGE


def test_force_leaves_no_picture_of_an_earlier_run(
    tracks_csv: str, tmp_path: Path, call: Call
) -> None:
    out = tmp_path / "out"
    assert call("run", *AFFINE, "--out", str(out), "-q").status == 0
    (out / "mine.txt").write_text("my own")
    shutil.copy(AFFINE[0], out / "frame-9.png")
    before = {path.name for path in out.iterdir()}
    assert {"corners.json", "overlay.png"} <= before
    arguments = ["--out", str(out), "--force", "-q", "--set", "report.pictures=no"]
    assert call("run", tracks_csv, *arguments).status == 0
    left = {path.name for path in out.iterdir()}
    assert not left & {"corners.json", "overlay.png", "frame-1.png"}
    assert {"mine.txt", "frame-9.png", "tracks.json", "report.html"} <= left


def test_a_picture_that_is_read_is_never_removed(tmp_path: Path, call: Call) -> None:
    inside = []
    for name in AFFINE:
        inside.append(str(tmp_path / f"in-{Path(name).name}"))
        shutil.copy(name, inside[-1])
    record = {"files": [Path(name).name for name in inside] + ["../x.txt", "gone.png"]}
    (tmp_path / "timings.json").write_text(json.dumps(record))
    (tmp_path.parent / "x.txt").write_text("not ours")
    assert call("run", *inside, "--out", str(tmp_path), "--force", "-q").status == 0
    assert all(Path(name).exists() for name in inside)
    assert (tmp_path.parent / "x.txt").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["run", "1.png", "--derotate"], "here it is --set camera.derotate=VALUE"),
        (["run", "1.png", "--remove-background"], "here it is --set background.remove=VALUE"),
        (["run", "1.png", "-o", "out"], "the folder for the results is --out"),
        (["run", "1.png", "-frame.png"], "put file names that start with - after --"),
        (["report", "-o", "out"], "put file names that start with - after --"),
        (["cluster", "t.csv"], "no document of mssegment, which is JSON; `mssegment detect`"),
        (["import", "1.png"], "1.png: a picture; expected tracks"),
        (["import", "t.csv#part"], "which has no parts; leave out '#part'"),
        (["run", "1.png", "2.png", "--camera", "800"], "or give four numbers fx,fy,cx,cy"),
    ],
)
def test_what_to_do_instead_is_said(
    call: Call, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("t.csv").write_text("x1,y1,x2,y2\n1,2,3,4\n5,6,7,8\n")
    for name in ("1.png", "2.png"):
        cv2.imwrite(name, np.zeros((32, 32), np.uint8))
    found = call(*arguments)
    assert said in found.err
    assert found.status in (2, 3, 4)
    assert len([line for line in found.err.splitlines() if line.startswith("mssegment: ")]) == 1
