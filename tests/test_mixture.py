"""Long sequences by mean shift: modes start groups, and a likelihood refines them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moving_bodies import rigid_bodies

from mssegment.evaluation import misclassification
from mssegment.records import OUTLIER, Hypotheses
from mssegment.sampling.observed import ObservedSet
from mssegment.sampling.options import SamplingOptions
from mssegment.sampling.ranks import draw_all_ranks
from mssegment.segmentation.mixture.likelihood import Likelihood, membership
from mssegment.segmentation.mixture.mode_votes import ModeVotes
from mssegment.segmentation.mixture.search import partitions
from mssegment.segmentation.options import SegmentOptions
from mssegment.segmentation.selection import SelectionProblem
from tests.stages import cluster


def sets_of(points: np.ndarray, rng: np.random.Generator, rank: int | str = "auto"):
    return draw_all_ranks(
        points,
        model="factorization",
        options=SamplingOptions(count=120, rank=rank),
        eligible=np.ones(len(points), dtype=bool),
        rng=rng,
    )


def mixture_of(sets) -> Hypotheses:
    return Hypotheses("mixture", tuple(sets))


@pytest.fixture(scope="module")
def found():
    points, labels = rigid_bodies(np.random.default_rng(5))
    rng = np.random.default_rng(0)
    sets = sets_of(points, rng)
    return labels, sets, cluster(points, mixture_of(sets), motions=3, rng=rng)


def test_both_ranks_are_pooled(found) -> None:
    _, sets, _ = found
    assert [entry.points.shape[-1] for entry in sets] == [3, 4]


def test_motions_are_found(found) -> None:
    labels, _, segmentation = found
    assert misclassification(segmentation.labels, labels) <= 0.02
    assert len(segmentation.motions) == 3


def test_each_motion_has_its_own_mode(found) -> None:
    _, _, segmentation = found
    named = [(mode.set_index, mode.motion) for mode in segmentation.modes if mode.motion]
    assert len(named) == len(set(named))
    for motion in segmentation.motions:
        assert motion.rms < 1.0
        assert (segmentation.labels[motion.inliers] == motion.label).all()


def test_an_irregular_track_is_an_outlier() -> None:
    points, _ = rigid_bodies(np.random.default_rng(6), sizes=(90, 60))
    points[3] += np.random.default_rng(0).normal(0, 30, points[3].shape)
    rng = np.random.default_rng(0)
    segmentation = cluster(points, mixture_of(sets_of(points, rng, 4)), motions=2, rng=rng)
    assert segmentation.labels[3] == OUTLIER


def test_refinement_corrects_swapped_labels(rng: np.random.Generator) -> None:
    truth = np.repeat([0, 1], 60)
    components = rng.normal(size=(120, 12)) + 15 * truth[:, None]
    wrong = truth.copy()
    wrong[:9], wrong[60:69] = 1, 0
    found = Likelihood(components, np.ones((120, 1))).refine(wrong, weight=1.0)
    np.testing.assert_array_equal(found, truth)


def test_the_cost_of_a_track_is_given_the_others(rng: np.random.Generator) -> None:
    """q and |S| are those of the distribution fitted without the track."""
    components = rng.normal(size=(40, 3)) * (9, 5, 3)
    everyone = np.ones((1, 40))
    with_itself = Likelihood(components, np.ones((40, 1))).track_costs(everyone)[0]
    for track in (0, 7, 23):
        others = everyone.copy()
        others[0, track] = 0
        without = Likelihood(components, np.ones((40, 1))).track_costs(others)[0]
        assert with_itself[track] == pytest.approx(without[track], abs=0.15)


def test_labels_are_predicted_by_tracks_of_the_same_modes() -> None:
    votes = np.repeat(np.eye(2), [3, 5], axis=0)
    members = np.array([[1, 1, 0, 0, 0, 0, 0, 0], [0, 0, 1, 1, 1, 1, 1, 1]], dtype=float)
    costs = Likelihood(np.zeros((8, 2)), votes).label_costs(members)
    # one of the two others in the mode of the first track has its label
    assert np.exp(-costs[0, 0]) == pytest.approx(0.98 * 0.5 + 0.02 * 2 / 8)
    # both others of the third track have another one
    assert np.exp(-costs[0, 2]) == pytest.approx(0.98 + 0.02 * 2 / 8)
    assert np.exp(-costs[:, 4]).sum() == pytest.approx(1)


def test_a_mode_of_one_track_predicts_nothing() -> None:
    costs = Likelihood(np.zeros((4, 2)), np.eye(4)).label_costs(membership(np.array([0, 0, 0, 1])))
    np.testing.assert_allclose(np.exp(-costs), np.repeat([[0.75], [0.25]], 4, axis=1))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6))
def test_costs_do_not_depend_on_the_order_of_tracks_or_the_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    components, labels = rng.normal(size=(50, 4)) * 20, rng.integers(0, 3, 50)
    labels[:3] = 0, 1, 2
    votes = rng.dirichlet(np.ones(5), 50)
    cost = Likelihood(components, votes).cost(labels, 3.0)
    order, turn = rng.permutation(50), np.linalg.qr(rng.normal(size=(4, 4)))[0]
    moved = (components[order] + 7) @ turn
    assert Likelihood(moved, votes[order]).cost(labels[order], 3.0) == pytest.approx(cost)
    assert Likelihood(components, votes).cost((labels + 1) % 3, 3.0) == pytest.approx(cost)


def test_a_common_mode_keeps_the_parts_of_an_object_together(rng: np.random.Generator) -> None:
    """Two distant halves of one background, and two small objects near each other."""
    place = np.concatenate(
        [rng.normal(size=(60, 4)) * 4 + shift for shift in ((-18, 0, 0, 0), (18, 0, 0, 0))]
        + [rng.normal(size=(15, 4)) * 2 + shift for shift in ((0, 9, 0, 0), (0, -9, 0, 0))]
    )
    truth = np.repeat([0, 1, 2], [120, 15, 15])
    begin = [np.repeat([0, 1, 2, 3], [60, 60, 15, 15])]
    uninformative, common = np.full((150, 1), 1.0), np.eye(3)[truth]
    split = partitions(Likelihood(place, uninformative), begin)[3]
    assert misclassification(split + 1, truth + 1) > 0.1
    np.testing.assert_array_equal(partitions(Likelihood(place, common), begin)[3], truth)


def test_outliers_do_not_hide_a_motion() -> None:
    rng = np.random.default_rng(8)
    points, labels = rigid_bodies(rng)
    irregular = points[rng.choice(len(points), 18)] + rng.normal(0, 25, (18, *points.shape[1:]))
    points, labels = (
        np.concatenate([points, irregular]),
        np.concatenate([labels, np.zeros(18, int)]),
    )
    segmentation = cluster(points, mixture_of(sets_of(points, rng, 3)), motions=3, rng=rng)
    assert misclassification(segmentation.labels, labels) <= 0.02


def test_mode_votes_are_those_of_the_hypotheses_near_a_track() -> None:
    points, labels = rigid_bodies(np.random.default_rng(5))
    apart = points + np.where(labels == 1, 0.0, 400.0 * labels)[:, None, None]
    rng = np.random.default_rng(1)
    (entry,) = sets_of(apart, rng, 3)
    observed_set = ObservedSet.of(apart, entry)
    made_of = labels[entry.subsets]
    assert (made_of == made_of[:, :1]).all()
    everyone = np.arange(len(apart))
    problem = SelectionProblem(
        apart, (observed_set,), (), SegmentOptions(motions=3), rng, (made_of[:, 0] - 1,), everyone
    )
    votes = ModeVotes.of_set(problem, 0)
    np.testing.assert_allclose(votes.vote_shares.sum(axis=1), 1.0)
    np.testing.assert_array_equal(votes.vote_shares.argmax(axis=1) + 1, labels)
    assert np.median(votes.misfit) < 0.5
    # indices refer to all tracks, also if some were left out
    kept = np.flatnonzero(everyone % 7 > 0)
    observed_set = ObservedSet.of(apart[kept], entry)
    problem = SelectionProblem(
        apart[kept], (observed_set,), (), SegmentOptions(motions=3), rng, problem.assignments, kept
    )
    shares = ModeVotes.of_set(problem, 0).vote_shares
    np.testing.assert_array_equal(shares.argmax(axis=1) + 1, labels[kept])
