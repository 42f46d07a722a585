"""Assignment of further tracks to motions, and labels smoothed by neighbours."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.records import NOT_JUDGED, OUTLIER
from mssegment.segmentation.assignment import assign
from mssegment.segmentation.mdl.labelling import smooth_labels
from tests.stages import cluster, hypothesize

MOTIONS = (
    (np.array([[1.0, -0.05], [0.05, 1.0]]), np.array([30.0, 5.0])),
    (np.array([[1.1, 0.0], [0.0, 1.1]]), np.array([-25.0, -20.0])),
)


def matches(rng: np.random.Generator, count: int, noise: float = 0.3):
    """``count`` matches of each of two affine motions, left and right, and their true motion."""
    both = []
    for left, (turn, shift) in zip((0.0, 300.0), MOTIONS, strict=True):
        place = np.array([left, 0.0])
        first = rng.uniform(0, 200, (count, 2)) + place
        second = (first - place) @ turn.T + place + shift
        both.append(np.stack([first, second], axis=1))
    points = np.concatenate(both)
    return points + rng.normal(0, noise, points.shape), np.repeat([1, 2], count)


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(4)
    points, truth = matches(rng, 60)
    sets = hypothesize(points, model="affine", rng=rng)
    found = cluster(points, sets, rng=rng)
    name = {1: found.labels[truth == 1][0], 2: found.labels[truth == 2][0]}
    assert len(found.motions) == 2
    return points, sets, found, name


def test_new_tracks_are_assigned_to_their_motion(scene) -> None:
    _, sets, found, name = scene
    points, truth = matches(np.random.default_rng(9), 100)
    labels = assign(points, sets, found)
    assert (labels == np.vectorize(name.get)(truth)).mean() >= 0.97


def test_tracks_of_no_motion_are_outliers(scene) -> None:
    _, sets, found, _ = scene
    points, _ = matches(np.random.default_rng(9), 100)
    points[:, 1] += (0.0, 80.0)
    assert (assign(points, sets, found) == OUTLIER).all()


def test_each_track_is_assigned_independently(scene) -> None:
    points, sets, found, _ = scene
    order = np.random.default_rng(0).permutation(len(points))
    labels = assign(points, sets, found)
    np.testing.assert_array_equal(assign(points[order], sets, found), labels[order])
    np.testing.assert_array_equal(assign(points[:5], sets, found), labels[:5])


def test_without_motions_everything_is_an_outlier(scene) -> None:
    from mssegment.records import replace

    points, sets, found, _ = scene
    assert (assign(points, sets, replace(found, motions=())) == OUTLIER).all()


def test_assignment_agrees_with_the_segmentation(scene) -> None:
    points, sets, found, _ = scene
    labelled = (found.labels > OUTLIER) & (found.labels != NOT_JUDGED)
    agree = assign(points, sets, found)[labelled] == found.labels[labelled]
    assert agree.mean() >= 0.97


def ring(count: int) -> np.ndarray:
    """The two neighbours to either side of each of ``count`` tracks on a circle."""
    return (np.arange(count)[:, None] + (-2, -1, 1, 2)) % count


def test_an_ambiguous_track_gets_the_label_of_its_neighbours() -> None:
    gains = np.repeat([[5.0], [0.0]], 20, axis=1)
    gains[:, 10:] = gains[::-1, 10:]
    gains[:, 4] = 4.9, 5.0
    labels = gains.argmax(axis=0) + 1
    assert labels[4] == 2
    np.testing.assert_array_equal(smooth_labels(gains, ring(20), labels), np.repeat([1, 2], 10))


def test_an_unambiguous_track_keeps_its_label() -> None:
    gains = np.repeat([[5.0], [0.0]], 20, axis=1)
    gains[:, 4] = 0.0, 50.0
    labels = gains.argmax(axis=0) + 1
    np.testing.assert_array_equal(smooth_labels(gains, ring(20), labels), labels)


def test_the_order_of_motions_does_not_matter(rng: np.random.Generator) -> None:
    gains = rng.normal(2, 3, (3, 60))
    labels = gains.argmax(axis=0) + 1
    new = np.array([0, 3, 1, 2])
    back = gains[[1, 2, 0]]
    np.testing.assert_array_equal(
        new[smooth_labels(gains, ring(60), labels)], smooth_labels(back, ring(60), new[labels])
    )
