"""Several segmentations side by side."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest
from rendering_samples import affine_report

from mssegment.errors import UsageError
from mssegment.records import replace
from mssegment.rendering import style
from mssegment.rendering.compare import (
    comparison_json,
    comparison_picture,
    comparison_table,
    format_comparison,
)
from mssegment.rendering.tables import FORMATS


@pytest.fixture
def swapped():
    """The same segmentation with motions 1 and 2 exchanged, and three tracks wrong."""
    report = affine_report()
    labels = report.labels.copy()
    labels[report.labels == 1], labels[report.labels == 2] = 2, 1
    labels[:3] = 0
    motions = tuple(replace(m, label=3 - m.label) for m in report.segmentation.motions)
    modes = tuple(
        replace(m, motion=3 - m.motion if m.motion else 0) for m in report.segmentation.modes
    )
    changed = replace(report.segmentation, labels=labels, motions=motions, modes=modes)
    return replace(report, segmentation=changed)


def test_the_numbering_does_not_matter(swapped):
    report = affine_report()
    found = comparison_json(["a", "b"], [report, swapped])
    assert found[0]["differs_from_first"] == 0
    assert found[1]["differs_from_first"] == pytest.approx(3 / 60)


def test_other_tracks_have_no_difference():
    table = comparison_table(["a", "b"], [affine_report(), affine_report(tracks=30)])
    assert table.rows[1][-1] == "-"


@pytest.mark.parametrize("form", FORMATS)
def test_formats(form, swapped):
    text = format_comparison(["a", "b"], [affine_report(), swapped], form)
    assert "affine" in text
    if form == "json":
        assert json.loads(text)[0]["motions"] == 2


def test_wrong_format_is_named():
    with pytest.raises(UsageError, match="yaml"):
        format_comparison(["a"], [affine_report()], "yaml")


def test_the_picture_colours_the_same_object_the_same(swapped):
    report = affine_report()
    content = comparison_picture(["first.json", "second.json"], [report, swapped])
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    half = picture.shape[1] // 2
    colour = np.array(style.label_style(1).colour)
    hits = (np.abs(picture.astype(int) - colour) < 30).all(axis=2)
    # the first body is on the left side of each of the two pictures
    for side in (hits[:, :half], hits[:, half:]):
        left, right = side[60:-60, : half // 2].sum(), side[60:-60, half // 2 :].sum()
        assert left > 5 * right


@pytest.mark.parametrize(("count", "columns"), [(3, 3), (4, 2), (5, 3)])
def test_many_go_into_rows(count, columns):
    content = comparison_picture(list("abcdef")[:count], [affine_report()] * count)
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    one = cv2.imdecode(
        np.frombuffer(comparison_picture(["a"], [affine_report()]), np.uint8), cv2.IMREAD_COLOR
    )
    rows = -(-count // columns)
    assert rows * one.shape[0] <= picture.shape[0] < (rows + 0.1) * one.shape[0]
    assert columns * one.shape[1] < picture.shape[1] < (columns + 0.1) * one.shape[1]
