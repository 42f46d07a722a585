"""Long clips: windows, files, going on after an interruption, bounded memory."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from mssegment.cli import invoke
from mssegment.clips.exports import write_exports
from mssegment.clips.frames import frames_of
from mssegment.clips.process import process
from mssegment.clips.store import ClipStore, read_clip
from mssegment.configuration import Configuration, from_mapping, resolve
from mssegment.documents.clips import ClipDocument, ClipObject, WindowDocument, WindowTracks
from mssegment.errors import DataError, ExitStatus
from mssegment.imaging.streams import Clip, in_background, long_clip
from mssegment.rendering.clip_page import timeline
from mssegment.rendering.clip_tables import clip_summary, objects_table

FRAMES, SIZE = 72, (200, 150)
WINDOWS = {"sequence.window": 24, "sequence.overlap": 8}


def texture(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    small = rng.uniform(20, 235, (height // 4 + 1, width // 4 + 1)).astype(np.float32)
    return cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC).clip(0, 255)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two textured squares that cross a static wall; one stops half way."""
    folder = tmp_path_factory.mktemp("frames")
    rng = np.random.default_rng(0)
    wall = texture(rng, SIZE[1], SIZE[0])
    bodies = [texture(rng, 44, 44), texture(rng, 44, 44)]
    for frame in range(FRAMES):
        picture = wall.copy()
        places = [(10 + 1.8 * frame, 15.0), (140 - 2.0 * min(frame, 36), 90.0)]
        for body, (x, y) in zip(bodies, places, strict=True):
            shift = np.array([[1, 0, x], [0, 1, y]])
            moved = cv2.warpAffine(body, shift, SIZE, flags=cv2.INTER_LINEAR)
            mask = cv2.warpAffine(np.ones_like(body), shift, SIZE)
            picture = picture * (1 - mask) + moved
        cv2.imwrite(str(folder / f"{frame:03d}.png"), picture.clip(0, 255).astype(np.uint8))
    return folder


@pytest.fixture(scope="module")
def configuration() -> Configuration:
    return resolve(from_mapping(WINDOWS, "test"))


@pytest.fixture(scope="module")
def clip(pictures: Path) -> Clip:
    found = long_clip([str(pictures)], 0, None, 1, 24)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def done(
    clip: Clip, configuration: Configuration, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    folder = tmp_path_factory.mktemp("clip")
    process(clip, configuration, folder)
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_each_object_has_one_identity(done: Path) -> None:
    document, store = read_clip(str(done))
    assert document.windows == [(0, 24), (16, 40), (32, 56), (48, 72)]
    assert set(document.cameras) == {"static"}
    stopping, moving = document.objects[:2]
    assert len(document.objects) == 2
    assert moving.moving == [(0, FRAMES - 1)]
    assert stopping.moving[0][0] == 0
    assert stopping.resting[-1][1] == FRAMES - 1
    for frame in frames_of(store, len(document.windows)):
        for identity, y in ((moving.identity, 15), (stopping.identity, 90)):
            own = frame.points[frame.identities == identity]
            assert len(own) >= 4
            assert ((own[:, 1] > y - 8) & (own[:, 1] < y + 52)).mean() > 0.9


def test_positions_are_stored_once_in_a_few_bytes(done: Path) -> None:
    document, store = read_clip(str(done))
    frames = [frame.number for frame in frames_of(store, len(document.windows))]
    assert frames == list(range(FRAMES))
    seen = sum(len(set(frame.tracks)) for frame in frames_of(store, len(document.windows)))
    assert seen == document.positions
    assert sum(len(content) for content in contents(done).values()) <= 30 * seen


def test_tracks_of_a_window_survive_the_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 100, (30, 12, 2)).astype(np.float32).astype(np.float64)
    points[rng.random((30, 12)) < 0.4] = np.nan
    labels, identities = rng.integers(-2, 4, 30), rng.integers(-1, 4, 30)
    stored = WindowTracks.of(100, np.arange(30) + 7, points, labels, identities)
    (tmp_path / "a.npz").write_bytes(stored.to_bytes())
    read = WindowTracks.from_file(str(tmp_path / "a.npz"))
    rows, frames = read.spread()
    again = np.full_like(points, np.nan)
    again[read.track[rows] - 7, frames - 100] = read.points
    np.testing.assert_array_equal(again, points)
    np.testing.assert_array_equal(labels[read.track - 7], read.label)


