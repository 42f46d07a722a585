"""Where frames come from: videos by two decoders, animations, stacks, patterns, and no files."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from mssegment.errors import DataError
from mssegment.imaging import opencv_decoder, video_readers
from mssegment.imaging.frames import open_frames, reopen_frames
from mssegment.imaging.orientation import upright
from mssegment.imaging.video_readers import End, VideoFrame
from mssegment.imaging.videos import Video
from mssegment.inputs.standard_error import quiet

READERS = ["pyav", "opencv"]


def shade(i: int, height: int = 48, width: int = 64) -> np.ndarray:
    """Frame i: grey 20 + 20 i, with a brighter corner at the top left."""
    picture = np.full((height, width, 3), 20 + 20 * (i % 11), np.uint8)
    picture[: height // 4, : width // 4] = 250
    return picture


@pytest.fixture(params=READERS)
def reader(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Runs a test with each of the two decoders."""
    if request.param == "pyav":
        pytest.importorskip("av")
    monkeypatch.setattr(video_readers, "has_pyav", lambda: request.param == "pyav")
    return str(request.param)


def film(path: Path, frames: int = 10, codec: str = "MJPG", rate: float = 12.5) -> str:
    with quiet():
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate, (64, 48))
        for i in range(frames):
            writer.write(shade(i))
        writer.release()
    return str(path)


def test_numbers_times_and_pictures_of_a_video(tmp_path: Path, reader: str) -> None:
    path = film(tmp_path / "film.avi")
    source = open_frames([path], start=1, stop=9, step=3)
    assert [frame.index for frame in source.frames] == [1, 4, 7]
    assert [frame.time for frame in source.frames] == [0.08, 0.32, 0.56]
    for i, index in enumerate((1, 4, 7)):
        assert source.grey(i)[20:].mean() == pytest.approx(20 + 20 * index, abs=3)
    again = reopen_frames(source.frames)
    assert again.grey(2)[20:].mean() == pytest.approx(160, abs=3)
    assert again.grey(0)[20:].mean() == pytest.approx(40, abs=3)
    with pytest.raises(DataError, match="only 10 frames can be decoded"):
        Video(path).read(10)


def test_both_decoders_agree(tmp_path: Path) -> None:
    pytest.importorskip("av")
    path = film(tmp_path / "film.mp4", codec="mp4v", rate=30000 / 1001)
    both = [
        list(read(path, 2, None, 3))
        for read in (video_readers._read_by_pyav, video_readers._read_by_child)
    ]
    assert [type(frame) for frame in both[0]] == [VideoFrame] * 3 + [End]
    for one, other in zip(both[0][:-1], both[1][:-1], strict=True):
        assert isinstance(one, VideoFrame)
        assert isinstance(other, VideoFrame)
        assert one.index == other.index
        assert one.seconds == pytest.approx(other.seconds, abs=1e-6)
        assert np.abs(one.picture.astype(int) - other.picture).mean() < 1


def test_a_decoder_that_dies_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "decoder.py"
    script.write_text(
        "import os, signal, sys, struct\n"
        "sys.stdout.buffer.write(struct.pack('<qdqq', 0, 0.0, 2, 2) + bytes(12))\n"
        "sys.stdout.flush()\n"
        "os.kill(os.getpid(), signal.SIGABRT)\n"
    )
    monkeypatch.setattr(opencv_decoder, "__file__", str(script))
    monkeypatch.setattr(video_readers, "has_pyav", lambda: False)
    with pytest.raises(DataError, match=r"died after frame 0 \(SIGABRT\).*mssegment\[video\]"):
        open_frames([film(tmp_path / "film.avi")])


def test_colours_sampled_in_two_ways_within_a_film(tmp_path: Path, reader: str) -> None:
    """Trail cameras change the sampling of Motion JPEG after the first frame."""
    path = tmp_path / "film.avi"
    write_mjpeg(path, [(shade(i), 0x211111 if i == 0 else 0x221111) for i in range(5)])
    source = open_frames([str(path)])
    assert len(source) == 5
    for i in range(5):
        assert np.abs(source.colour(i).astype(int) - shade(i)).mean() < 3


def write_mjpeg(path: Path, frames: list[tuple[np.ndarray, int]]) -> None:
    """An AVI of JPEG pictures, each with its own sampling of colours."""
    flags = [int(cv2.IMWRITE_JPEG_SAMPLING_FACTOR)]
    jpegs = [cv2.imencode(".jpg", p, [*flags, sampling])[1].tobytes() for p, sampling in frames]
    height, width = frames[0][0].shape[:2]

    def chunk(name: bytes, content: bytes) -> bytes:
        return name + struct.pack("<I", len(content)) + content + b"\0" * (len(content) % 2)

    def group(kind: bytes, *parts: bytes) -> bytes:
        return chunk(b"LIST", kind + b"".join(parts))

    count = len(jpegs)
    main = struct.pack("<14I", 100000, 0, 0, 0x10, count, 0, 1, 0, width, height, 0, 0, 0, 0)
    stream = b"vidsMJPG" + struct.pack("<10I4H", 0, 0, 0, 1, 10, 0, count, 0, 0, 0, 0, 0, 0, 0)
    form = struct.pack("<IIIHH4sIIIII", 40, width, height, 1, 24, b"MJPG", 0, 0, 0, 0, 0)
    headers = group(
        b"hdrl", chunk(b"avih", main), group(b"strl", chunk(b"strh", stream), chunk(b"strf", form))
    )
    body = [chunk(b"00dc", jpeg) for jpeg in jpegs]
    places = np.cumsum([4, *map(len, body)])
    index = b"".join(
        struct.pack("<4sIII", b"00dc", 0x10, place, len(jpeg))
        for place, jpeg in zip(places, jpegs, strict=False)
    )
    content = b"AVI " + headers + group(b"movi", *body) + chunk(b"idx1", index)
    path.write_bytes(chunk(b"RIFF", content))


