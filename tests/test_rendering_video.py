"""Videos: as many frames as there are, of the right size, with something that moves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from rendering_samples import affine_report

from mssegment.errors import UsageError
from mssegment.rendering.layout import view_of
from mssegment.rendering.scene import Lines
from mssegment.rendering.video import render_video, trail_items, video_frames


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
