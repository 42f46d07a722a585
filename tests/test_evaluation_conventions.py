"""Evaluation as the field does it: label 0 is the static world, IoU, adjusted Rand, J and F."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendering_samples import affine_report

from mssegment.cli import invoke
from mssegment.evaluation import adjusted_rand, evaluate, find_world, is_correct, is_counted
from mssegment.ground_truth import read_truth
from mssegment.masks.quality import contour_accuracy, mask_quality, region_similarity
from mssegment.records import BACKGROUND, IGNORED, Frame, Tracks, replace
from mssegment.rendering.report import build_report
from mssegment.rendering.report_json import report_json
from mssegment.rendering.tables import format_report, summary

labellings = st.lists(
    st.tuples(st.integers(-2, 3), st.sampled_from([IGNORED, 0, 1, 2])), min_size=1
)
DAVIS = (np.repeat([1, 2, 0], [80, 15, 5]), np.repeat([0, 1, 0], [80, 15, 5]))
"""A right result under a moving camera, and the labels of a DAVIS mask."""


def test_a_right_result_on_a_davis_mask_has_no_errors():
    found, truth = DAVIS
    world = find_world(found, truth, camera_motion=1)
    assert world == 1
    evaluation = evaluate(found, truth, world)
    assert evaluation.misclassification == 0.0
    assert evaluation.counted == 100
    assert evaluation.matching == {2: 1}
    assert evaluation.iou == {1: 1.0}
    assert evaluation.found_motions == (2, 1)
    assert evaluation.confusion.tolist() == [[15, 0, 0], [0, 80, 5]]
    assert evaluate(found, truth).misclassification > 0.7


def test_what_zero_is():
    found, truth = DAVIS
    assert find_world(found, truth, camera_motion=1, rule="none") is None
    assert find_world(found, truth, camera_motion=None) is None
    assert find_world(found, truth, camera_motion=None, rule="motion") == 1
    static = np.where(found == 1, BACKGROUND, found)
    assert find_world(static, truth) == BACKGROUND
    assert evaluate(static, truth, BACKGROUND).misclassification == 0.0
    # outliers that are found to be outliers stay what they are
    outliers = np.where(truth == 0, 0, found)
    assert find_world(outliers, truth, camera_motion=1) is None
    assert find_world(found, np.ones(100, dtype=np.int64), camera_motion=1) is None


@settings(deadline=None)  # the first example imports scipy.optimize
@given(labellings, st.sampled_from([None, BACKGROUND, 1]))
def test_every_counted_track_is_in_the_confusion_matrix_and_right_or_wrong(pairs, world):
    found, truth = np.array(pairs).T
    evaluation = evaluate(found, truth, world)
    counted = is_counted(found, truth, world)
    right = is_correct(found, truth, evaluation.matching, world) & counted
    assert evaluation.confusion.sum() == evaluation.counted == counted.sum()
    if counted.any():
        assert evaluation.misclassification == pytest.approx(1 - right.sum() / counted.sum())
    assert all(0 <= value <= 1 for value in evaluation.iou.values())
    assert world not in evaluation.matching


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3)), max_size=30))
def test_adjusted_rand_index_is_that_of_scikit_learn(pairs):
    metrics = pytest.importorskip("sklearn.metrics")
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    expected = metrics.adjusted_rand_score(first, second)
    assert adjusted_rand(first, second) == pytest.approx(expected)
    assert adjusted_rand(first, second) == pytest.approx(adjusted_rand(second, first))


def camera_report(truth, rule="auto"):
    report = affine_report(truth=False)
    segmentation = replace(report.segmentation, camera_motion=1)
    truth = np.where(report.labels == 1, 0, np.where(report.labels == 2, 1, 0)) if truth else None
    return build_report(
        frames=report.frames,
        tracks=report.tracks,
        sets=report.sets,
        segmentation=segmentation,
        truth=truth,
        background_label=rule,
    )


def test_report_says_what_zero_was_taken_for():
    report = camera_report(truth=True)
    text = format_report(report, "text")
    assert "label 0 is the static world: the camera's motion (1) is right there" in text
    assert "background 0" in text
    assert "IoU of tracks" in text
    assert "0.00 %" in summary(report)
    found = report_json(report)
    assert found["world"] == 1
    assert found["objects"] == [{"true": 1, "motion": 2, "iou": 1.0, "J": None, "F": None}]
    assert found["adjusted_rand"] == pytest.approx(1.0)
    other = camera_report(truth=True, rule="none")
    assert "most of its tracks are in motion 1; if 0 is the static world" in format_report(other)


def test_labelled_points_without_a_track_are_said(tmp_path):
    points = np.array([[[10.0, 10.0], [12.0, 10.0]], [[40.0, 10.0], [41.0, 12.0]]])
    table = tmp_path / "labels.csv"
    table.write_text("x,y,label\n10,11,1\n40,10,2\n90,90,1\n")
    frames = [Frame("1.png", 100, 100), Frame("2.png", 100, 100)]
    truth = read_truth([str(table)], Tracks(points), frames, 3.0)
    assert truth.note == "2 of 3 labelled points lie within 3 px of a track"
    mask = tmp_path / "mask-1.png"
    cv2.imwrite(
        str(mask), np.pad(np.ones((20, 20), np.uint8), ((0, 80), (0, 80)), constant_values=255)
    )
    truth = read_truth([str(mask)], Tracks(points), frames, 3.0)
    assert truth.note == "1 of 2 tracks have a label in the 1 mask"
    assert list(truth.masks) == [0]


def disc(x, radius=20):
    rows, columns = np.mgrid[:100, :140]
    return (columns - x) ** 2 + (rows - 50) ** 2 <= radius**2


def test_region_and_contour_of_equal_masks_are_one_and_of_distant_masks_zero():
    assert region_similarity(disc(40), disc(40)) == contour_accuracy(disc(40), disc(40)) == 1.0
    assert region_similarity(disc(40), disc(100)) == 0.0
    assert contour_accuracy(disc(40), disc(100)) == 0.0
    empty = np.zeros((100, 140), dtype=bool)
    assert region_similarity(empty, empty) == contour_accuracy(empty, empty) == 1.0
    assert contour_accuracy(disc(40), empty) == 0.0


def test_contour_tolerates_what_davis_tolerates():
    # 0.8 % of the diagonal of 172 pixels, rounded up, is 2
    assert contour_accuracy(disc(40), disc(42)) == 1.0
    assert contour_accuracy(disc(40), disc(50)) < 0.6
    assert contour_accuracy(disc(40), disc(45)) == pytest.approx(
        contour_accuracy(disc(45), disc(40))
    )


def test_masks_are_matched_whatever_their_numbers_and_unjudged_pixels_do_not_count():
    truth = np.where(disc(40), 1, np.where(disc(100), 2, 0))
    found = np.where(disc(40), 5, np.where(disc(100), 3, 0)).astype(np.uint8)
    quality = mask_quality({0: found}, {0: truth})
    assert [(one.true, one.motion, one.region, one.contour) for one in quality] == [
        (1, 5, 1.0, 1.0),
        (2, 3, 1.0, 1.0),
    ]
    spoilt = found.copy()
    spoilt[:20] = 5
    hidden = truth.copy()
    hidden[:20] = 255
    assert mask_quality({0: spoilt}, {0: hidden})[0].region == 1.0
    only = mask_quality({0: np.where(disc(40), 5, 0).astype(np.uint8)}, {0: truth})
    assert (only[1].motion, only[1].region) == (None, 0.0)


def test_run_with_masks_reports_j_and_f(tmp_path, capsys):
    from test_masks import translated_square

    pictures, *_, truth = translated_square(np.random.default_rng(3))
    names = []
    for index, picture in enumerate(pictures):
        names.append(str(tmp_path / f"{index}.png"))
        cv2.imwrite(names[-1], picture)
    mask = str(tmp_path / "mask-0.png")
    cv2.imwrite(mask, truth.astype(np.uint8))
    out = str(tmp_path / "out")
    command = ["run", *names, "--labels", mask, "--masks", "--out", out, "--format", "text", "-q"]
    assert invoke(command) == 0
    header, row = capsys.readouterr().out.split("\n\n")[3].splitlines()[:2]
    assert header.split() == ["motion", "IoU", "of", "tracks", "J", "F"]
    assert float(row.split()[-2]) > 0.9