def box(name: bytes, *inside: bytes) -> bytes:
    content = b"".join(inside)
    return struct.pack(">I", 8 + len(content)) + name + content


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (box(b"ftyp", b"isom") + box(b"mdat", bytes(99)), "cut short .an MP4 without its index"),
        (
            box(b"ftyp", b"isom") + box(b"moov", box(b"trak", box(b"mdia", box(b"hdlr", bytes(8),
            b"soun", bytes(12))))),
            "sound only",
        ),
        (b"ID3" + bytes(500), "sound only"),
        (box(b"ftyp", b"heic" + bytes(8)) + bytes(99), "a HEIC picture, which is not read"),
        (b"PK\x03\x04" + bytes(99), "an archive; unpack it"),
        (b"\x1aE\xdf\xa3" + bytes(500), "neither a picture nor a video"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_video(
    tmp_path: Path, reader: str, content: bytes, words: str
) -> None:
    path = tmp_path / "clip.mp4"
    path.write_bytes(content)
    with pytest.raises(DataError, match=words) as caught:
        open_frames([str(path)])
    assert "\n" not in str(caught.value)


def test_a_film_cut_short_says_so(tmp_path: Path, reader: str) -> None:
    whole = Path(film(tmp_path / "whole.mp4", codec="mp4v", frames=40)).read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match="cut short"):
        open_frames([str(tmp_path / "cut.mp4")])


ANIMATIONS = ["gif", "webp", "png"]


@pytest.mark.skipif(not hasattr(cv2, "imencodeanimation"), reason="OpenCV before 4.11")
@pytest.mark.parametrize("kind", ANIMATIONS)
def test_animations_are_sequences(tmp_path: Path, kind: str) -> None:
    animation = cv2.Animation()
    animation.frames = [shade(i) for i in range(5)]
    animation.durations = [40] * 5
    path = tmp_path / f"clip.{kind}"
    assert cv2.imwriteanimation(str(path), animation)
    source = open_frames([str(path)], start=1)
    assert [frame.index for frame in source.frames] == [1, 2, 3, 4]
    np.testing.assert_allclose([f.time for f in source.frames], [0.04, 0.08, 0.12, 0.16])
    for i in range(4):
        # the palette of OpenCV's own GIF is coarse, so only means can be compared
        assert source.colour(i)[20:].mean() == pytest.approx(40 + 20 * i, abs=8)
        assert source.colour(i)[:10, :10].mean() == pytest.approx(250, abs=8)
    assert reopen_frames(source.frames).grey(3)[20:].mean() == pytest.approx(100, abs=8)


@pytest.mark.parametrize("kind", ["GIF", "WEBP", "PNG"])
def test_animations_of_pillow(tmp_path: Path, kind: str) -> None:
    image = pytest.importorskip("PIL.Image")
    if not hasattr(cv2, "imdecodeanimation"):
        pytest.skip("OpenCV before 4.11")
    frames = [image.fromarray(shade(i)) for i in range(4)]
    path = tmp_path / "clip.bin"
    frames[0].save(path, kind, save_all=True, append_images=frames[1:], duration=50, lossless=True)
    source = open_frames([str(path)])
    assert len(source) == 4
    for i in range(4):
        assert np.abs(source.colour(i).astype(int) - shade(i)).mean() < 4


def test_pages_of_a_tiff_are_frames(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    pages = [rng.integers(0, 60000, (30, 40), dtype=np.uint16) for _ in range(3)]
    for name in "ab":
        assert cv2.imwritemulti(str(tmp_path / f"{name}.tif"), pages)
    source = open_frames([str(tmp_path / "a.tif"), str(tmp_path / "b.tif")])
    assert [frame.index for frame in source.frames] == [0, 1, 2, 0, 1, 2]
    np.testing.assert_array_equal(source.pixels(5), pages[2])
    assert source.frames[0].time is None
    overview = [pages[0], pages[0][::2, ::2]]
    assert cv2.imwritemulti(str(tmp_path / "c.tif"), overview)
    assert len(open_frames([str(tmp_path / "c.tif")] * 2).frames) == 2, "an overview is no frame"


def exif(orientation: int) -> bytes:
    return b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)


