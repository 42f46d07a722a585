"""Videos: as many frames as there are, of the right size, with something that moves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from rendering_samples import affine_report

from mssegment.errors import UsageError
from mssegment.records import replace
from mssegment.rendering import h264
from mssegment.rendering.layout import view_of
from mssegment.rendering.scene import Lines
from mssegment.rendering.video import (
    make_video,
    render_video,
    source_rate,
    trail_items,
    video_frames,
)


def frames_of(content, path):
    path.write_bytes(content)
    capture = cv2.VideoCapture(str(path))
    frames = []
    while True:
        fine, frame = capture.read()
        if not fine:
            return frames
        frames.append(frame)


def test_mp4_of_a_sequence_has_every_frame(tmp_path):
    report = affine_report(frames=14, tracks=24)
    frames = frames_of(render_video(report, "mp4"), tmp_path / "a.mp4")
    assert len(frames) == 14
    expected = next(video_frames(report))
    assert frames[0].shape == expected.shape
    assert expected.shape[0] % 2 == expected.shape[1] % 2 == 0
    assert np.abs(frames[0].astype(int) - expected).mean() < 12
    assert np.abs(frames[0].astype(int) - frames[-1]).mean() > 0.2


def test_mp4_of_a_pair_repeats_it(tmp_path):
    frames = frames_of(render_video(affine_report(tracks=24), "mp4"), tmp_path / "a.mp4")
    assert len(frames) == 8


@pytest.mark.parametrize("file_format", ["gif", "webp"])
@pytest.mark.skipif(not hasattr(cv2, "imwriteanimation"), reason="OpenCV writes no animations")
def test_animations(file_format, tmp_path):
    path = tmp_path / f"a.{file_format}"
    path.write_bytes(render_video(affine_report(frames=3, tracks=24), file_format))
    fine, animation = cv2.imreadanimation(str(path))
    assert fine
    assert len(animation.frames) == 3


def test_trails_appear_behind_the_points():
    report = affine_report(frames=14)
    last = view_of(report, 13)
    colours = [item for item in trail_items(report, last) if isinstance(item, Lines)]
    track = report.members(1)[0]
    passed = last.to_picture(report.tracks.points[track, 1:14])
    drawn = np.concatenate([path for item in colours for path in item.paths])
    nearest = np.linalg.norm(passed[:, None] - drawn[None], axis=2).min(axis=1)
    assert nearest.max() < 1e-9
    assert all(item.opacity < 1 for item in colours)


def test_wrong_formats_are_named():
    with pytest.raises(UsageError, match="avi"):
        render_video(affine_report(), "avi")


def with_times(report, rate):
    frames = [replace(frame, time=i / rate) for i, frame in enumerate(report.frames)]
    return replace(report, frames=tuple(frames))


@pytest.mark.parametrize("rate", [25.0, 30000 / 1001, 12.5, 60.0])
def test_the_rate_is_that_of_the_source(rate):
    report = with_times(affine_report(frames=14, tracks=24), rate)
    rounded = [replace(frame, time=round(frame.time, 6)) for frame in report.frames]
    assert float(source_rate(rounded)) == pytest.approx(rate, abs=1e-3)
    assert source_rate(rounded[::3]) == pytest.approx(rate / 3, abs=1e-3)
    assert source_rate(affine_report(frames=3).frames) is None
    dropped = [*rounded[:4], *rounded[6:]]
    assert float(source_rate(dropped)) == pytest.approx(rate, abs=1e-3)


@pytest.mark.parametrize("with_pyav", [True, False])
def test_a_video_has_the_size_and_rate_of_its_source(tmp_path, monkeypatch, with_pyav):
    if with_pyav:
        pytest.importorskip("av")
        if h264.encoder() is None:
            pytest.skip("this PyAV has no H.264 encoder")
    else:
        monkeypatch.setattr(h264, "encoder", lambda: None)
    report = with_times(affine_report(frames=14, tracks=24), 25.0)
    video = make_video(report)
    (tmp_path / "a.mp4").write_bytes(video.content)
    capture = cv2.VideoCapture(str(tmp_path / "a.mp4"))
    width, height = (int(capture.get(p)) for p in (3, 4))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(25.0)
    assert width == report.frames[0].width // 2 * 2
    assert height > report.frames[0].height
    assert f"14 frames of {width}x{height} pixels" in video.description
    assert "25 a second" in video.description
    if with_pyav:
        assert video.description.endswith("H.264")
        assert video.content == make_video(report).content
    else:
        assert "mssegment[video]" in video.description
