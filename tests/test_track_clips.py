"""Tracks of another program over many frames: windows, identities, going on, what is refused."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from passing_bodies import SIZE, passing_bodies

from mssegment.cli import invoke
from mssegment.clips.choice import clip_of
from mssegment.clips.frames import frames_of
from mssegment.clips.process import process
from mssegment.clips.segment import segment_window
from mssegment.clips.store import ClipStore, read_clip
from mssegment.clips.track_clip import TrackClip
from mssegment.configuration import Configuration, from_mapping, resolve
from mssegment.documents.clips import WindowDocument
from mssegment.errors import ExitStatus
from mssegment.records import Floats, Integers
from mssegment.runs import open_tracks
from mssegment.sequences.lifetimes import WindowLimits, plan_windows

FRAMES, SHORT = 300, 120
QUIET = ["--set", "report.html=no", "--set", "report.pictures=no", "--format", "text"]


@pytest.fixture(scope="module")
def bodies() -> tuple[Floats, Integers]:
    return passing_bodies(np.random.default_rng(0), FRAMES)


@pytest.fixture(scope="module")
def folder(bodies: tuple[Floats, Integers], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tracks over all frames."""
    return written(bodies[0], tmp_path_factory.mktemp("tracks"))


def written(points: Floats, folder: Path) -> Path:
    """The same tracks as arrays, as a table, and as boxes of MOTChallenge."""
    points = points[np.isfinite(points[..., 0]).any(axis=1)]
    np.savez(folder / "tracks.npz", tracks=points)
    track, frame = np.nonzero(np.isfinite(points[..., 0]))
    x, y = points[track, frame].T.tolist()
    rows = list(zip(track.tolist(), frame.tolist(), x, y, strict=True))
    table = "".join(f"{t},{f},{x!r},{y!r}\n" for t, f, x, y in rows)
    (folder / "tracks.csv").write_text(f"track,frame,x,y\n{table}")
    boxes = "".join(f"{f + 1},{t + 1},{x - 2!r},{y - 2!r},4,4,1\n" for t, f, x, y in rows)
    (folder / "boxes.txt").write_text(boxes)
    return folder


def opened(path: Path, **settings: object) -> tuple[Configuration, TrackClip]:
    configuration = resolve(from_mapping({"input.tracks": str(path), **settings}, "test"))
    clip = clip_of(configuration, open_tracks(configuration))
    assert isinstance(clip, TrackClip)
    return configuration, clip