def with_exif(content: bytes, note: bytes) -> bytes:
    """A PNG or simple WebP with an EXIF note."""
    if content.startswith(b"\x89PNG"):
        chunk = b"eXIf" + note
        whole = struct.pack(">I", len(note)) + chunk + struct.pack(">I", zlib.crc32(chunk))
        return content[:33] + whole + content[33:]
    body = content[12:] + b"EXIF" + struct.pack("<I", len(note)) + note + b"\0" * (len(note) % 2)
    return b"RIFF" + struct.pack("<I", 4 + len(body)) + b"WEBP" + body


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["png", "webp"])
def test_pictures_are_shown_as_exif_says(tmp_path: Path, kind: str, orientation: int) -> None:
    straight = shade(2)
    straight[:, 40:] //= 2
    # stored so that turning it as noted gives the straight picture
    stored = next(
        turned
        for turned in (np.rot90(m, k) for m in (straight, straight[:, ::-1]) for k in range(4))
        if upright(turned, orientation).shape == straight.shape
        and (upright(turned, orientation) == straight).all()
    )
    path = tmp_path / f"turned.{kind}"
    lossless = [int(cv2.IMWRITE_WEBP_QUALITY), 101]
    content = cv2.imencode(f".{kind}", np.ascontiguousarray(stored), lossless)[1].tobytes()
    path.write_bytes(with_exif(content, exif(orientation)))
    found = open_frames([str(path)], at_least=1).colour(0)[..., ::-1]
    np.testing.assert_array_equal(found, straight)


def test_orientations_agree_with_pillow(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    ops = pytest.importorskip("PIL.ImageOps")
    picture = np.random.default_rng(0).integers(0, 255, (6, 4, 3), dtype=np.uint8)
    for orientation in range(1, 9):
        note = image.Exif()
        note[0x0112] = orientation
        image.fromarray(picture).save(tmp_path / "a.png", exif=note)
        expected = np.asarray(ops.exif_transpose(image.open(tmp_path / "a.png")))
        found = open_frames([str(tmp_path / "a.png")], at_least=1).colour(0)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("pattern", ["f_%03d.png", "f_%d.png", "f_%3d.png", "f_*.png"])
def test_patterns_of_opencv_and_ffmpeg(tmp_path: Path, pattern: str) -> None:
    for i in (2, 10, 7):
        cv2.imwrite(str(tmp_path / f"f_{i:03d}.png"), shade(i))
    (tmp_path / "f_abc.txt").touch()
    found = open_frames([str(tmp_path / pattern)]).frames
    assert [Path(frame.path).stem for frame in found] == ["f_002", "f_007", "f_010"]
    with pytest.raises(DataError, match="no file matches this pattern"):
        open_frames([str(tmp_path / "g_%03d.png")])


def test_labels_in_a_folder_are_no_frames(tmp_path: Path) -> None:
    for i in range(3):
        for name in ("frame", "mask"):
            cv2.imwrite(str(tmp_path / f"{name}-{i}.png"), shade(i))
    source = open_frames([str(tmp_path)])
    assert [Path(frame.path).stem for frame in source.frames] == ["frame-0", "frame-1", "frame-2"]
    assert "3 pictures named as labels (mask-0.png, ...) are no frames" in source.notes[0]
    cv2.imwrite(str(tmp_path / "preview.png"), shade(1))
    assert "several series (frame-#.png, preview.png)" in open_frames([str(tmp_path)]).notes[1]
    only = tmp_path / "masks"
    only.mkdir()
    cv2.imwrite(str(only / "mask-1.png"), shade(1))
    assert len(open_frames([str(only)], at_least=1)) == 1


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("https://example.org/1.png", "URLs and streams are not fetched"),
        ("rtsp://camera.local/stream", "URLs and streams are not fetched"),
        ("0", "cameras are not opened by their number"),
        ("-", "not read from standard input"),
        ("/dev/null", "a device"),
        (os.fsdecode(b"b\xe4ld.png"), "not UTF-8"),
    ],
)
def test_what_is_no_file_is_refused(given: str, words: str) -> None:
    with pytest.raises(DataError, match=words):
        open_frames([given])


@pytest.mark.parametrize(
    ("files", "given", "words"),
    [
        ({"cam0/1.png": b"", "cam1/1.png": b""}, ".", r"name one of its folders .cam0, cam1."),
        ({"a.heic": b"", "b.heic": b""}, ".", "convert its HEIC pictures"),
        ({"a.txt": b"", "b.doc": b""}, ".", r"found .doc, .txt files"),
        ({"a.dng": b"II*\0"}, "a.dng", "the raw file of a camera"),
        ({"1.png": b"version https://git-lfs.github.com/spec/v1\n"}, "1.png", "git lfs pull"),
    ],
)
def test_what_is_there_instead_of_pictures_is_said(
    tmp_path: Path, files: dict[str, bytes], given: str, words: str
) -> None:
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=words):
        open_frames([str(tmp_path / given)])


def test_pipes_are_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.png")
    with pytest.raises(DataError, match="a pipe, which can be read only once"):
        open_frames([str(tmp_path / "pipe.png")])
