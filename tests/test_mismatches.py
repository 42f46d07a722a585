"""Mismatches are no motions, however near to one another they are."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment.records import Floats


def bodies(rng: np.random.Generator, wrong: int, reach: float) -> Floats:
    """Two bodies of 60 and 40 matches, and mismatches that end near to where they began."""
    first = np.concatenate(
        [
            rng.uniform((100, 100), (240, 240), (60, 2)),
            rng.uniform((380, 240), (500, 360), (40, 2)),
            rng.uniform(0, (640, 480), (wrong, 2)),
        ]
    )
    second = first.copy()
    second[:60] += [60.0, 12.0]
    second[60:100] += [-35.0, -20.0]
    second += rng.normal(0, 0.4, second.shape)
    second[100:] = first[100:] + rng.uniform(-reach, reach, (wrong, 2))
    return np.stack([first, second], axis=1)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("wrong", "reach"), [(20, 30.0), (80, 40.0)])
def test_mismatches_within_reach_of_a_tracker_are_outliers(
    seed: int, wrong: int, reach: float
) -> None:
    points = bodies(np.random.default_rng(seed), wrong, reach)
    found = mssegment.segment_tracks(points, {"seed": seed}, frame_size=(640, 480))
    assert len(found.motions) == 2
    assert (found.labels[:100] > 0).mean() > 0.97
    assert (found.labels[100:] <= 0).mean() > 0.85


@pytest.mark.parametrize("seed", range(3))
def test_no_label_at_many_times_the_residual_of_the_others(seed: int) -> None:
    points = bodies(np.random.default_rng(seed), 0, 0.0)
    points[5, 1] += [28.0, -16.0]
    points[70, 1] += [0.0, 30.0]
    found = mssegment.segment_tracks(points, {"seed": seed}, frame_size=(640, 480))
    assert found.labels[[5, 70]].tolist() == [0, 0]
    assert (found.labels > 0).sum() == 98


@pytest.mark.parametrize("seed", range(4))
def test_bodies_of_few_matches_save_only_together(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = [(60, 60), (420, 80), (240, 340)]
    shifts = [(25, 5), (-18, 14), (4, -22)]
    parts = []
    for corner, shift in zip(corners, shifts, strict=True):
        first = np.array(corner) + rng.uniform(0, 90, (12, 2))
        second = first + shift + rng.normal(0, 0.2, first.shape)
        parts.append(np.stack([first, second], axis=1))
    found = mssegment.segment_tracks(
        np.concatenate(parts), {"seed": seed, "background.remove": False}, frame_size=(640, 480)
    )
    assert len(found.motions) == 3
    assert (found.labels > 0).all()


def test_where_there_is_too_little_a_note_says_how_much_a_motion_needs() -> None:
    rng = np.random.default_rng(0)
    points = np.repeat(rng.uniform(0, 400, (15, 1, 2)), 2, axis=1)
    points[:, 1] += np.repeat([[30.0, 5.0], [-25.0, 14.0], [3.0, -28.0]], 5, axis=0)
    points[:, 0] += np.repeat([[0.0, 0.0], [600.0, 0.0], [0.0, 500.0]], 5, axis=0)
    points[:, 1] += np.repeat([[0.0, 0.0], [600.0, 0.0], [0.0, 500.0]], 5, axis=0)
    found = mssegment.segment_tracks(points, {"background.remove": False}, frame_size=(640, 480))
    assert not found.motions
    assert any("at least 6 that agree" in note for note in found.segmentation.notes)
