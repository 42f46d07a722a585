"""Dense tracks: memory is bounded, and tracks that were not grouped are labelled."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import rigid_bodies

import mssegment
from mssegment.evaluation import misclassification
from mssegment.records import NOT_JUDGED
from mssegment.sampling.frame_pairs import draw_for_consensus
from mssegment.segmentation.consensus.label_propagation import (
    MAX_GROUPED_TRACKS,
    hypotheses_among,
    tracks_to_group,
)


@pytest.fixture(scope="module")
def dense() -> tuple[np.ndarray, np.ndarray]:
    """More tracks than are grouped, in 20 frames; every tenth of 3000 is an outlier."""
    rng = np.random.default_rng(5)
    points, labels = rigid_bodies(rng, sizes=(1300, 1000, 700), frames=20)
    outliers = np.arange(0, 3000, 10)
    points[outliers] += rng.normal(0, 12, (300, 20, 2))
    labels[outliers] = 0
    return points, labels


def test_every_dense_track_is_labelled(dense: tuple[np.ndarray, np.ndarray]) -> None:
    points, labels = dense
    found = mssegment.segment_tracks(points)
    assert len(found.motions) == 3
    assert misclassification(found.labels, labels) < 0.02


def test_incomplete_tracks_are_labelled_too(
    dense: tuple[np.ndarray, np.ndarray],
) -> None:
    points, labels = dense[0].copy(), dense[1]
    rng = np.random.default_rng(3)
    for track in points:
        start = rng.integers(0, 8)
        track[:start] = track[start + rng.integers(8, 20) :] = np.nan
    found = mssegment.segment_tracks(points, {"segment.motions": 3}).labels
    judged = (found != NOT_JUDGED) & (labels > 0)
    assert judged.sum() > 0.95 * (labels > 0).sum()
    assert misclassification(found[judged], labels[judged]) < 0.02


def test_only_sampled_tracks_are_grouped(
    dense: tuple[np.ndarray, np.ndarray],
) -> None:
    points, _ = dense
    sets = draw_for_consensus(points, np.random.default_rng(0)).sets
    everyone = np.ones(len(points), dtype=bool)
    grouped = tracks_to_group(everyone, sets)
    assert 0.8 * MAX_GROUPED_TRACKS < grouped.sum() <= MAX_GROUPED_TRACKS
    few = everyone & (np.arange(len(points)) < 100)
    np.testing.assert_array_equal(tracks_to_group(few, sets), few)


def test_hypotheses_among_some_tracks_index_these_only(
    dense: tuple[np.ndarray, np.ndarray],
) -> None:
    drawn = draw_for_consensus(dense[0], np.random.default_rng(0))
    chosen = np.arange(len(dense[0])) % 2 == 0
    kept = hypotheses_among(drawn, chosen)
    for before, after in zip(drawn.sets, kept.sets, strict=True):
        own = chosen[before.subsets].all(axis=1)
        np.testing.assert_array_equal(np.flatnonzero(chosen)[after.subsets], before.subsets[own])
        np.testing.assert_array_equal(after.points, before.points[own])


@pytest.mark.parametrize("seed", [0, 1])
def test_dense_matches_of_two_views(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = [rng.normal(c, 60.0, (n, 2)) for c, n in (((200, 200), 8000), ((500, 300), 4000))]
    moved = [places[0] + (6, 2), (places[1] - 400) * 1.05 + (390, 405)]
    points = np.concatenate([np.stack(pair, axis=1) for pair in zip(places, moved, strict=True)])
    points = np.concatenate([points, rng.uniform(0, 600, (4000, 2, 2))])
    points += rng.normal(0, 0.3, points.shape)
    found = mssegment.segment_tracks(points, {"seed": seed}, frame_size=(640, 640))
    assert len(found.motions) == 2
    assert misclassification(found.labels, np.repeat([1, 2, 0], [8000, 4000, 4000])) < 0.01
