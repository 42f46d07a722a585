"""A group of tracks is a motion if it is more coherent than independent tracks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import t as student_t

from mssegment.segmentation.consensus.group_test import (
    MAX_FALSE_ALARMS,
    SURROGATES,
    log_false_alarms_of_group,
    log_false_alarms_of_groups,
    log_probability_below,
    turned_paths,
    turned_steps,
)
from tests.moving_bodies import rigid_bodies

LIMIT = math.log(MAX_FALSE_ALARMS)


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
