"""Selection by description length: laws of the description, and its results."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid

from mssegment.datasets import read
from mssegment.errors import DataError
from mssegment.evaluation import misclassification
from mssegment.records import ClusterResult, Floats, Integers, replace
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.mdl.candidates import Family, covering
from mssegment.segmentation.mdl.labelling import Neighbourhood, frequency_labels, neighbour_labels
from mssegment.segmentation.mdl.likelihood import Noise, uniform_cost
from tests.stages import cluster, hypothesize

NOISE = Noise(
    dimension=2,
    residual_terms=1,
    floor=0.5,
    cap=5.0,
    log_free_extent=0.0,
    outlier_cost=12.0,
    parallax=np.zeros(40),
)


def two_objects(
    seed: int, sizes: tuple[int, ...] = (40, 30), outliers: int = 30
) -> tuple[Floats, Integers]:
    """Objects side by side that move differently, noise 0.5 px, uniform mismatches, 640 x 480."""
    rng = np.random.default_rng(seed)
    tracks, labels = [], []
    for j, size in enumerate(sizes):
        first = rng.uniform([200 * j + 20, 100], [200 * j + 170, 300], (size, 2))
        linear = np.eye(2) + rng.normal(0, 0.05, (2, 2))
        second = (first - first.mean(0)) @ linear.T + first.mean(0) + [60 - 90 * j, 40 * j - 20]
        tracks.append(np.stack([first, second + rng.normal(0, 0.5, second.shape)], axis=1))
        labels += [j + 1] * size
    tracks.append(rng.uniform([0, 0], [640, 480], (outliers, 2, 2)))
    return np.concatenate(tracks), np.array(labels + [0] * outliers)


def segment(points: Floats, model: str = "affine", **options: object) -> ClusterResult:
    sets = hypothesize(points, model=model, count=300, rng=np.random.default_rng(5))
    return cluster(points, sets, rng=np.random.default_rng(6), **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(3))
def test_motions_are_found_and_counted(seed: int) -> None:
    points, labels = two_objects(seed)
    found = segment(points)
    assert len(found.motions) == 2
    assert misclassification(found.labels, labels) <= 0.03
    assert all(motion.cost_saved is not None and motion.cost_saved > 0 for motion in found.motions)


def test_one_object_is_one_motion_however_dense_its_matches() -> None:
    points, _ = two_objects(1, sizes=(400,), outliers=100)
    assert len(segment(points).motions) == 1


@pytest.mark.parametrize("frames", [2, 5])
@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_a_common_translation_is_one_motion(frames: int, noise: float) -> None:
    rng = np.random.default_rng(0)
    shift = np.arange(frames)[:, None] * np.array([20.0, 5.0])
    points = rng.uniform(0, 400, (60, 1, 2)) + shift
    points[:, 1:] += rng.normal(0, noise, (60, frames - 1, 2))
    found = segment(points, "affine" if frames == 2 else "factorization")
    assert len(found.motions) == 1
    assert (found.labels == 1).mean() > 0.9


def test_mismatches_alone_have_no_motion() -> None:
    points = np.random.default_rng(3).uniform([0, 0], [640, 480], (120, 2, 2))
    points[:3] = [[[100, 100], [110, 100]], [[120, 100], [130, 100]], [[100, 120], [110, 120]]]
    try:
        found = segment(points)
    except DataError:  # no hypothesis has support, which is also an answer
        return
    assert not found.motions


@pytest.mark.parametrize("wanted", [1, 2])
def test_a_given_number_of_motions_is_found(wanted: int) -> None:
    points, _ = two_objects(2)
    assert len(segment(points, motions=wanted).motions) == wanted


def test_a_body_of_seven_matches_is_found_and_of_five_is_said_to_be_missing() -> None:
    points, labels = two_objects(2, sizes=(60, 7))
    np.testing.assert_array_equal(segment(points).labels, labels)
    points, _ = two_objects(2, sizes=(60, 5))
    found = segment(points, min_motions=2)
    assert len(found.motions) == 1
    assert "2 motions requested, 1 found" in found.notes


def test_tracks_that_the_modes_leave_have_candidates() -> None:
    points, labels = two_objects(0, sizes=(60, 12))
    (hypotheses,) = hypothesize(points, model="affine", count=300, rng=np.random.default_rng(5))
    noise = replace(NOISE, parallax=np.zeros(len(points)))
    family = Family(0, ObservedSet.of(points, hypotheses), noise)
    small = labels == 2
    (best, *_) = covering(family, small)
    residuals = family.residuals(hypotheses.points[[best]])[0]
    assert np.median(residuals[small]) < 2.0
    assert covering(family, np.zeros(len(points), dtype=bool)) == []


def test_missing_motions_are_not_invented() -> None:
    points, _ = two_objects(2, sizes=(60,), outliers=0)
    found = segment(points, motions=3)
    assert len(found.motions) == 3 or any("motions requested" in note for note in found.notes)


def test_a_larger_image_has_the_same_labels() -> None:
    points, _ = two_objects(4)
    np.testing.assert_array_equal(segment(points).labels, segment(3.0 * points).labels)


def test_same_seed_same_result() -> None:
    points, _ = two_objects(5)
    first, second = segment(points), segment(points)
    np.testing.assert_array_equal(first.labels, second.labels)
    for one, other in zip(first.motions, second.motions, strict=True):
        assert one.parameters.tobytes() == other.parameters.tobytes()


def test_labels_and_inliers_agree() -> None:
    points, _ = two_objects(6)
    found = segment(points)
    for motion in found.motions:
        np.testing.assert_array_equal(np.flatnonzero(found.labels == motion.label), motion.inliers)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 4), st.integers(1, 40))
def test_labels_save_at_least_as_much_as_none(seed: int, motions: int, tracks: int) -> None:
    rng = np.random.default_rng(seed)
    gains = rng.normal(-2, 6, (motions, tracks))
    labels, saved = frequency_labels(gains)
    assert labels.shape == (tracks,)
    assert labels.min(initial=0) >= 0
    assert labels.max(initial=0) <= motions
    # the code of the labels never saves anything
    assert saved <= np.maximum(gains.max(axis=0, initial=0.0), 0.0).sum() + 1e-9
    near = neighbour_labels(gains, Neighbourhood(rng.uniform(0, 10, (tracks, 2))), labels)
    assert near.shape == (tracks,)


def test_splitting_a_label_in_two_costs_an_amount_per_track() -> None:
    whole = np.full((1, 100), 5.0)
    halves = np.where(np.arange(100) < 50, [[5.0], [-5.0]], [[-5.0], [5.0]])
    lost = frequency_labels(whole)[1] - frequency_labels(halves)[1]
    assert lost == pytest.approx(100 * np.log(2.0))


def test_neighbours_decide_between_equal_motions() -> None:
    places = np.stack([np.arange(40.0), np.zeros(40)], axis=1)
    gains = np.where(np.arange(40) < 20, [[6.0], [3.0]], [[3.0], [6.0]])
    gains[:, [5, 30]] = 5.0
    labels = neighbour_labels(gains, Neighbourhood(places), frequency_labels(gains)[0])
    assert labels[5] == 1
    assert labels[30] == 2


def test_the_nearest_assigned_neighbours_are_found(rng: np.random.Generator) -> None:
    space = rng.uniform(0, 10, (60, 2))
    neighbourhood = Neighbourhood(space)
    for share in (0.9, 0.3, 0.1):
        assigned = rng.uniform(size=60) < share
        found = neighbourhood.of(assigned)
        for track, near in enumerate(found):
            others = np.setdiff1d(np.flatnonzero(assigned), [track])
            distance = np.linalg.norm(space[others] - space[track], axis=1)
            np.testing.assert_array_equal(near, others[distance.argsort()[: len(near)]])


@pytest.mark.parametrize("freedom", [2.5, np.inf])
def test_residual_at_half_gain(freedom: float) -> None:
    noise, scales = replace(NOISE, degrees_of_freedom=freedom), np.array([0.5, 2.0, 5.0])
    at_half = noise.gains(noise.residual_at_half_gain(scales)[:, None], scales)[:, 0]
    np.testing.assert_allclose(at_half, noise.max_gain(scales) / 2)
    useless = np.array([1e5])  # saves nothing even on a perfect fit
    assert noise.residual_at_half_gain(useless) == 0


@pytest.mark.parametrize("seed", range(4))
def test_separate_objects_that_move_almost_alike_are_two(seed: int) -> None:
    points = almost_alike(seed, difference=3.0)
    assert len(segment(points, granularity="surface").motions) == 2


@pytest.mark.parametrize("seed", range(4))
def test_separate_parts_that_move_alike_are_one(seed: int) -> None:
    points = almost_alike(seed, difference=0.0)
    assert len(segment(points, granularity="surface").motions) == 1


def almost_alike(seed: int, difference: float) -> Floats:
    """16 tracks each of two places, all in one affine motion but for the ``difference`` (pixels).

    Noise 0.5 px in both views and 30 mismatches. The difference is one that no affine motion of
    both could have: the second place has its own rotation.
    """
    rng = np.random.default_rng(seed)
    parts = []
    for j, corner in enumerate(((100, 100), (300, 150))):
        first = rng.uniform(corner, np.add(corner, 100), (16, 2))
        angle = j * difference / 40
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        middle = first.mean(axis=0)
        second = (first - middle) @ turn.T + middle + [25.0, 10.0]
        parts.append(np.stack([first, second], axis=1) + rng.normal(0, 0.5, (16, 2, 2)))
    parts.append(rng.uniform([100, 100], [420, 270], (30, 2, 2)))
    return np.concatenate(parts)


def test_gains_are_densities() -> None:
    """exp(gain - outlier) integrates to one over the plane of residuals."""
    radius = np.linspace(0, 4000, 4_000_001)
    for freedom in (2.5, np.inf):
        gains = replace(NOISE, degrees_of_freedom=freedom).gains(radius[None], np.array([1.3]))[0]
        ring = np.exp(gains - NOISE.outlier_cost) * 2 * np.pi * radius
        assert trapezoid(ring, radius) == pytest.approx(1.0, abs=1e-3)


def test_the_scale_is_the_most_likely_one(rng: np.random.Generator) -> None:
    residuals = np.abs(rng.standard_t(3, (1, 40))) * 1.2
    inliers = np.ones((1, 40))
    noise = replace(NOISE, floor=1e-3, cap=1e3)
    scale = noise.scales(residuals, inliers)
    for _ in range(20):
        scale = noise.scales(residuals, inliers, scale)
    best = noise.gains(residuals, scale).sum()
    for factor in (0.97, 1.03):
        assert noise.gains(residuals, scale * factor).sum() < best


def test_a_common_scale_changes_no_gain(rng: np.random.Generator) -> None:
    points = rng.uniform(0, 500, (40, 2, 2))
    for factor in (0.5, 4.0):
        small = replace(NOISE, outlier_cost=uniform_cost(points))
        large = replace(NOISE, outlier_cost=uniform_cost(factor * points))
        residuals = rng.uniform(0, 9, (3, 40))
        np.testing.assert_allclose(
            small.gains(residuals, np.ones(3)), large.gains(factor * residuals, np.full(3, factor))
        )


def pair(folder: Path, name: str) -> tuple[Floats, Integers]:
    imported = read(folder / "adelaidermf" / f"{name}.mat")
    assert imported.tracks.labels is not None
    return imported.tracks.points, imported.tracks.labels


@pytest.mark.parametrize("name", ["motion/cubetoy", "motion/toycubecar", "motion/book"])
def test_objects_of_real_pairs(data_folder: Path, name: str) -> None:
    points, labels = pair(data_folder, name)
    found = segment(points)
    assert len(found.motions) == labels.max()
    assert misclassification(found.labels, labels) <= 0.02


def test_surfaces_of_a_real_pair(data_folder: Path) -> None:
    points, labels = pair(data_folder, "plane/oldclassicswing")
    found = segment(points, model="homography", granularity="surface")
    assert len(found.motions) == labels.max()
    assert misclassification(found.labels, labels) <= 0.02


def test_the_order_of_the_matches_does_not_matter(data_folder: Path) -> None:
    points, labels = pair(data_folder, "motion/biscuitbookbox")
    for seed in range(2):
        order = np.random.default_rng(seed).permutation(len(points))
        found = segment(points[order])
        assert len(found.motions) == 3
        assert misclassification(found.labels, labels[order]) <= 0.01


def test_mismatches_added_stay_outliers(data_folder: Path) -> None:
    points, labels = pair(data_folder, "motion/cubetoy")
    added = np.random.default_rng(0).uniform([0, 0], [640, 480], (2 * len(points), 2, 2))
    found = segment(np.concatenate([points, added]))
    assert len(found.motions) == 2
    truth = np.concatenate([labels, np.zeros(len(added), dtype=np.int64)])
    assert misclassification(found.labels, truth) <= 0.02


def test_true_labels_are_not_parameters() -> None:
    for function in (hypothesize, cluster):
        assert "labels" not in inspect.signature(function).parameters
        assert "truth" not in inspect.signature(function).parameters


def test_auto_notes_its_choice() -> None:
    points, labels = two_objects(7)
    found = segment(points, model="auto", granularity="auto")
    assert {motion.model for motion in found.motions} <= {"affine", "homography"}
    assert any(note.startswith("granularity auto:") for note in found.notes)
    assert any(note.startswith("models chosen:") for note in found.notes)
    assert misclassification(found.labels, labels) <= 0.05


def test_drift_within_an_object_is_not_a_second_motion() -> None:
    """Drift of a tracker over several frames is smooth, and varies within an object."""
    rng = np.random.default_rng(0)
    first = rng.uniform(0, 300, (250, 1, 2))
    points = first + np.arange(5)[:, None] * np.array([8.0, 3.0])
    bend = 0.1 * np.sin(first[..., :1] / 40) * np.arange(5)[None, :, None]
    points = points + bend + rng.normal(0, 0.1, points.shape)
    assert len(segment(points, "factorization", granularity="surface").motions) == 1
