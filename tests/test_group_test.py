"""A group of tracks is a motion if it is more coherent than independent tracks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2
from scipy.stats import t as student_t

from mssegment.segmentation.consensus import group_test
from mssegment.segmentation.consensus.group_test import (
    DECIDED,
    LEVEL,
    MORE_SURROGATES,
    SURROGATES,
    by_chance,
    log_combined,
    log_false_alarms_of_group,
    log_false_alarms_of_groups,
    log_probability_below,
    turned_paths,
    turned_steps,
)
from tests.moving_bodies import rigid_bodies

LIMIT = math.log(LEVEL)


def walks(rng: np.random.Generator, tracks: int, frames: int) -> np.ndarray:
    """Independent normal steps, each track at its own pace."""
    steps = rng.normal(0, 4, (tracks, frames, 2)) * rng.uniform(0.5, 1.5, (tracks, 1, 1))
    steps[:, 0] = rng.uniform(0, 480, (tracks, 2))
    return np.cumsum(steps, axis=1)


def smooth(rng: np.random.Generator, tracks: int, frames: int) -> np.ndarray:
    """Independent velocities and accelerations."""
    time = np.arange(frames)[None, :, None]
    speed, bend = rng.normal(0, 4, (tracks, 1, 2)), rng.normal(0, 0.2, (tracks, 1, 2))
    noise = rng.normal(0, 0.3, (tracks, frames, 2))
    return rng.uniform(0, 480, (tracks, 1, 2)) + speed * time + bend * time**2 + noise


@pytest.mark.parametrize("make", [walks, smooth])
@pytest.mark.parametrize("frames", [3, 8, 20])
def test_tracks_that_move_independently_are_no_group(make, frames: int) -> None:
    values = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        values.append(log_false_alarms_of_group(make(rng, 60, frames), 8, rng))
    assert sum(value < LIMIT for value in values) <= 1


@pytest.mark.parametrize("make", [walks, smooth])
def test_probabilities_are_uniform_under_the_null_hypothesis(make) -> None:
    values = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        values.append(math.exp(log_false_alarms_of_group(make(rng, 30, 6), 1, rng)))
    # Kolmogorov's bound for 60 values at a level of 0.001
    rank = (np.arange(60) + 0.5) / 60
    assert np.abs(np.sort(values) - rank).max() < 1.95 / math.sqrt(60)


def test_what_nine_surrogates_leave_open_is_tested_with_more(monkeypatch) -> None:
    own, null = -2.2, np.resize([-1.0, 0.0, 1.0], SURROGATES + MORE_SURROGATES)
    drawn = iter([*null[:SURROGATES], own, *null[SURROGATES:]])
    monkeypatch.setattr(group_test, "coherence", lambda *_: next(drawn))
    points = walks(np.random.default_rng(0), 30, 6)
    found = log_false_alarms_of_group(points, 1, np.random.default_rng(0))
    assert found == pytest.approx(log_probability_below(own, null))
    assert DECIDED[0] < log_probability_below(own, null[:SURROGATES]) < DECIDED[1]


@pytest.mark.parametrize("frames", [3, 8, 20])
def test_one_rigid_motion_is_a_group(frames: int) -> None:
    points, labels = rigid_bodies(np.random.default_rng(3), frames=frames)
    for label in np.unique(labels):
        own = points[labels == label]
        assert log_false_alarms_of_group(own, 8, np.random.default_rng(0)) < LIMIT


def test_what_stands_still_is_a_group(rng: np.random.Generator) -> None:
    points = rng.uniform(0, 480, (40, 1, 2)) + rng.normal(0, 0.3, (40, 10, 2))
    assert log_false_alarms_of_group(points, 8, rng) < LIMIT


def test_a_common_translation_is_a_group(rng: np.random.Generator) -> None:
    start, path = rng.uniform(0, 480, (60, 1, 2)), rng.normal(0, 3, (1, 6, 2)).cumsum(axis=1)
    points = start + path + rng.normal(0, 0.3, (60, 6, 2))
    assert log_false_alarms_of_group(points, 8, rng) < LIMIT


def test_incomplete_tracks_are_tested_in_windows(rng: np.random.Generator) -> None:
    bodies, _ = rigid_bodies(rng, sizes=(60,), frames=24)
    points = np.concatenate([bodies, walks(rng, 60, 24)])
    for track in range(len(points)):
        start = int(rng.integers(17))
        points[track, :start] = points[track, start + 8 :] = np.nan
    labels = np.repeat([1, 2], 60)
    found = log_false_alarms_of_groups(points, labels, 8, rng)
    assert found[0] < LIMIT <= found[1]
    few = np.where(np.arange(120) % 60 < 10, labels, 0)
    assert np.isnan(log_false_alarms_of_groups(points, few, 8, rng)).all()


def test_a_group_that_goes_on_is_not_tested(rng: np.random.Generator) -> None:
    points, labels = walks(rng, 60, 8), np.repeat([1, 2], 30)
    moved_before = np.arange(60) < 6
    found = log_false_alarms_of_groups(points, labels, 8, rng, moved_before)
    assert np.isnan(found[0])
    assert found[1] >= LIMIT
    moved_before[0] = False
    assert np.isfinite(log_false_alarms_of_groups(points, labels, 8, rng, moved_before)).all()


@pytest.mark.parametrize("turned", [turned_paths, turned_steps])
def test_surrogates_start_and_move_as_the_tracks_do(turned, rng: np.random.Generator) -> None:
    points = walks(rng, 20, 6)
    found = turned(points, rng)
    np.testing.assert_allclose(found[:, 0], points[:, 0])
    lengths = [np.linalg.norm(np.diff(tracks, axis=1), axis=2) for tracks in (found, points)]
    np.testing.assert_allclose(*lengths)
    assert np.abs(found - points).max() > 1


@pytest.mark.parametrize("value", [-400.0, -30.0, -2.0, 0.0, 1.5, 20.0])
def test_the_tail_is_that_of_the_student_t_distribution(
    value: float, rng: np.random.Generator
) -> None:
    null = rng.normal(0, 2, SURROGATES)
    t = (value - null.mean()) / (null.std(ddof=1) * math.sqrt(1 + 1 / SURROGATES))
    expected = student_t.logcdf(t, SURROGATES - 1)
    assert log_probability_below(value, null) == pytest.approx(expected, rel=1e-6)


def test_a_single_group_is_a_motion_at_the_level() -> None:
    assert by_chance(np.array([math.log(8 * 1.1 * LEVEL)]), 8).all()
    assert not by_chance(np.array([math.log(8 * 0.9 * LEVEL)]), 8).any()


def test_where_there_is_motion_a_group_needs_less() -> None:
    found = by_chance(np.array([-12.0, -0.5, 0.5, np.nan]), 8)
    assert found.tolist() == [False, False, True, False]
    assert by_chance(np.array([-0.5, 0.5, np.nan]), 8).tolist() == [True, True, False]
    assert not by_chance(np.array([np.nan]), 8).any()


def test_several_groups_are_evidence_together() -> None:
    assert by_chance(np.array([-2.0]), 8).all()
    assert not by_chance(np.array([-2.0, -2.0]), 8).any()


def test_a_group_that_stands_still_but_drifts_a_little_is_a_motion() -> None:
    rng = np.random.default_rng(2)
    places = rng.uniform(0, [640, 480], (80, 1, 2))
    drift = rng.normal(0, 0.02, (80, 1, 2)) * np.arange(12)[None, :, None]
    points = places + drift + rng.normal(0, 0.01, (80, 12, 2))
    assert log_false_alarms_of_group(points, 8, rng) < LIMIT


@pytest.mark.parametrize("logs", [[-3.0], [-1.0, -0.2, -4.0], [-300.0, -2.0], [0.0, 0.0]])
def test_probabilities_are_combined_as_by_fisher(logs: list[float]) -> None:
    expected = chi2.logsf(-2 * sum(logs), 2 * len(logs))
    assert log_combined(np.array(logs)) == pytest.approx(expected, abs=1e-6)


def test_a_group_with_too_few_complete_tracks_is_not_tested(rng: np.random.Generator) -> None:
    points, _ = rigid_bodies(rng, sizes=(6,), frames=8)
    points[:2, 0] = np.nan
    assert np.isnan(log_false_alarms_of_groups(points, np.ones(6, dtype=np.int64), 8, rng)).all()
