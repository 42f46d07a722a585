"""The third test for outliers: random walks among the tracks of a group."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import rigid_bodies

from mssegment.segmentation.consensus.walk_test import probability_of_null, walk_test


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


def test_the_unit_does_not_matter() -> None:
    points, _ = with_walks(2, 10, 30)
    labels = np.ones(len(points), dtype=np.int64)
    found = [walk_test(s * points, labels, np.random.default_rng(0)) for s in (1e-2, 1.0, 1e3)]
    assert (found[0] == found[1]).mean() > 0.98
    assert (found[2] == found[1]).mean() > 0.98


def test_the_posterior_tells_two_modes_apart(rng: np.random.Generator) -> None:
    null = np.exp(rng.normal(3.0, 0.4, 400))
    values = np.exp(np.concatenate([rng.normal(0.0, 0.3, 80), rng.normal(3.0, 0.4, 20)]))
    found = probability_of_null(values, null, 0.2) > 0.5
    assert found[80:].all()
    assert not found[:80].any()
