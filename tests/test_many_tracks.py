"""Dense tracks: memory is bounded, and what had no part in finding the motions has its label."""

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
def crowd() -> tuple[np.ndarray, np.ndarray]:
    """More tracks than are grouped, in 20 frames; every tenth of 3000 goes its own way."""
    rng = np.random.default_rng(5)
    points, labels = rigid_bodies(rng, sizes=(1300, 1000, 700), frames=20)
    strays = np.arange(0, 3000, 10)
    points[strays] += rng.normal(0, 12, (300, 20, 2))
    labels[strays] = 0
    return points, labels


def test_every_track_of_a_crowd_gets_its_label(crowd: tuple[np.ndarray, np.ndarray]) -> None:
    points, labels = crowd
    found = mssegment.segment_tracks(points)
    assert len(found.motions) == 3
    assert misclassification(found.labels, labels) < 0.02


def test_tracks_that_begin_and_end_anywhere_join_too(
    crowd: tuple[np.ndarray, np.ndarray],
) -> None:
    points, labels = crowd[0].copy(), crowd[1]
    rng = np.random.default_rng(3)
    for track in points:
        start = rng.integers(0, 8)
        track[:start] = track[start + rng.integers(8, 20) :] = np.nan
    found = mssegment.segment_tracks(points, {"segment.motions": 3}).labels
    judged = (found != NOT_JUDGED) & (labels > 0)
    assert judged.sum() > 0.95 * (labels > 0).sum()
    assert misclassification(found[judged], labels[judged]) < 0.02


def test_a_crowd_is_grouped_by_those_that_made_hypotheses(
    crowd: tuple[np.ndarray, np.ndarray],
) -> None:
    points, _ = crowd
    sets = draw_for_consensus(points, np.random.default_rng(0)).sets
    everyone = np.ones(len(points), dtype=bool)
    grouped = tracks_to_group(everyone, sets)
    assert 0.9 * MAX_GROUPED_TRACKS < grouped.sum() <= MAX_GROUPED_TRACKS
    few = everyone & (np.arange(len(points)) < 100)
    np.testing.assert_array_equal(tracks_to_group(few, sets), few)


def test_hypotheses_among_some_tracks_count_these_only(
    crowd: tuple[np.ndarray, np.ndarray],
) -> None:
    drawn = draw_for_consensus(crowd[0], np.random.default_rng(0))
    chosen = np.arange(len(crowd[0])) % 2 == 0
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
