"""The static world under a moving camera is found, named, drawn quietly, and can be left alone."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rendering_samples import affine_report, picture

import mssegment
from mssegment.datasets import read
from mssegment.documents import decode, encode
from mssegment.documents.schemas import SegmentationDocument
from mssegment.records import BACKGROUND, Frame, replace
from mssegment.rendering.layout import number_badges, view_of
from mssegment.rendering.page import render_page
from mssegment.rendering.pictures import motion_entries
from mssegment.rendering.report_json import report_json
from mssegment.rendering.tables import format_report
from mssegment.segmentation.camera_motion import find_camera_motion, mean_spread

SIZE = (640, 480)
FRAMES = [Frame("", *SIZE) for _ in range(2)]


def scene(rng, *, world=150, body=200, shift=(9.0, 3.0)):
    """A world all over the picture, with more tracks on a body that moves in front of it."""
    first = np.concatenate(
        [rng.uniform((0, 0), SIZE, (world, 2)), rng.uniform((250, 150), (380, 300), (body, 2))]
    )
    steps = np.repeat([[-6.0, 1.0], shift], [world, body], axis=0)
    points = np.stack([first, first + steps], axis=1) + rng.normal(0, 0.2, (world + body, 2, 2))
    return points, np.repeat([2, 1], [world, body])


def test_the_world_is_what_is_spread_over_the_picture_not_what_has_most_tracks(rng):
    points, labels = scene(rng)
    assert find_camera_motion(points, labels, FRAMES) == 2


def test_a_few_scattered_tracks_are_no_world(rng):
    points, labels = scene(rng)
    labels[rng.choice(np.flatnonzero(labels == 2), 15, replace=False)] = 3
    assert find_camera_motion(points, labels, FRAMES) == 2


def test_objects_beside_each_other_and_a_static_camera_have_no_camera_motion(rng):
    points, labels = scene(rng, world=0)
    assert find_camera_motion(points, labels, FRAMES) is None
    points, labels = scene(rng)
    labels[0] = BACKGROUND
    assert find_camera_motion(points, labels, FRAMES) is None


def test_spread_does_not_depend_on_the_size_of_the_picture_and_counts_every_frame(rng):
    points = np.repeat(rng.uniform((0, 0), SIZE, (4000, 1, 2)), 2, axis=1)
    assert mean_spread(points, FRAMES) == pytest.approx(1.0, abs=0.03)
    larger = [Frame("", 1280, 960) for _ in range(2)]
    assert mean_spread(2 * points, larger) == pytest.approx(mean_spread(points, FRAMES))
    points[:, 1] = np.nan
    assert mean_spread(points, FRAMES) == pytest.approx(0.5, abs=0.02)


@pytest.mark.data
def test_real_sequences_from_a_driving_car(data_folder):
    for path in sorted((data_folder / "kt3dmoseg" / "tracks").glob("*.mat")):
        found = read(str(path))
        labels = found.tracks.labels
        assert find_camera_motion(found.tracks.points, labels, found.frames) == 1, path.name


@pytest.mark.data
def test_objects_moved_by_hand_between_two_pictures(data_folder):
    for path in sorted((data_folder / "adelaidermf" / "motion").glob("*.mat")):
        found = read(str(path))
        assert find_camera_motion(found.tracks.points, found.tracks.labels, found.frames) is None


def test_run_names_it_and_an_option_does_not(rng):
    points, _ = scene(rng)
    found = mssegment.segment_tracks(points, frame_size=SIZE)
    label = found.segmentation.camera_motion
    assert label is not None
    assert (found.labels[:150] == label).mean() > 0.95
    assert any("static world" in note for note in found.segmentation.notes)
    settings = {"segment.camera_motion": False}
    without = mssegment.segment_tracks(points, settings, frame_size=SIZE)
    assert without.segmentation.camera_motion is None
    assert (without.labels == found.labels).all()


def test_the_document_keeps_it_and_refuses_a_motion_that_is_not_there(rng):
    points, _ = scene(rng)
    document = mssegment.segment_tracks(points, frame_size=SIZE).segmentation
    content = encode(document)
    again = decode(content, SegmentationDocument)
    assert again.camera_motion == document.camera_motion == again.segmentation.camera_motion
    wrong = json.loads(content) | {"camera_motion": 9}
    with pytest.raises(mssegment.DataError, match="camera_motion is 9; expected null, or 1 to 2"):
        decode(json.dumps(wrong).encode(), SegmentationDocument)


def camera_report():
    report = affine_report(truth=False)
    return replace(report, segmentation=replace(report.segmentation, camera_motion=1))


def test_tables_and_legends_know_it():
    report = camera_report()
    assert "1 · camera" in format_report(report, "text")
    rows = format_report(report, "csv").splitlines()
    assert rows[0] == "motion,inliers,hypotheses,kde,rms px,camera"
    assert rows[1].startswith("1,30,")
    assert rows[1].endswith(",yes")
    assert "·" not in format_report(report, "latex")
    assert motion_entries(report)[0][1] == "camera (motion 1): 30"
    assert report_json(report)["camera_motion"] == 1
    assert "camera (motion 1)" in render_page(report)


def test_it_has_no_badge_and_the_objects_keep_theirs():
    report = replace(camera_report(), pictures=picture)
    assert [badge.text for badge in number_badges(report, view_of(report, 0))] == ["2"]
