"""The split test: halves of one object are one, objects that move differently are two."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import perspective_tracks, rigid_bodies

from mssegment.geometry.flats import local_residuals
from mssegment.segmentation.consensus.split_test import SplitTest


def pairwise(points: np.ndarray, labels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Perfect agreement within the labels, and the distances of the mean positions."""
    place = points.mean(axis=1)
    distances = np.linalg.norm(place[:, None] - place, axis=-1)
    return (labels[:, None] == labels).astype(float), distances


@pytest.mark.parametrize("frames", [3, 6, 20])
@pytest.mark.parametrize("single", [True, False])
def test_objects_are_apart_and_halves_of_one_are_not(frames: int, single: bool) -> None:
    points, labels = rigid_bodies(np.random.default_rng(4), sizes=(70, 70), frames=frames)
    first, second = (np.flatnonzero(labels == label) for label in np.unique(labels))
    test = SplitTest(points, *pairwise(points, labels), single=single)
    assert test.ratio(first, second) > 1
    for own in (first, second):
        place = points[own].mean(axis=1)
        for axis in (0, 1):
            left = place[:, axis] < np.median(place[:, axis])
            assert test.ratio(own[left], own[~left]) < 1


def test_the_ratio_is_symmetric_and_does_not_depend_on_the_order() -> None:
    points, labels = rigid_bodies(np.random.default_rng(4), sizes=(50, 40), frames=8)
    first, second = (np.flatnonzero(labels == label) for label in np.unique(labels))
    test = SplitTest(points, *pairwise(points, labels), single=True)
    ratio = test.ratio(first, second)
    assert test.ratio(second, first) == pytest.approx(ratio, rel=1e-9)
    shuffled = np.random.default_rng(0).permutation(first)
    again = SplitTest(points, *pairwise(points, labels), single=True)
    assert again.ratio(shuffled, second) == pytest.approx(ratio, rel=1e-9)


def test_the_ratio_does_not_depend_on_the_unit() -> None:
    points, labels = rigid_bodies(np.random.default_rng(5), sizes=(50, 40), frames=8)
    first, second = (np.flatnonzero(labels == label) for label in np.unique(labels))
    ratios = []
    for scale in (1e-3, 1.0, 1e3):
        moved = scale * points + 7.0 * scale
        test = SplitTest(moved, *pairwise(moved, labels), single=True)
        ratios.append(test.ratio(first, second))
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-3)


@pytest.mark.parametrize("noise", [0.1, 0.5, 2.0])
def test_the_noise_is_measured(noise: float) -> None:
    points, labels = rigid_bodies(np.random.default_rng(6), sizes=(150,), frames=12, noise=0.0)
    points = points + np.random.default_rng(7).normal(0, noise, points.shape)
    found = SplitTest(points, *pairwise(points, labels), single=True).noise
    assert found == pytest.approx(noise, rel=0.2)


def test_local_residuals_leave_the_vector_itself_out(rng: np.random.Generator) -> None:
    vectors = rng.normal(size=(30, 3)) @ rng.normal(size=(3, 10))
    np.testing.assert_allclose(local_residuals(vectors), 0.0, atol=1e-8)
    vectors[4] += 50.0
    assert np.linalg.norm(local_residuals(vectors)[4]) > 1.0
    moved = local_residuals(np.delete(vectors, 4, axis=0))
    np.testing.assert_allclose(moved, 0.0, atol=1e-8)


@pytest.mark.parametrize("frames", [4, 10])
def test_halves_of_one_object_under_strong_perspective_are_one(frames: int) -> None:
    points = perspective_tracks(np.random.default_rng(8), tracks=120, frames=frames)
    points = points + np.random.default_rng(9).normal(0, 0.2, points.shape)
    place = points.mean(axis=1)
    left = place[:, 0] < np.median(place[:, 0])
    test = SplitTest(points, *pairwise(points, np.zeros(120)), single=False)
    assert test.ratio(np.flatnonzero(left), np.flatnonzero(~left)) < 1


def halves_of(points: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The left and the right half of some tracks."""
    left = points[own].mean(axis=1)[:, 0]
    return own[left < np.median(left)], own[left >= np.median(left)]


@pytest.mark.parametrize("frames", [3, 6, 20])
def test_two_bodies_predict_two_bodies_better_than_one_and_halves_do_not(frames: int) -> None:
    points, labels = rigid_bodies(np.random.default_rng(4), sizes=(70, 70), frames=frames)
    bodies = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    test = SplitTest(points, *pairwise(points, labels), single=True)
    evidence = test.rigid_evidence(bodies[0], bodies[1])
    assert evidence > 10.0
    assert test.rigid_evidence(bodies[1], bodies[0]) == pytest.approx(evidence, rel=1e-6)
    for own in bodies:
        assert test.rigid_evidence(*halves_of(points, own)) < 0.2 * evidence


@pytest.mark.parametrize("frames", [5, 20])
def test_drift_is_no_evidence_for_two_bodies_over_few_frames_either(frames: int) -> None:
    evidence = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        points, labels = rigid_bodies(rng, sizes=(120,), frames=frames)
        place = points.mean(axis=1)
        x, y = (place - place.mean(axis=0)).T / 60
        drift = np.column_stack([x**2, x * y]) + rng.normal(0, 0.6, (120, 2))
        drifting = points + np.linspace(-1, 1, frames)[:, None] * drift[:, None]
        test = SplitTest(drifting, *pairwise(drifting, labels), single=True)
        evidence.append(test.rigid_evidence(*halves_of(drifting, np.arange(120))))
    assert np.mean(evidence) < 3.0
