"""Consensus on synthetic objects: laws, invariances, outliers, gaps; and on real sequences."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from moving_bodies import perspective_tracks, rigid_bodies

from mssegment import manifolds
from mssegment.datasets import DATASETS
from mssegment.errors import DataError, MssegmentError
from mssegment.evaluation import misclassification
from mssegment.geometry.flats import leave_one_out_residuals
from mssegment.records import NOT_JUDGED, OUTLIER, replace
from mssegment.sampling.frame_pairs import draw_for_consensus, draw_subsets
from mssegment.sampling.strategy import choose_strategy
from mssegment.segmentation import SegmentOptions
from mssegment.segmentation.consensus import cluster_by_consensus, segment_by_consensus
from mssegment.segmentation.consensus.border import border_contrast
from mssegment.segmentation.consensus.coassociation import mark_best
from mssegment.segmentation.consensus.model_order import epipolar_pairs, group_cost
from mssegment.segmentation.consensus.spectral import embedding, partition, sharpen
from tests.stages import cluster


def run(points: np.ndarray, seed: int = 0, **options):
    rng = np.random.default_rng(seed)
    return cluster_by_consensus(points, draw_for_consensus(points, rng), rng, **options)


@pytest.fixture(scope="module")
def scene():
    return rigid_bodies(np.random.default_rng(5))


def test_tracks_mark_the_best_hypotheses(rng: np.random.Generator) -> None:
    squared = rng.random((9, 30))
    marks = mark_best(squared, 4)
    np.testing.assert_array_equal(marks.sum(axis=1), 4)
    assert (np.where(marks > 0, squared, 0).max(axis=1) < np.sort(squared, axis=1)[:, 4]).all()


def test_subsets_hold_distinct_tracks(rng: np.random.Generator) -> None:
    neighbours = np.array([[(i + k) % 40 for k in range(1, 13)] for i in range(40)])
    subsets = draw_subsets(neighbours, 4, 500, rng)
    assert subsets.shape == (500, 4)
    assert (np.diff(np.sort(subsets, axis=1), axis=1) > 0).all()


def test_spectral_partition_finds_blocks(rng: np.random.Generator) -> None:
    truth = np.repeat([0, 1, 2], (20, 30, 10))
    agreement = (truth[:, None] == truth) * 0.8 + rng.random((60, 60)) * 0.2
    vectors = embedding(sharpen((agreement + agreement.T) / 2, 4), 5)
    labels = partition(vectors, 3, rng)
    assert misclassification(labels + 1, truth + 1) == 0


def test_cost_of_a_group_does_not_depend_on_axes_or_origin(rng: np.random.Generator) -> None:
    group = rng.normal(size=(80, 12)) * rng.uniform(1, 30, 12)
    turn, _ = np.linalg.qr(rng.normal(size=(12, 12)))
    assert group_cost(group @ turn + 100, 100) == pytest.approx(group_cost(group, 100))


def test_contrast_is_low_between_objects_and_about_one_inside(rng: np.random.Generator) -> None:
    place = rng.uniform(0, 10, (200, 2))
    gaps = np.linalg.norm(place[:, None] - place, axis=-1)
    left, right = np.flatnonzero(place[:, 0] < 5), np.flatnonzero(place[:, 0] >= 5)
    inside = np.exp(-gaps)
    assert border_contrast(inside, gaps, left, right) == pytest.approx(1, abs=0.25)
    same = (place[:, 0] < 5)[:, None] == (place[:, 0] < 5)
    assert border_contrast(inside * same, gaps, left, right) < 0.05


def test_leave_one_out_residuals_reveal_a_leverage_point(rng: np.random.Generator) -> None:
    flat = rng.normal(size=(40, 3)) @ rng.normal(size=(3, 20)) + rng.normal(0, 0.01, (40, 20))
    flat[7] += 500 * rng.normal(size=20)
    residual = leave_one_out_residuals(flat)
    assert residual[7] > 50 * np.median(residual)


@pytest.mark.parametrize("seed", range(4))
def test_motions_are_found_and_counted(seed: int) -> None:
    points, labels = rigid_bodies(np.random.default_rng(seed))
    found = run(points, seed)
    assert misclassification(found.labels, labels) <= 0.02
    assert found.labels.max() == 3
    sizes = np.bincount(found.labels)[1:]
    assert (np.diff(sizes) <= 0).all()


def test_one_object_is_one_motion() -> None:
    for seed in range(5):
        points, _ = rigid_bodies(np.random.default_rng(seed), sizes=(120,))
        assert run(points, seed).labels.max() == 1


@settings(max_examples=8, deadline=None)
@given(
    scale=st.sampled_from([0.1, 0.5, 2.0, 30.0]),
    shift=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    seed=st.integers(0, 100),
)
def test_scale_position_and_order_do_not_matter(scale, shift, seed) -> None:
    points, labels = rigid_bodies(np.random.default_rng(5))
    order = np.random.default_rng(seed).permutation(len(points))
    found = run((points * scale + shift)[order], seed)
    assert misclassification(found.labels, labels[order]) <= 0.02


def test_same_seed_same_labels(scene) -> None:
    points, _ = scene
    np.testing.assert_array_equal(run(points, 3).labels, run(points, 3).labels)


def test_outliers_are_labelled_as_outliers(scene) -> None:
    points, labels = scene
    rng = np.random.default_rng(1)
    wrong = points[rng.integers(len(points), size=36)].copy()
    for track in wrong:
        track[:] = track[rng.permutation(len(track))]
    found = run(np.concatenate([points, wrong])).labels
    assert misclassification(found, np.concatenate([labels, np.zeros(36, int)])) <= 0.02
    assert (found[len(points) :] == OUTLIER).mean() > 0.9


def test_short_tracks_are_labelled_and_invisible_ones_are_not_judged(scene) -> None:
    points, labels = scene
    points = points.copy()
    rng = np.random.default_rng(2)
    cut = rng.choice(len(points), 30, replace=False)
    for track in cut[1:]:
        start = rng.integers(0, 8)
        points[track, :start] = points[track, start + 12 :] = np.nan
    points[cut[0], :] = np.nan
    found = run(points).labels
    assert found[cut[0]] == NOT_JUDGED
    judged = found != NOT_JUDGED
    assert judged.mean() > 0.95
    assert misclassification(found, labels) <= 0.03


def test_incomplete_tracks() -> None:
    points, labels = rigid_bodies(np.random.default_rng(8), sizes=(90, 70, 60), frames=24)
    rng = np.random.default_rng(3)
    for track in points:
        length = rng.integers(8, 20)
        start = rng.integers(0, 24 - length)
        track[:start] = track[start + length :] = np.nan
    drawn = draw_for_consensus(points, np.random.default_rng(0))
    assert drawn.partition == "joinedness"
    found = run(points, motions=3)
    assert misclassification(found.labels, labels) <= 0.03


def test_excluded_tracks_are_not_used(scene) -> None:
    points, labels = scene
    eligible = labels != 2
    rng = np.random.default_rng(0)
    hypotheses = draw_for_consensus(points, rng, eligible=eligible)
    assert all(eligible[entry.subsets].all() for entry in hypotheses.sets)
    found = cluster_by_consensus(points, hypotheses, rng, motions=2, eligible=eligible)
    assert (found.labels[~eligible] == OUTLIER).all()
    assert misclassification(found.labels[eligible], labels[eligible]) <= 0.02


def test_every_motion_is_a_point_on_a_manifold_and_has_a_mode(scene) -> None:
    points, labels = scene
    rng = np.random.default_rng(0)
    hypotheses = draw_for_consensus(points, rng)
    sets = hypotheses.sets
    status = np.where(labels == 3, -1, 0)
    found = segment_by_consensus(
        points, hypotheses, status=status, options=SegmentOptions(motions=2), rng=rng
    )
    assert (found.labels[labels == 3] == -1).all()
    assert [motion.label for motion in found.motions] == [1, 2]
    assert sorted(mode.motion for mode in found.modes) == [1, 2]
    densities = [mode.kde for mode in found.modes]
    assert densities == sorted(densities, reverse=True)
    for motion in found.motions:
        manifold = manifolds.from_name(sets[motion.set_index].manifold)
        manifold.check_point(motion.parameters)
        assert motion.rms < 1.0
        own = found.residuals[motion.label - 1]
        other = (found.labels > 0) & (found.labels != motion.label)
        assert np.median(own[motion.inliers]) < 0.5 * np.median(own[other])
    for entry, places in zip(sets, found.assignments, strict=True):
        assert places.shape == (len(entry.points),)


@pytest.mark.parametrize(
    ("method", "selection", "model", "frames", "strategy"),
    [
        ("auto", "mdl", "factorization", 20, "consensus"),
        ("auto", "mdl", "factorization", 3, "consensus"),
        ("auto", "dominance", "factorization", 5, "modes"),
        ("auto", "mdl", "affine", 2, "modes"),
        ("consensus", "mdl", "affine", 2, "consensus"),
        ("meanshift", "mdl", "factorization", 50, "mixture"),
        ("meanshift", "dominance", "factorization", 50, "modes"),
        ("meanshift", "mdl", "factorization", 5, "modes"),
    ],
)
def test_strategy_for_method_selection_and_frames(
    method: str, selection: str, model: str, frames: int, strategy: str
) -> None:
    assert choose_strategy(method, selection, (model,), frames) == strategy


def test_cluster_follows_the_strategy(scene) -> None:
    points, labels = scene
    hypotheses = draw_for_consensus(points, np.random.default_rng(0))
    assert (hypotheses.strategy, hypotheses.partition) == ("consensus", "spectral")
    found = cluster(points, hypotheses, rng=np.random.default_rng(0))
    assert misclassification(found.labels, labels) <= 0.02


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"granularity": "surface"}, "segment.granularity is surface"),
        ({"selection": "dominance"}, "segment.selection is dominance"),
        ({"threads": 2}, "threads is 2"),
    ],
)
def test_options_that_consensus_does_not_use_are_errors(scene, change, message: str) -> None:
    points, _ = scene
    hypotheses = draw_for_consensus(points, np.random.default_rng(0))
    with pytest.raises(MssegmentError, match=message) as raised:
        cluster(points, hypotheses, **change)
    assert "leave it at" in str(raised.value)


def test_two_views_by_consensus_have_motions_and_modes(rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(rng, sizes=(60, 60), frames=8)
    pair = points[:, [0, 7]]
    hypotheses = draw_for_consensus(pair, rng)
    found = cluster(pair, hypotheses, motions=2, rng=rng)
    assert misclassification(found.labels, labels) <= 0.1
    assert [motion.model for motion in found.motions] == ["affine", "affine"]
    assert sorted(mode.motion for mode in found.modes) == [1, 2]


def test_two_frames_are_enough(rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(rng, sizes=(60, 60), frames=8)
    found = run(points[:, [0, 7]], motions=2)
    assert misclassification(found.labels, labels) <= 0.1


def test_errors_if_tracks_cannot_be_grouped(scene) -> None:
    points, _ = scene
    rng = np.random.default_rng(0)
    with pytest.raises(DataError, match="2 frames"):
        draw_for_consensus(points[:, :1], rng)
    with pytest.raises(DataError, match="10 tracks in common"):
        draw_for_consensus(points[:6], rng)
    drawn = draw_for_consensus(points, rng)
    alone = replace(drawn, sets=tuple(e for e in drawn.sets if len(e.frames) > 2))
    with pytest.raises(DataError, match="frame pairs"):
        cluster_by_consensus(points, alone, rng)


@pytest.mark.data
def test_hopkins155_with_the_count_given_and_unknown(data_folder: Path) -> None:
    given, unknown, right = [], [], []
    for path in DATASETS["hopkins155"].files(data_folder / "hopkins155")[::13]:
        tracks = DATASETS["hopkins155"].read(path).tracks
        assert tracks.labels is not None
        true = int(tracks.labels.max())
        given.append(misclassification(run(tracks.points, motions=true).labels, tracks.labels))
        found = run(tracks.points).labels
        unknown.append(misclassification(found, tracks.labels))
        right.append(found.max() == true)
    assert np.mean(given) < 0.005
    assert np.mean(unknown) < 0.04
    assert np.mean(right) > 0.8


@pytest.mark.data
def test_kt3dmoseg_with_the_count_given(data_folder: Path) -> None:
    errors = []
    for path in DATASETS["kt3dmoseg"].files(data_folder / "kt3dmoseg")[1::4]:
        tracks = DATASETS["kt3dmoseg"].read(path).tracks
        assert tracks.labels is not None
        true = int(tracks.labels.max())
        errors.append(misclassification(run(tracks.points, motions=true).labels, tracks.labels))
    assert np.median(errors) < 0.03


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("frames", [4, 6])
def test_a_body_before_a_scene_with_depth_is_one_of_two(frames: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = perspective_tracks(rng, tracks=150, frames=frames)
    body, _ = rigid_bodies(rng, sizes=(50,), frames=frames, noise=0.0)
    body = body + np.arange(frames)[:, None] * rng.uniform(3, 6, 2)
    points = np.concatenate([scene, body])
    points = points + rng.normal(0, 0.2, points.shape)
    found = cluster_by_consensus(
        points, draw_for_consensus(points, np.random.default_rng(0)), np.random.default_rng(0)
    )
    assert found.labels.max() == 2
    assert misclassification(found.labels, np.repeat([1, 2], [150, 50])) < 0.03
    assert min(found.separations) > 1


@pytest.mark.parametrize("frames", [3, 4, 10, 60])
def test_pairs_of_the_epipolar_geometry_are_in_the_sequence(frames: int) -> None:
    pairs = epipolar_pairs(frames)
    assert pairs
    assert len(set(pairs)) == len(pairs)
    assert all(0 <= first < second < frames for first, second in pairs)