@pytest.fixture(scope="module")
def done(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("clip")
    configuration, clip = opened(folder / "tracks.npz")
    process(clip, configuration, out)
    return out


@pytest.fixture(scope="module")
def short(bodies: tuple[Floats, Integers], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first frames of the same, enough for windows."""
    points, _ = bodies
    return written(points[:, :SHORT], tmp_path_factory.mktemp("short"))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def test_windows_are_those_of_the_rule(done: Path, bodies: tuple[Floats, Integers]) -> None:
    planned = plan_windows(bodies[0], WindowLimits())
    found = read_clip(str(done))[0].windows
    # a few frames at the end belong to the last window
    assert len(planned) - 1 <= len(found) <= len(planned)
    assert found[:-1] == planned[: len(found) - 1]
    assert found[-1] == (planned[len(found) - 1][0], FRAMES)


def test_a_window_has_the_labels_of_its_frames_alone(
    done: Path, bodies: tuple[Floats, Integers], folder: Path
) -> None:
    document, store = read_clip(str(done))
    configuration, clip = opened(folder / "tracks.npz")
    stop = document.windows[0][1]
    points = bodies[0][:, :stop]
    seen = np.flatnonzero(np.isfinite(points[..., 0]).any(axis=1))
    names = np.array(clip.ids, dtype=np.int64) - 1
    order = seen[np.argsort(np.argsort(names)[seen])]
    alone = segment_window(
        points[order],
        clip.frames[:stop],
        configuration,
        earlier_background=np.zeros(len(order), dtype=bool),
        history=clip.history,
    )
    _, stored = next(iter(store.windows(1)))
    for track, label in zip(stored.track.tolist(), stored.label.tolist(), strict=True):
        own = alone.labels[order == names[track]]
        assert label == own or (own > 0 and label == -1)  # at rest before it moves


def test_each_body_is_one_object(done: Path, bodies: tuple[Floats, Integers]) -> None:
    document, store = read_clip(str(done))
    truth = bodies[1][np.array(document.ids, dtype=np.int64) - 1]
    found: dict[int, dict[int, int]] = {}
    for frame in frames_of(store, len(document.windows)):
        for track, identity in zip(frame.tracks, frame.identities, strict=True):
            if identity > 0:
                counts = found.setdefault(int(identity), {})
                counts[int(truth[track])] = counts.get(int(truth[track]), 0) + 1
    assert set(document.cameras) == {"static"}
    assert len(found) == len(document.objects) == 3  # also the one that stops
    assert sorted(max(counts, key=counts.__getitem__) for counts in found.values()) == [1, 2, 3]
    for counts in found.values():
        assert max(counts.values()) >= 0.97 * sum(counts.values())


def test_arrays_tables_and_boxes_have_one_result(done: Path, folder: Path, tmp_path: Path) -> None:
    for name in ("tracks.csv", "boxes.txt"):
        out = tmp_path / name
        out.mkdir()
        configuration, clip = opened(folder / name)
        process(clip, configuration, out)
        windows = len(read_clip(str(done))[0].windows)
        for (one, mine), (other, theirs) in zip(
            ClipStore(done).windows(windows), ClipStore(out).windows(windows), strict=True
        ):
            assert one.motions == other.motions or name == "boxes.txt"
            np.testing.assert_array_equal(mine.identity, theirs.identity)
            np.testing.assert_allclose(mine.points, theirs.points, atol=1e-4)


@pytest.mark.parametrize("finished", [1, 4, -1])
def test_interrupted_tracks_go_on_to_the_same_bytes(
    folder: Path, done: Path, tmp_path: Path, finished: int
) -> None:
    class Killed(BaseException):
        pass

    count = len(read_clip(str(done))[0].windows)
    last = finished % (count + 1) - 1

    def kill(window: WindowDocument) -> None:
        if window.index == last:
            raise Killed

    configuration, clip = opened(folder / "tracks.npz")
    with pytest.raises(Killed):
        process(clip, configuration, tmp_path, kill)
    later: list[int] = []
    process(clip, configuration, tmp_path, lambda window: later.append(window.index))
    assert later == list(range(last + 1, count))
    assert contents(tmp_path) == contents(done)


def test_a_track_that_is_seen_again_is_remembered(tmp_path: Path) -> None:
    points, bodies = passing_bodies(np.random.default_rng(1), 200, life=400)
    points[bodies == 1, 70:130] = np.nan  # hidden for longer than a window
    points[bodies == 1, 130:, 0] -= 150  # elsewhere, so that only its tracks tell
    np.savez(tmp_path / "tracks.npz", tracks=points)
    configuration, clip = opened(tmp_path / "tracks.npz")
    document = process(clip, configuration, tmp_path)
    hidden = [one for one in document.objects if one.moving[:1] == [(0, 69)]]
    assert len(hidden) == 1
    assert hidden[0].moving[1:] == [(130, 199)]


class TestRun:
    def test_the_names_of_the_file_are_kept(self, short: Path, tmp_path: Path) -> None:
        out = tmp_path / "out"
        command = ["run", str(short / "tracks.csv"), "--out", str(out), "--export", "tracks"]
        assert invoke([*command, *QUIET]) == 0
        table = np.loadtxt(out / "tracks.csv", delimiter=",", skiprows=1)
        given = np.loadtxt(short / "tracks.csv", delimiter=",", skiprows=1)
        assert len(table) == len(given)
        table = table[np.lexsort((table[:, 1], table[:, 0]))]
        np.testing.assert_allclose(table[:, :4], given, atol=1e-3)

    def test_it_is_drawn_on_the_pictures(self, short: Path, tmp_path: Path) -> None:
        pictures = tmp_path / "frames"
        pictures.mkdir()
        for number in range(SHORT):
            picture = np.full((SIZE[1], SIZE[0], 3), (0, 90, 0), np.uint8)
            cv2.imwrite(str(pictures / f"{number:04d}.png"), picture)
        out = tmp_path / "out"
        command = ["run", str(short / "tracks.npz"), "--images", str(pictures)]
        assert invoke([*command, "--out", str(out), "--format", "text"]) == 0
        stills = sorted((out / "stills").glob("*.jpg"))
        assert len(stills) == 6
        drawn = cv2.imread(str(stills[2]))
        green = np.abs(drawn.astype(int) - (0, 90, 0)).max(axis=2) < 30
        assert 0.5 < green.mean() < 0.999

    def test_without_pictures_it_is_drawn_on_a_plain_one(self, short: Path, tmp_path: Path) -> None:
        out = tmp_path / "out"
        command = ["run", str(short / "tracks.npz"), "--out", str(out), "--format", "text"]
        assert invoke(command) == 0
        drawn = cv2.imread(str(min((out / "stills").glob("*.jpg"))))
        assert abs(int(np.median(drawn)) - 236) < 3

    @pytest.mark.parametrize(
        ("options", "status", "said"),
        [
            (["--masks"], ExitStatus.CONFIGURATION, "report.masks"),
            (["--labels", "truth.csv"], ExitStatus.CONFIGURATION, "report.labels"),
            (["--export", "npz"], ExitStatus.CONFIGURATION, "report.export is npz"),
            (["--images", "few"], ExitStatus.DATA, "120 frames"),
            (["--images", "small"], ExitStatus.DATA, "outside the pictures"),
        ],
    )
    def test_what_cannot_be_is_said_in_one_line(
        self,
        short: Path,
        tmp_path: Path,
        capfd: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
        options: list[str],
        status: ExitStatus,
        said: str,
    ) -> None:
        monkeypatch.chdir(tmp_path)
        (tmp_path / "tracks.csv").write_bytes((short / "tracks.csv").read_bytes())
        (tmp_path / "truth.csv").write_text("x,y,label\n100,100,1\n")
        for name, count, size in (("few", 3, 480), ("small", SHORT, 20)):
            (tmp_path / name).mkdir()
            for number in range(count):
                picture = np.zeros((size, size, 3), np.uint8)
                cv2.imwrite(str(tmp_path / name / f"{number:04d}.png"), picture)
        assert invoke(["run", "tracks.csv", "--out", "out", "--quiet", *options]) == status
        lines = capfd.readouterr().err.strip().splitlines()
        assert said in lines[-1]
        assert not (tmp_path / "out").exists()

    def test_up_to_a_hundred_frames_are_one_window(self, short: Path, tmp_path: Path) -> None:
        points = np.load(short / "tracks.npz")["tracks"][:, :100]
        seen = np.isfinite(points[..., 0]).sum(axis=1) >= 3
        np.savez(tmp_path / "short.npz", tracks=points[seen])
        command = ["run", str(tmp_path / "short.npz"), "--out", str(tmp_path / "out"), *QUIET]
        assert invoke(command) == 0
        assert (tmp_path / "out" / "segmentation.json").exists()
        assert invoke([*command, "--force", "--set", "sequence.window=30"]) == 0
        assert (tmp_path / "out" / "clip.json").exists()
        assert not (tmp_path / "out" / "segmentation.json").exists()

    def test_numbers_of_frames_are_those_of_the_file(self, short: Path, tmp_path: Path) -> None:
        table = np.loadtxt(short / "tracks.csv", delimiter=",", skiprows=1)
        table[:, 1] = 7 + 2 * table[:, 1] + (table[:, 1] > 40)
        np.savetxt(
            tmp_path / "t.csv",
            table,
            delimiter=",",
            header="track,frame,x,y",
            comments="",
            fmt="%.9g",
        )
        out = tmp_path / "out"
        command = ["run", str(tmp_path / "t.csv"), "--out", str(out), "--export", "tracks"]
        assert invoke([*command, *QUIET]) == 0
        written = np.loadtxt(out / "tracks.csv", delimiter=",", skiprows=1)
        assert set(written[:, 1]) == set(table[:, 1])


def test_frames_without_a_track_are_windows_without_motions(tmp_path: Path) -> None:
    points, _ = passing_bodies(np.random.default_rng(2), 200, life=60)
    points[:, 60:150] = np.nan
    np.savez(tmp_path / "tracks.npz", tracks=points)
    configuration, clip = opened(tmp_path / "tracks.npz")
    document = process(clip, configuration, tmp_path)
    assert document.frames == 200
    assert document.positions == np.isfinite(points[..., 0]).sum()


def test_many_short_tracks_need_no_array_of_all_frames(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    rows = [
        (track, track // 3 + frame, 300 + 0.5 * frame, 200 + track % 7)
        for track in range(3000)
        for frame in range(4)
    ]
    table = np.array(rows) + np.column_stack(
        [np.zeros((len(rows), 2)), rng.uniform(0, 200, (len(rows), 2))]
    )
    np.savetxt(tmp_path / "t.csv", table, delimiter=",", header="track,frame,x,y", comments="")
    # 3000 x 1003 places are more than the limit, 12 000 positions are not
    _, clip = opened(tmp_path / "t.csv", **{"limits.positions": 100_000})
    assert len(clip.points) == 12_000
