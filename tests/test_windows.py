"""The a-contrario test and the split test of incomplete tracks, both in windows of frames."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import rigid_bodies
from test_joinedness import cut

import mssegment
from mssegment.records import Floats, Integers
from mssegment.sampling.frame_pairs import draw_for_consensus
from mssegment.sampling.windows import (
    log_false_alarms_in_windows,
    shortest_length,
    window_length,
    window_starts,
)
from mssegment.segmentation.consensus.readmission import readmitted
from mssegment.segmentation.consensus.split_test import SplitTest
from mssegment.segmentation.consensus.windowed_split import WindowedSplitTest


def with_outliers(rng: np.random.Generator) -> tuple[Floats, Integers]:
    """Two bodies and as many random walks over twelve frames, tracks cut at random."""
    points, labels = rigid_bodies(rng, sizes=(60, 50), frames=12)
    steps = rng.normal(0, 6, (100, 12, 2))
    steps[:, 0] = rng.uniform(0, 400, (100, 2))
    points = np.concatenate([points, np.cumsum(steps, axis=1)])
    return cut(points, rng), np.concatenate([labels, np.zeros(100, dtype=np.int64)])


def test_outliers_among_incomplete_tracks_are_rejected(rng: np.random.Generator) -> None:
    points, labels = with_outliers(rng)
    log_nfa = log_false_alarms_in_windows(points, np.ones(len(points), dtype=bool), rng)
    assert (log_nfa[labels > 0] < 0).mean() > 0.95
    assert (log_nfa[labels == 0] >= 0).mean() > 0.8


def test_only_eligible_tracks_are_tested(rng: np.random.Generator) -> None:
    points, labels = with_outliers(rng)
    log_nfa = log_false_alarms_in_windows(points, labels > 0, rng)
    assert np.isnan(log_nfa[labels == 0]).all()
    assert (log_nfa[labels > 0] < 0).mean() > 0.95


def test_noise_has_no_hypotheses(rng: np.random.Generator) -> None:
    points = cut(rng.uniform(0, 400, (200, 10, 2)), rng)
    assert not draw_for_consensus(points, rng).sets


@pytest.mark.parametrize("frames", [3, 4, 10, 17])
def test_every_track_that_is_not_short_fills_a_window(frames, rng: np.random.Generator) -> None:
    visible = np.isfinite(cut(np.zeros((80, frames, 2)), rng)).all(axis=2)
    length = window_length(visible)
    assert 3 <= length <= shortest_length(visible) <= frames
    starts = window_starts(frames, length)
    assert starts[0] == 0
    assert starts[-1] + length == frames
    filled = np.stack([visible[:, start : start + length].all(axis=1) for start in starts])
    assert filled.any(axis=0)[visible.sum(axis=1) >= 2 * length - 1].all()


def test_the_windowed_ratio_of_complete_tracks_is_the_ratio(rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(rng, sizes=(60, 50), frames=8)
    agreement = (labels[:, None] == labels).astype(float)
    place = points.mean(axis=1)
    distances = np.linalg.norm(place[:, None] - place, axis=-1)
    groups = [np.flatnonzero(labels == label) for label in (1, 2)]
    whole = SplitTest(points, agreement, distances, single=True).ratio(*groups)
    windowed = WindowedSplitTest(points, agreement, distances, single=True)
    assert windowed.ratio(*groups) == pytest.approx(whole, rel=1e-9)
    incomplete = cut(points, rng)
    windowed = WindowedSplitTest(incomplete, agreement, distances, single=True)
    ratio = windowed.ratio(*groups)
    assert ratio is not None
    assert ratio > 1
    left = points[groups[0], 0, 0] < np.median(points[groups[0], 0, 0])
    ratio = windowed.ratio(groups[0][left], groups[0][~left])
    assert ratio is not None
    assert ratio < 1


def test_groups_of_different_times_have_no_ratio(rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(rng, sizes=(40, 40), frames=12)
    points[labels == 1, 6:] = points[labels == 2, :6] = np.nan
    agreement, distances = np.ones((80, 80)), rng.uniform(1, 100, (80, 80))
    groups = [np.flatnonzero(labels == label) for label in (1, 2)]
    assert WindowedSplitTest(points, agreement, distances, single=True).ratio(*groups) is None


def test_a_track_is_readmitted_to_the_body_that_it_moves_with(rng: np.random.Generator) -> None:
    points, labels = with_outliers(rng)
    true = labels.copy()
    rejected = np.concatenate([np.arange(0, 110, 10), np.flatnonzero(labels == 0)])
    labels[rejected] = 0
    pairs = [(0, 2), (3, 5), (6, 8), (9, 11), (2, 6), (5, 9)]
    found = readmitted(points, labels, rejected, pairs, rng)
    assert (found == true[rejected])[:11].sum() >= 8
    assert (found[11:] > 0).mean() < 0.1
    assert not readmitted(points, np.zeros_like(labels), rejected, pairs, rng).any()


def test_rigid_evidence_tells_two_bodies_from_one(rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(rng, sizes=(60, 50), frames=12)
    points = cut(points, rng)
    distances = rng.uniform(1, 100, (110, 110))
    test = WindowedSplitTest(points, np.ones((110, 110)), distances, single=True)
    groups = [np.flatnonzero(labels == label) for label in (1, 2)]
    halves = groups[0][::2], groups[0][1::2]
    assert test.rigid_evidence(*groups) > 30
    assert test.rigid_evidence(*halves) < 3


@pytest.mark.parametrize("complete", [True, False])
def test_motions_say_how_far_they_are_from_the_nearest(complete, rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(rng, sizes=(70, 60, 50), frames=12)
    if not complete:
        points = cut(points, rng)
    settings = {"hypothesize.model": "factorization", "background.remove": False}
    found = mssegment.segment_tracks(points, settings)
    assert len(found.motions) == 3
    assert all(motion.separation is not None for motion in found.motions)
    nearest = sorted(motion.separation or 0.0 for motion in found.motions)
    assert nearest[0] > 1
    assert nearest[0] == pytest.approx(nearest[1], rel=1e-9)  # the nearest two have it in common
    alone = mssegment.segment_tracks(points[labels == 1], settings)
    assert [motion.separation for motion in alone.motions] == [None]
