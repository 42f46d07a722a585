"""The a-contrario tests of tracks: noise of several kinds passes none, motion passes all."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import rigid_bodies

from mssegment.sampling.chimeras import (
    draw_chimeras,
    draw_walks,
    log_false_alarms,
    log_tail,
)


def uniform(rng: np.random.Generator, tracks: int, frames: int) -> np.ndarray:
    return rng.uniform(0, 480, (tracks, frames, 2))


def walks(rng: np.random.Generator, tracks: int, frames: int) -> np.ndarray:
    steps = rng.normal(0, 4, (tracks, frames, 2))
    steps[:, 0] = rng.uniform(0, 480, (tracks, 2))
    return np.cumsum(steps, axis=1)


@pytest.mark.parametrize("frames", [3, 6, 20])
def test_uniform_noise_is_not_meaningful(rng: np.random.Generator, frames: int) -> None:
    passed = [(log_false_alarms(uniform(rng, 150, frames), rng) < 0).sum() for _ in range(12)]
    # the expected number is at most one
    assert np.mean(passed) < 2
    assert max(passed) < 10


@pytest.mark.parametrize("frames", [3, 6, 20])
def test_rigid_motion_is_meaningful_among_as_much_noise(frames: int) -> None:
    points, _ = rigid_bodies(np.random.default_rng(1), frames=frames)
    rng = np.random.default_rng(2)
    log_nfa = log_false_alarms(np.concatenate([points, uniform(rng, len(points), frames)]), rng)
    assert (log_nfa[: len(points)] < 0).mean() > 0.97
    assert (log_nfa[len(points) :] < 0).mean() < 0.03


def test_what_moves_smoothly_with_an_object_is_no_outlier(rng: np.random.Generator) -> None:
    points, _ = rigid_bodies(np.random.default_rng(3), sizes=(80,), frames=30)
    phases = rng.uniform(0, 2 * np.pi, (12, 2))
    waves = np.sin(np.linspace(0, np.pi, 30)[:, None] + phases[:, None])
    smooth, white = points[:12] + 2.0 * waves, points[:12] + rng.normal(0, 8.0, (12, 30, 2))
    log_nfa = log_false_alarms(np.concatenate([points[12:], smooth, white]), rng)
    assert (log_nfa[:80] < 0).mean() > 0.95
    assert (log_nfa[80:] >= 0).mean() > 0.8


def test_the_test_does_not_depend_on_units_or_origin(rng: np.random.Generator) -> None:
    points, _ = rigid_bodies(rng, frames=8)
    points = np.concatenate([points, uniform(rng, 40, 8)])
    one, other = (
        log_false_alarms(moved, np.random.default_rng(0))
        for moved in (points, 1000.0 * points + 3000.0)
    )
    np.testing.assert_array_equal(one < 0, other < 0)


def test_samples_of_the_null_hypotheses_are_made_of_the_tracks(rng: np.random.Generator) -> None:
    points = uniform(rng, 20, 5)
    for track in draw_chimeras(points, 30, rng):
        for frame in range(5):
            assert (points[:, frame] == track[frame]).all(axis=1).any()
    steps = np.abs(np.diff(points, axis=1))
    for track in draw_walks(points, 30, rng):
        assert (points[:, 0] == track[0]).all(axis=1).any()
        for frame, step in enumerate(np.abs(np.diff(track, axis=0))):
            assert np.isclose(steps[:, frame], step).all(axis=1).any()


def test_few_tracks_are_not_meaningful(rng: np.random.Generator) -> None:
    for tracks in range(5):
        assert np.isinf(log_false_alarms(uniform(rng, tracks, 6), rng)).all()


def test_the_tail_is_monotonic_and_continuous(rng: np.random.Generator) -> None:
    null = rng.gamma(4.0, size=400)
    values = np.linspace(1e-6, 2 * null.max(), 3000)
    logs = log_tail(values, null)
    assert (np.diff(logs) >= 0).all()
    assert logs[-1] == 0.0
    q = np.quantile(null, 0.1)
    around = log_tail(np.array([q * (1 - 1e-9), q * (1 + 1e-9)]), null)
    assert abs(around[1] - around[0]) < 0.02