@pytest.mark.parametrize("finished", [1, 3])
def test_an_interrupted_clip_goes_on_to_the_same_bytes(
    clip: Clip, configuration: Configuration, done: Path, tmp_path: Path, finished: int
) -> None:
    class Killed(BaseException):
        pass

    def kill(window: WindowDocument) -> None:
        if window.index == finished - 1:
            raise Killed

    with pytest.raises(Killed):
        process(clip, configuration, tmp_path, kill)
    half = [document for document, _ in ClipStore(tmp_path).windows(finished)]
    assert [document.index for document in half] == list(range(finished))
    later: list[int] = []
    process(clip, configuration, tmp_path, lambda window: later.append(window.index))
    assert later == list(range(finished, 4))
    assert contents(tmp_path) == contents(done)


def test_a_kill_between_two_files_does_no_harm(
    clip: Clip, configuration: Configuration, done: Path, tmp_path: Path
) -> None:
    def stop(window: WindowDocument) -> None:
        if window.index == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process(clip, configuration, tmp_path, stop)
    # the files of a window whose state was not written
    for name in ClipStore(tmp_path).names(2):
        shutil.copy(done / name, tmp_path / name)
    process(clip, configuration, tmp_path)
    assert contents(tmp_path) == contents(done)


def test_exports_have_every_object_in_every_frame(done: Path, tmp_path: Path) -> None:
    document, store = read_clip(str(done))
    names = write_exports(document, store, ["mot", "objects", "tracks"], tmp_path)
    assert names == ["mot.txt", "objects.csv", "tracks.csv"]
    boxes = np.loadtxt(tmp_path / "mot.txt", delimiter=",")
    for identity in (one.identity for one in document.objects[:2]):
        assert len(boxes[boxes[:, 1] == identity]) == FRAMES
    assert (tmp_path / "tracks.csv").read_text().count("\n") == document.positions + 1


def test_run_writes_a_clip_in_windows(
    pictures: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    arguments = [f"--set={key}={value}" for key, value in WINDOWS.items()]
    command = ["run", str(pictures), "--out", str(tmp_path / "out"), *arguments]
    assert invoke([*command, "--format", "text", "--set", "report.video=yes"]) == 0
    assert "objects in 72 frames, 4 windows; the camera is static" in capfd.readouterr().out
    files = {path.name for path in (tmp_path / "out").rglob("*")}
    assert {"clip.json", "report.html", "motions.mp4", "00003.npz"} <= files
    assert "state.json" not in files
    assert not list(tmp_path.glob(".*"))
    page = (tmp_path / "out" / "report.html").read_text()
    assert page.count("<figure>") == 6
    assert invoke([*command, "--force", "--masks"]) == ExitStatus.CONFIGURATION
    assert "report.masks" in capfd.readouterr().err


def test_short_clips_are_no_clips_in_windows(pictures: Path) -> None:
    assert long_clip([str(pictures)], 0, None, 1, 100) is None
    assert long_clip([str(pictures)], 0, 30, 1, 30) is None


def test_errors_of_the_reader_arrive(pictures: Path, tmp_path: Path) -> None:
    shutil.copytree(pictures, tmp_path / "frames")
    (tmp_path / "frames" / "040.png").write_bytes(b"no picture")
    clip = long_clip([str(tmp_path / "frames")], 0, None, 1, 24)
    assert clip is not None
    with pytest.raises(DataError, match=r"040\.png"):
        list(in_background(clip.frames()))


def test_pieces_of_other_objects_are_not_listed() -> None:
    whole = ClipObject(1, 0, 40, [(0, 40)], tracks=30)
    piece = ClipObject(2, 5, 9, [(5, 9)], tracks=0, merged_into=1)
    late = ClipObject(3, 0, 20, [(0, 20)], tracks=12, merged_into=1)
    document = ClipDocument(
        inputs=["clip.mp4"],
        sha256="",
        start=0,
        step=1,
        width=64,
        height=48,
        frames=41,
        rate=None,
        windows=[(0, 41)],
        cameras=["static"],
        tracks=42,
        positions=900,
        objects=[whole, piece, late],
    )
    assert [row[0] for row in objects_table(document, plain=True).rows] == ["1", "3"]
    assert clip_summary(document).startswith("2 objects")
    assert timeline(document).count("<rect") == 2
