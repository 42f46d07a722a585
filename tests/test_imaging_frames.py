"""Frames: every kind of picture and video, in order; what is broken is named in one line."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mssegment.errors import ConfigurationError, DataError, MssegmentError, UsageError
from mssegment.imaging import frames
from mssegment.imaging.camera import undistort_points
from mssegment.imaging.corners import harris
from mssegment.imaging.frames import open_frames, reopen_frames
from mssegment.imaging.pictures import decode
from mssegment.imaging.threads import threads_for
from mssegment.inputs.standard_error import quiet
from mssegment.records import Camera, Frame


def texture(height: int = 60, width: int = 80, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=(height, width))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.rint(255 * (smooth - smooth.min()) / np.ptp(smooth)).astype(np.uint8)


def save(path: Path, picture: np.ndarray) -> str:
    assert cv2.imwrite(str(path), picture)
    return str(path)


@pytest.fixture
def pair(tmp_path: Path) -> list[str]:
    return [save(tmp_path / f"{i}.png", texture(seed=i)) for i in (1, 2)]


@pytest.fixture
def video(tmp_path: Path) -> str:
    """Ten frames; frame i is grey 10 + 20 i throughout."""
    path = str(tmp_path / "film.avi")
    with quiet():
        writer = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*"MJPG"), 10, (64, 48))
        for i in range(10):
            writer.write(np.full((48, 64, 3), 10 + 20 * i, np.uint8))
        writer.release()
    return path


def one_line(failure: pytest.ExceptionInfo[MssegmentError], *parts: str) -> None:
    message = str(failure.value)
    assert "\n" not in message
    for part in parts:
        assert part in message


def test_a_pair_with_size_and_digest(pair: list[str]) -> None:
    source = open_frames(pair)
    assert [frame.path for frame in source.frames] == pair
    assert source.size == (80, 60)
    assert source.frames[0].sha256 == hashlib.sha256(Path(pair[0]).read_bytes()).hexdigest()
    assert source.grey(1).dtype == np.float32
    np.testing.assert_array_equal(source.grey(1), texture(seed=2))


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp", ".pgm", ".webp", ".jpg"])
def test_kinds_of_files(tmp_path: Path, suffix: str) -> None:
    grey = texture()
    paths = [save(tmp_path / f"{i}{suffix}", grey) for i in range(2)]
    found = open_frames(paths).grey(0)
    assert np.abs(found - grey).mean() < (3 if suffix in (".jpg", ".webp") else 1e-6)


def test_colour_is_red_first_and_grey_weighs_it(tmp_path: Path) -> None:
    blue_green_red = np.zeros((20, 30, 3), np.uint8)
    blue_green_red[..., 2] = 200
    path = save(tmp_path / "red.png", blue_green_red)
    source = open_frames([path, path])
    np.testing.assert_array_equal(source.colour(0)[0, 0], [200, 0, 0])
    assert source.grey(0)[0, 0] == pytest.approx(0.299 * 200, abs=0.1)


def test_transparent_parts_are_white(tmp_path: Path) -> None:
    picture = np.zeros((20, 30, 4), np.uint8)
    picture[:, 15:, 3] = 255
    path = save(tmp_path / "alpha.png", picture)
    grey = open_frames([path, path]).grey(0)
    assert (grey[:, :15] == 255).all()
    assert (grey[:, 15:] == 0).all()


def test_a_picture_without_any_opacity_shows_its_colours(tmp_path: Path) -> None:
    picture = np.zeros((20, 30, 4), np.uint8)
    picture[:, 15:, :3] = 90
    path = save(tmp_path / "alpha.png", picture)
    source = open_frames([path, path])
    assert (source.grey(0)[:, 15:] == 90).all()
    assert "transparent everywhere" in source.notes[0]


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_sixteen_bits_use_the_whole_range_and_keep_fractions(tmp_path: Path, bits: int) -> None:
    top = 2**bits - 1
    deep = np.linspace(0, top, 60 * 80).reshape(60, 80).astype(np.uint16)
    source = open_frames([save(tmp_path / f"{i}.png", deep // (i + 1)) for i in range(2)])
    assert source.grey(0).max() == pytest.approx(255, abs=0.3)
    assert len(np.unique(source.grey(0))) > 256
    assert source.grey(1).max() == pytest.approx(127.5, abs=0.3), "one scale for all frames"


def test_a_folder_in_natural_order(tmp_path: Path) -> None:
    for i in (10, 9, 1):
        save(tmp_path / f"frame-{i}.png", texture(seed=i))
    (tmp_path / "notes.txt").write_text("not a picture")
    names = [os.path.basename(f.path) for f in open_frames([str(tmp_path)]).frames]
    assert names == ["frame-1.png", "frame-9.png", "frame-10.png"]
    pattern = str(tmp_path / "frame-*.png")
    assert [os.path.basename(f.path) for f in open_frames([pattern]).frames] == names
    chosen = open_frames([str(tmp_path)], start=0, step=2).frames
    assert [os.path.basename(f.path) for f in chosen] == ["frame-1.png", "frame-10.png"]


def test_brackets_in_a_name_are_no_pattern(tmp_path: Path) -> None:
    path = save(tmp_path / "a[1].png", texture())
    assert len(open_frames([path, path])) == 2


def test_a_video_by_frame_numbers(video: str) -> None:
    source = open_frames([video], start=2, stop=9, step=3)
    assert [frame.index for frame in source.frames] == [2, 5, 8]
    for i, index in enumerate((2, 5, 8)):
        assert source.grey(i).mean() == pytest.approx(10 + 20 * index, abs=3)
    assert [f.index for f in open_frames([video], start=7, stop=100).frames] == [7, 8, 9]


@pytest.mark.parametrize("suffix", ["mjpeg", "mjpg"])
def test_a_stream_of_jpeg_pictures_is_a_video(tmp_path: Path, suffix: str) -> None:
    # of some length: FFmpeg tells a stream of pictures from its first two kilobytes
    pictures = [cv2.imencode(".jpg", texture(480, 640, seed=i))[1] for i in range(5)]
    content = b"".join(picture.tobytes() for picture in pictures)
    stream, photo = tmp_path / f"film.{suffix}", tmp_path / "photo.jpg"
    stream.write_bytes(content)
    photo.write_bytes(content)
    source = open_frames([str(stream)])
    for i in range(5):
        assert np.abs(source.grey(i).astype(float) - texture(480, 640, seed=i)).max() < 60
    assert len(source) == 5
    # a photo may have a second view behind the first
    assert not frames.is_moving(str(photo))


def test_frames_of_a_document_open_again_in_any_order(video: str, pair: list[str]) -> None:
    again = reopen_frames(open_frames([video], step=3).frames)
    assert again.grey(2).mean() > again.grey(0).mean()
    assert again.grey(0).mean() == pytest.approx(10, abs=3)
    relative = [Frame(os.path.basename(p), 80, 60) for p in pair]
    assert len(reopen_frames(relative, folder=os.path.dirname(pair[0])).greys()) == 2


def test_a_document_whose_pictures_are_gone_or_changed(pair: list[str]) -> None:
    known = open_frames(pair).frames
    Path(pair[1]).write_bytes(Path(pair[0]).read_bytes())
    with pytest.raises(DataError) as failure:
        reopen_frames(known).grey(1)
    one_line(failure, pair[1], "SHA-256")
    Path(pair[1]).unlink()
    with pytest.raises(DataError) as failure:
        reopen_frames(known)
    one_line(failure, pair[1], "no such file, but the document refers to it")
    with pytest.raises(DataError) as failure:
        reopen_frames([Frame(pair[0], 81, 60)]).grey(0)
    one_line(failure, pair[0], "80x60", "81x60")


def test_missing_empty_and_foreign_files(tmp_path: Path, pair: list[str]) -> None:
    empty, text = tmp_path / "empty.png", tmp_path / "text.txt"
    empty.touch()
    text.write_text("no picture\n" * 50)
    film = tmp_path / "film.mp4"
    film.write_bytes(bytes(range(256)) * 9)
    named = tmp_path / "text.png"
    named.write_text("no picture")
    (tmp_path / "hollow").mkdir()
    for path, words in (
        (tmp_path / "missing.png", "no such file"),
        (empty, "empty"),
        (text, "a text file"),
        (film, "neither a picture nor a video"),
        (named, "cut short or damaged"),
        (tmp_path / "hollow", "no pictures"),
        (tmp_path / "none-*.png", "no file matches"),
    ):
        with pytest.raises(DataError) as failure:
            open_frames([pair[0], str(path)])
        one_line(failure, str(path), words)


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".webp", ".pgm"])
@pytest.mark.parametrize("share", [0.0005, 0.3, 0.8, 0.99])
def test_pictures_cut_short_are_named(tmp_path: Path, suffix: str, share: float) -> None:
    whole = Path(save(tmp_path / f"whole{suffix}", texture(200, 300))).read_bytes()
    cut = tmp_path / f"cut{suffix}"
    cut.write_bytes(whole[: max(1, int(len(whole) * share))])
    with pytest.raises(DataError) as failure:
        open_frames([str(cut), str(cut)])
    one_line(failure, str(cut), "cut short or damaged")


def test_sizes_that_differ_are_both_named(tmp_path: Path, pair: list[str]) -> None:
    other = save(tmp_path / "other.png", texture(50, 70))
    assert [frame.width for frame in open_frames([pair[0], other]).frames] == [80, 70], "two views"
    with pytest.raises(DataError) as failure:
        open_frames([*pair, other])
    one_line(failure, pair[0], "80x60", other, "70x50")


def test_ranges_that_hold_nothing(video: str, pair: list[str]) -> None:
    with pytest.raises(DataError) as failure:
        open_frames([video], start=50)
    one_line(failure, video, "no frame in the range")
    with pytest.raises(DataError) as failure:
        open_frames([video], start=9)
    one_line(failure, video, "1 frame ", "at least 2")
    with pytest.raises(DataError) as failure:
        open_frames(pair[:1])
    one_line(failure, "1 frame ", "at least 2")
    for bad in ({"start": -1}, {"step": 0}, {"start": 5, "stop": 5}):
        with pytest.raises(UsageError):
            open_frames([video], **bad)
    with pytest.raises(UsageError):
        open_frames([])


@pytest.mark.parametrize(("scale", "low"), [(1.0, 0.0), (4000.0, 0.0), (0.5, 0.0), (2.0, -1.0)])
def test_numbers_with_a_fraction_keep_their_contrast(
    tmp_path: Path, scale: float, low: float
) -> None:
    grey = texture()
    values = (grey / np.float32(255) * scale + low).astype(np.float32)
    path = save(tmp_path / "deep.tiff", values)
    found = open_frames([path, path]).grey(0)
    expected = grey * (scale if scale < 1 else 1.0)
    assert np.abs(found - expected).max() < 0.1
    values[3, 4] = np.nan
    save(tmp_path / "deep.tiff", values)
    with pytest.raises(DataError) as failure:
        open_frames([path, path])
    one_line(failure, path, "NaN or infinite")


def test_the_decoders_do_not_chatter(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], pair: list[str]
) -> None:
    whole = Path(pair[0]).read_bytes()
    cut = tmp_path / "cut.png"
    cut.write_bytes(whole[: len(whole) // 2] + b"IEND")
    bad = tmp_path / "bad.mp4"
    bad.write_bytes(b"nothing" * 100)
    for path in (cut, bad):
        with pytest.raises(DataError):
            open_frames([str(path), str(path)])
    assert capfd.readouterr().err == ""


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 3))
def test_bytes_of_any_kind_never_surprise(content: bytes, kind: int) -> None:
    head = (b"", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"BM")[kind]
    try:
        picture = decode("any.png", head + content or b"x")
    except DataError:
        return
    assert picture.dtype in (np.uint8, np.uint16)
    assert picture.ndim in (2, 3)


@pytest.mark.parametrize("lens", [(-0.3, 0.1), (0.2, -0.05, 0.001, -0.002, 0.01)])
def test_undistorted_points_distort_back(lens: tuple[float, ...]) -> None:
    camera = Camera(500, 520, 320, 240, lens)
    x, y = np.meshgrid(np.linspace(20, 620, 7), np.linspace(20, 460, 5))
    points = np.stack([x, y], axis=-1)
    points[0, 0] = np.nan
    straight = undistort_points(points, camera)
    assert straight.shape == points.shape
    assert np.isnan(straight[0, 0]).all()
    flat = straight.reshape(-1, 2)[1:]
    rays = np.column_stack([(flat - (320, 240)) / (500, 520), np.ones(len(flat))])
    full = np.array((*lens, 0.0, 0.0, 0.0)[:5])
    again, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), camera.matrix, full)
    np.testing.assert_allclose(again.reshape(-1, 2), points.reshape(-1, 2)[1:], atol=1e-6)
    assert undistort_points(points, Camera(500, 520, 320, 240)) is points
    with pytest.raises(ConfigurationError):
        undistort_points(points, Camera(500, 520, 320, 240, (0.1,) * 15))


@pytest.mark.data
def test_real_video_and_real_pair(data_folder: Path) -> None:
    source = open_frames([str(data_folder / "video/car_traffic_small.mp4")], 100, 115, 3)
    assert [frame.index for frame in source.frames] == [100, 103, 106, 109, 112]
    assert source.size == (640, 360)
    folder = data_folder / "kt3dmoseg/frames/Seq009_Clip03"
    assert len(open_frames([str(folder)], stop=4)) == 4


def test_a_long_video_need_not_fit_memory(video: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frames, "CACHE_BYTES", 3 * 48 * 64 * 3)
    greys = open_frames([video]).greys()
    assert len(greys) == 10
    for _ in range(2):
        for index, grey in enumerate(greys):
            assert grey.mean() == pytest.approx(10 + 20 * index, abs=3)
    assert greys[2].mean() < greys[-1].mean()
    assert [round(float(g.mean()), -1) for g in greys[1:7:3]] == [30, 90]
    with pytest.raises(IndexError):
        greys[10]


@pytest.mark.parametrize(("frames", "expected"), [(2, 1), (3, 3)])
def test_two_views_take_one_thread_and_give_the_others_back(frames, expected):
    usual = cv2.getNumThreads()
    cv2.setNumThreads(3)
    try:
        with threads_for(frames):
            assert cv2.getNumThreads() == expected
        assert cv2.getNumThreads() == 3
    finally:
        cv2.setNumThreads(usual)


def test_harris_is_its_formula_also_where_memory_is_used_again():
    grey = texture().astype(np.float32)
    gx, gy = (cv2.Scharr(grey, cv2.CV_32F, *way, scale=1 / 32) for way in ((1, 0), (0, 1)))
    xx, yy, xy = (cv2.GaussianBlur(p, (0, 0), 1.0) for p in (gx * gx, gy * gy, gx * gy))
    expected = xx * yy - xy * xy - np.float32(0.04) * (xx + yy) * (xx + yy)
    np.testing.assert_array_equal(harris(grey), expected)
