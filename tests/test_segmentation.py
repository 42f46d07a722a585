"""From modes to motions: inliers, dominance, background, and the scenes of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.paper import run_scene, summarize, table
from benchmarks.scenes import CAMERA, HEIGHT, SETUPS, WIDTH, generate, oracle
from mssegment import models
from mssegment.errors import DataError, UsageError
from mssegment.evaluation import misclassification
from mssegment.preprocessing.background import camera_path, find_background, path_of_background
from mssegment.records import BACKGROUND, NOT_JUDGED, replace
from mssegment.segmentation import SELECTIONS
from mssegment.segmentation.dominant_modes.choice import largest_gap
from mssegment.segmentation.dominant_modes.inliers import first_minimum, inlier_limit
from tests.stages import cluster, hypothesize

SIZE = (WIDTH, HEIGHT)


def segment(setup, seed, **options):
    scene = generate(setup, seed)
    sets = hypothesize(
        scene.points,
        model=setup.model,
        camera=CAMERA,
        count=setup.hypotheses,
        rng=np.random.default_rng(seed),
    )
    return scene, sets, cluster(scene.points, sets, selection="dominance", **options)


@pytest.mark.parametrize("name", ["fig3", "fig4"])
def test_scenes_of_the_paper_are_segmented(name):
    outcomes = [run_scene(SETUPS[name], seed, "dominance", "object") for seed in range(4)]
    result = summarize(outcomes)
    assert result["mean_misclassification_given"] <= result["oracle"] + 0.01
    assert result["count_right"] >= 0.75
    assert result["res_ratio"] <= 1.1
    assert name in table({name: result})


def test_translations_of_the_paper():
    result = summarize([run_scene(SETUPS["fig2"], s, "dominance", "object") for s in range(4)])
    assert result["mean_misclassification_given"] < 0.2
    assert result["oracle"] < 0.1


@pytest.mark.parametrize("name", list(SETUPS))
def test_scenes_are_those_of_the_paper(name):
    setup = SETUPS[name]
    scene = generate(setup, 7)
    sizes = np.bincount(scene.labels)
    assert sizes.tolist() == [setup.outliers, *setup.inliers]
    assert scene.points.shape == (sum(sizes), setup.frames, 2)
    np.testing.assert_array_equal(scene.points, generate(setup, 7).points)
    assert np.std(scene.points - scene.exact) == pytest.approx(0.5, rel=0.15)
    assert misclassification(oracle(setup, scene), scene.labels) < 0.2


def test_a_segmentation_is_complete_and_consistent():
    scene, sets, found = segment(SETUPS["fig4"], 0)
    count = len(found.motions)
    assert count > 0
    assert [m.label for m in found.motions] == list(range(1, count + 1))
    sizes = [len(m.inliers) for m in found.motions]
    assert sizes == sorted(sizes, reverse=True)
    for motion in found.motions:
        np.testing.assert_array_equal(np.flatnonzero(found.labels == motion.label), motion.inliers)
    assert found.residuals.shape == (count, len(scene.points))
    kdes = [mode.kde for mode in found.modes]
    assert kdes == sorted(kdes, reverse=True)
    (assigned,) = found.assignments
    assert assigned.shape == (len(sets[0].points),)
    counted = np.bincount(assigned[assigned >= 0], minlength=len(found.modes))
    assert counted.tolist() == [mode.hypotheses for mode in found.modes]
    # the residual of an inlier is smallest for its own motion
    inlier = found.labels > 0
    own = found.residuals[found.labels[inlier] - 1, np.flatnonzero(inlier)]
    np.testing.assert_allclose(own, found.residuals[:, inlier].min(axis=0))


def test_the_labels_do_not_depend_on_the_number_of_threads():
    runs = [
        segment(SETUPS["fig4"], 1, rng=np.random.default_rng(4), threads=threads)[2]
        for threads in (1, 1, 2)
    ]
    for other in runs[1:]:
        np.testing.assert_array_equal(runs[0].labels, other.labels)
        np.testing.assert_array_equal(runs[0].residuals, other.residuals)


def test_the_number_of_motions_can_be_given():
    for wanted in (0, 1, 2):
        _, _, found = segment(SETUPS["fig4"], 2, motions=wanted)
        assert len(found.motions) == wanted
        assert len(np.unique(found.labels[found.labels > 0])) == wanted


def test_a_note_if_there_are_fewer_modes_than_motions():
    _, _, found = segment(SETUPS["fig4"], 2, motions=30)
    assert len(found.motions) < 30
    assert any("30 motions requested" in note for note in found.notes)


def test_background_and_short_tracks_keep_their_labels():
    setup = SETUPS["fig3"]
    scene = generate(setup, 0)
    points, status = scene.points.copy(), np.zeros(len(scene.points), dtype=np.int64)
    points[5, 3] = np.nan
    status[7] = BACKGROUND
    sets = hypothesize(
        points, model=setup.model, eligible=status == 0, count=200, rng=np.random.default_rng(0)
    )
    found = cluster(points, sets, status=status, selection="dominance")
    assert found.labels[7] == BACKGROUND
    assert found.labels[5] == NOT_JUDGED
    assert np.isnan(found.residuals[:, 5]).all()


@pytest.mark.parametrize("dimension", [1, 2, 7])
def test_the_first_minimum_is_between_noise_and_the_rest(dimension, rng):
    noise = np.linalg.norm(rng.normal(0.0, 0.5, (60, dimension)), axis=1)
    rest = rng.uniform(30.0, 300.0, 100)
    cut = first_minimum(np.concatenate([noise, rest]), dimension, least=8)
    assert noise.max() * 0.8 < cut < 30.0
    # it is proportional to the residuals
    scaled = first_minimum(10 * np.concatenate([noise, rest]), dimension, least=8)
    assert scaled == pytest.approx(10 * cut, rel=0.05)


def test_noise_alone_has_no_minimum(rng):
    assert np.isinf(first_minimum(np.abs(rng.normal(size=5)), 1, least=8))
    assert np.isinf(first_minimum(np.full(20, 0.3), 2, least=8))


def test_the_limit_is_where_noise_and_mismatches_are_equally_likely(rng):
    model = models.make("affine")
    noise = np.linalg.norm(rng.normal(0.0, 0.5, (80, 2)), axis=1)
    limit = inlier_limit(np.concatenate([noise, rng.uniform(5.0, 200.0, 40)]), model)
    assert 2.0 * 0.5 < limit < 6.0 * 0.5


@pytest.mark.parametrize(
    ("masses", "count"),
    [([], 0), ([5.0], 1), ([9.0, 8.0, 7.0, 0.1], 3), ([9.0, 0.5, 0.4, 0.3], 1), ([4, 3], 2)],
)
def test_the_largest_gap(masses, count):
    assert largest_gap(np.array(masses, dtype=float), 0.1) == count


def static_scene(rng, static, moving, shake=0.0):
    """Tracks over 3 frames: a static background over the image, and a moving object."""
    ground = np.repeat(rng.uniform(0.0, [640.0, 480.0], (static, 2))[:, None], 3, axis=1)
    moving_object = rng.uniform(100.0, 200.0, (moving, 2))[:, None] + np.arange(3)[:, None] * [
        9.0,
        4.0,
    ]
    points = np.concatenate([ground, moving_object])
    return points + shake * np.array([[0.0, 0.0], [1.0, 0.5], [-0.5, 1.0]])


@pytest.mark.parametrize("shake", [0.0, 1.2])
def test_static_tracks_before_a_static_camera_are_background(shake, rng):
    points = static_scene(rng, 100, 60, shake) + rng.normal(0.0, 0.1, (160, 3, 2))
    found = find_background(points, frame_size=SIZE)
    assert (found.status[:100] == BACKGROUND).all()
    assert (found.status[100:] == 0).all()
    assert found.notes


@pytest.mark.parametrize("shake", [0.0, 1.2])
def test_what_was_background_before_shows_the_shake(shake, rng):
    points = static_scene(rng, 100, 60, shake) + rng.normal(0.0, 0.1, (160, 3, 2))
    earlier = np.arange(160) < 50
    found = find_background(points, frame_size=SIZE, earlier=earlier)
    np.testing.assert_array_equal(found.status, find_background(points, frame_size=SIZE).status)
    path = path_of_background(points[earlier], max_shake=4.0)
    np.testing.assert_allclose(path, camera_path(points, max_shake=4.0), atol=0.1)


def test_what_was_background_before_says_nothing_once_the_camera_moves(rng):
    points = static_scene(rng, 100, 0) + np.arange(3)[:, None] * [15.0, 0.0]
    assert path_of_background(points, max_shake=4.0) is None
    assert path_of_background(points[:5] * 0, max_shake=4.0) is None


def test_a_moving_camera_has_no_background(rng):
    points = static_scene(rng, 100, 60) + np.arange(3)[:, None] * [15.0, 0.0]
    found = find_background(points, frame_size=SIZE)
    assert (found.status == 0).all()
    assert any("moves" in note for note in found.notes)


def test_a_static_object_is_not_background(rng):
    points = np.concatenate(
        [static_scene(rng, 0, 60), static_scene(rng, 60, 0) * 0.1, static_scene(rng, 60, 0)]
    )
    points[120:] += np.arange(3)[:, None] * [15.0, 3.0]
    assert (find_background(points, frame_size=SIZE).status == 0).all()


def test_background_can_be_forced_and_forbidden(rng):
    points = static_scene(rng, 100, 60)
    assert (find_background(points, frame_size=SIZE, remove=False).status == 0).all()
    few = static_scene(rng, 5, 60)
    assert (find_background(few, frame_size=SIZE, remove=True).status[:5] == BACKGROUND).all()
    assert find_background(np.zeros((0, 3, 2)), frame_size=SIZE).status.shape == (0,)


def test_unknown_names_and_invalid_hypotheses():
    scene, sets, _ = segment(SETUPS["fig4"], 0)
    with pytest.raises(UsageError, match="mld"):
        cluster(scene.points, sets, selection="mld")
    with pytest.raises(DataError, match="run hypothesize"):
        cluster(scene.points, [])
    damaged = replace(sets[0], points=sets[0].points[:, :2])
    with pytest.raises(DataError, match="points have shape"):
        cluster(scene.points, [damaged])
    elsewhere = replace(sets[0], frames=(0, 7))
    with pytest.raises(DataError, match="frame 8"):
        cluster(scene.points, [elsewhere])
    empty = replace(sets[0], points=sets[0].points[:0])
    with pytest.raises(DataError, match="no hypotheses"):
        cluster(scene.points, [empty])


def test_every_selection_explains_a_clean_scene():
    for selection in SELECTIONS:
        scene = generate(SETUPS["fig4"], 0)
        sets = hypothesize(scene.points, rng=np.random.default_rng(0))
        found = cluster(scene.points, sets, selection=selection, granularity="surface")
        assert misclassification(found.labels, scene.labels) < 0.25


def test_translations_along_the_optical_axis_come_with_a_warning(rng):
    space = rng.uniform([-1.0, -0.8, 4.0], [1.0, 0.8, 9.0], (80, 3))
    both = []
    for shift in ([0.0, 0.0, 0.0], [0.0, 0.0, -0.5]):
        seen = space + np.array(shift)
        both.append(seen[:, :2] / seen[:, 2:] * CAMERA.fx + [CAMERA.cx, CAMERA.cy])
    points = np.stack(both, axis=1) + rng.normal(0.0, 0.1, (80, 2, 2))
    sets = hypothesize(points, model="translation", camera=CAMERA, count=200, rng=rng)
    found = cluster(points, sets, selection="dominance", motions=1)
    assert any("optical axis" in note for note in found.notes)
    _, _, planar = segment(SETUPS["fig4"], 0)
    assert not any("optical axis" in note for note in planar.notes)
