"""Long sequences by mean shift: modes start groups, a likelihood refines them."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import rigid_bodies

from mssegment.evaluation import misclassification
from mssegment.records import OUTLIER
from mssegment.segmentation import cluster
from mssegment.segmentation.clouds import draw_long_sets
from mssegment.segmentation.consensus import is_long
from mssegment.segmentation.consensus.bodies import refine


def sets_of(points: np.ndarray, rng: np.random.Generator, rank: int | str = "auto"):
    everyone = np.ones(len(points), dtype=bool)
    return draw_long_sets(
        points, count=120, sampling="local", eligible=everyone, rank=rank, rng=rng
    )


@pytest.fixture(scope="module")
def found():
    points, labels = rigid_bodies(np.random.default_rng(5))
    rng = np.random.default_rng(0)
    sets = sets_of(points, rng)
    return labels, sets, cluster(points, sets, method="meanshift", motions=3, rng=rng)


def test_both_ranks_are_pooled(found) -> None:
    _, sets, _ = found
    assert [entry.points.shape[-1] for entry in sets] == [3, 4]
    assert is_long(sets)


def test_bodies_are_found(found) -> None:
    labels, _, segmentation = found
    assert misclassification(segmentation.labels, labels) <= 0.02
    assert len(segmentation.motions) == 3


def test_motions_name_modes_of_their_own(found) -> None:
    _, _, segmentation = found
    named = [mode.motion for mode in segmentation.modes if mode.motion]
    assert len(named) == len(set(named))
    for motion in segmentation.motions:
        assert motion.rms < 1.0
        assert (segmentation.labels[motion.inliers] == motion.label).all()


def test_a_wild_track_is_an_outlier() -> None:
    points, _ = rigid_bodies(np.random.default_rng(6), sizes=(90, 60))
    points[3] += np.random.default_rng(0).normal(0, 30, points[3].shape)
    rng = np.random.default_rng(0)
    segmentation = cluster(points, sets_of(points, rng, 4), method="meanshift", motions=2, rng=rng)
    assert segmentation.labels[3] == OUTLIER


def test_refinement_mends_what_was_swapped(rng: np.random.Generator) -> None:
    truth = np.repeat([0, 1], 60)
    components = rng.normal(size=(120, 12)) + 15 * truth[:, None]
    wrong = truth.copy()
    wrong[:9], wrong[60:69] = 1, 0
    np.testing.assert_array_equal(refine(components, wrong), truth)
