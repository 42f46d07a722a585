"""The third test for outliers: tracks that do not move with their group."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import perspective_tracks, rigid_bodies
from test_joinedness import cut

from mssegment.segmentation.consensus.walk_test import (
    Null,
    fit_by_chance,
    probability_of_null,
    walk_test,
)


def with_walks(seed: int, frames: int, walks: int) -> tuple[np.ndarray, np.ndarray]:
    """Tracks of a rigid body and of walks that start within it, and which of them walk."""
    rng = np.random.default_rng(seed)
    points, _ = rigid_bodies(rng, sizes=(90,), frames=frames)
    starts = points[rng.integers(90, size=walks), :1]
    steps = rng.normal(0, 4.0, (walks, frames, 2)) + np.diff(points, axis=1).mean(axis=(0, 1))
    steps[:, 0] = 0
    return np.concatenate([points, starts + steps.cumsum(axis=1)]), np.arange(90 + walks) >= 90


@pytest.mark.parametrize("frames", [6, 10, 20])
def test_walks_are_outliers_and_the_body_is_not(frames: int) -> None:
    points, walks = with_walks(frames, frames, 30)
    found = walk_test(points, np.ones(len(points), dtype=np.int64), np.random.default_rng(0))
    assert found[walks].mean() > 0.9
    assert found[~walks].mean() < 0.02


@pytest.mark.parametrize("seed", range(3))
def test_a_body_alone_keeps_its_tracks(seed: int) -> None:
    points, _ = with_walks(seed, 12, 0)
    labels = np.ones(len(points), dtype=np.int64)
    assert walk_test(points, labels, np.random.default_rng(0)).mean() < 0.02


def test_incomplete_tracks_and_small_groups_are_not_tested() -> None:
    points, walks = with_walks(1, 8, 30)
    points[walks, 0] = np.nan
    labels = np.ones(len(points), dtype=np.int64)
    assert not walk_test(points, labels, np.random.default_rng(0))[walks].any()
    assert not walk_test(points[-5:, 1:], labels[-5:], np.random.default_rng(0)).any()


@pytest.mark.parametrize("seed", range(3))
def test_incomplete_walks_are_outliers_where_they_are_asked_for(seed: int) -> None:
    points, walks = with_walks(seed, 12, 30)
    points = cut(points, np.random.default_rng(seed))
    labels = np.ones(len(points), dtype=np.int64)
    found = walk_test(points, labels, np.random.default_rng(0), incomplete=True)
    assert found[walks].mean() > 0.7
    assert found[~walks].mean() < 0.03


def test_incomplete_tracks_that_drift_smoothly_stay() -> None:
    points, _ = with_walks(4, 12, 0)
    rng = np.random.default_rng(0)
    bend = rng.normal(0, 0.1, (30, 1, 2)) * np.arange(12)[None, :, None] ** 2
    points[:30] += bend
    points = cut(points, rng)
    labels = np.ones(len(points), dtype=np.int64)
    assert walk_test(points, labels, rng, incomplete=True)[:30].mean() < 0.1


def test_rough_tracks_fit_by_chance_and_those_of_the_body_do_not() -> None:
    points, walks = with_walks(5, 12, 40)
    points = cut(points, np.random.default_rng(5))
    members = points[~walks][:60]
    chance = fit_by_chance(members, points[60:], np.random.default_rng(0))
    assert chance[walks[60:]].mean() > 0.7
    assert chance[~walks[60:]].mean() < 0.4


def test_the_unit_does_not_matter() -> None:
    points, _ = with_walks(2, 10, 30)
    labels = np.ones(len(points), dtype=np.int64)
    found = [walk_test(s * points, labels, np.random.default_rng(0)) for s in (1e-2, 1.0, 1e3)]
    assert (found[0] == found[1]).mean() > 0.98
    assert (found[2] == found[1]).mean() > 0.98


def test_walks_are_told_apart_under_perspective_too(rng: np.random.Generator) -> None:
    body = perspective_tracks(np.random.default_rng(5), tracks=80, frames=12)
    body = body + rng.normal(0, 0.3, body.shape)
    starts = body[rng.integers(80, size=40), :1]
    steps = rng.normal(0, 4.0, (40, 12, 2))
    steps[:, 0] = 0
    points = np.concatenate([body, starts + steps.cumsum(axis=1)])
    found = walk_test(points, np.ones(120, dtype=np.int64), np.random.default_rng(0))
    assert found[80:].mean() > 0.9
    assert found[:80].mean() < 0.03


def test_independent_smooth_paths_are_outliers(rng: np.random.Generator) -> None:
    body, _ = rigid_bodies(rng, sizes=(80,), frames=10)
    speed = rng.normal(0, 4.0, (25, 1, 2)) * np.arange(10)[None, :, None]
    points = np.concatenate([body, body[:25, :1] + speed + rng.normal(0, 0.3, (25, 10, 2))])
    found = walk_test(points, np.ones(105, dtype=np.int64), np.random.default_rng(0))
    assert found[80:].mean() > 0.8
    assert found[:80].mean() < 0.03


def test_the_posterior_tells_two_modes_apart(rng: np.random.Generator) -> None:
    logs = np.concatenate([rng.normal(0.0, 0.3, 80), rng.normal(3.0, 0.4, 20)])
    null = Null(np.full(100, 3.0), 0.4)
    found = probability_of_null(logs, null, 0.2) > 0.5
    assert found[80:].all()
    assert not found[:80].any()


def test_only_what_chance_does_not_explain_is_meaningful(rng: np.random.Generator) -> None:
    null = Null(rng.normal(0, 1, 1000), 0.5)
    passed = [null.meaningful(rng.normal(null.middle, 0.5)).sum() for _ in range(50)]
    # one is expected
    assert 0.5 < np.mean(passed) < 1.6
