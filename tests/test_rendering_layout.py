"""Legends of any length fit below their picture, and numbers lie on their objects."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from rendering_samples import affine_report, crowd

from mssegment.rendering.layout import TEXT_WIDTH, number_badges, view_of
from mssegment.rendering.pictures import frame_scene
from mssegment.rendering.scene import Badge, Label


@pytest.mark.parametrize("motions", [1, 9, 14, 50])
def test_every_entry_of_a_legend_is_readable_below_the_picture(motions):
    report = crowd(motions=motions)
    view = view_of(report, 0)
    scene = frame_scene(report, view)
    texts = [item for item in scene.items if isinstance(item, Label)]
    assert len(texts) == motions + 2
    height = view.photograph.shape[0]
    for text in texts:
        assert text.size == view.sizes.text  # never smaller than in a short legend
        assert height < text.y - 0.8 * text.size
        assert text.y <= scene.height
        assert text.x + TEXT_WIDTH * len(text.text) * text.size <= scene.width
    rows = sorted({round(text.y) for text in texts})
    assert all(b - a > view.sizes.text for a, b in pairwise(rows))


def test_numbers_lie_on_points_of_their_motions_and_not_on_each_other():
    report = crowd()
    view = view_of(report, 0)
    badges = [item for item in number_badges(report, view) if isinstance(item, Badge)]
    assert [badge.text for badge in badges] == [str(k) for k in range(1, 15)]
    points = view.to_picture(report.tracks.points[:, 0])
    places = np.array([(badge.x, badge.y) for badge in badges])
    for badge, place in zip(badges, places, strict=True):
        own = points[report.members(int(badge.text))]
        assert np.linalg.norm(own - place, axis=1).min() < 1e-6
    gaps = np.linalg.norm(places[:, None] - places[None], axis=2)
    assert gaps[~np.eye(14, dtype=bool)].min() >= 2 * badges[0].radius


def test_a_motion_seen_nowhere_has_no_number():
    report = affine_report()
    report.tracks.points[report.members(2), 0] = np.nan
    assert [badge.text for badge in number_badges(report, view_of(report, 0))] == ["1"]
