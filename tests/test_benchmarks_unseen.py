"""The generators and the oracle of benchmarks.unseen keep the laws that they promise."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import unseen
from benchmarks.unseen_bodies import SHAPES, Body, rotation
from benchmarks.unseen_oracle import achievable, affine_body, confusions, misfits
from benchmarks.unseen_outliers import JITTER, KINDS, REACH, jitter, outlier_tracks, shuffled
from benchmarks.unseen_pictures import BODY
from benchmarks.unseen_pictures import KINDS as RENDERED
from benchmarks.unseen_real import (
    as_one_scene,
    cut_at_random,
    first_frames,
    half_of_the_matches,
    in_random_order,
    pair_of_frames,
    thinned_frames,
)
from benchmarks.unseen_rows import Case, Outcome, chosen, judged
from benchmarks.unseen_scenes import Scene, Spec, cut_tracks, generate
from benchmarks.unseen_sequences import (
    SMALLEST,
    moving_bodies,
    random_scene,
    shared_out,
    wider_scene,
)
from benchmarks.unseen_two_views import few_matches, moving_camera
from benchmarks.unseen_two_views import random_scene as random_pair

PICTURE = (640, 480)
SPECS = {
    "affine": Spec(8, (40, 30), noise=0.0, affine=True),
    "perspective": Spec(8, (40, 30, 25), noise=0.0, turn=2.0),
    "two views": Spec(2, (40, 30, 25), noise=0.0, speed=20.0, turn=8.0),
    "moving camera": Spec(5, (80, 30), noise=0.0, moving_camera=True),
    "two views, moving camera": Spec(2, (80, 30), noise=0.0, moving_camera=True, speed=20.0),
    "cut": Spec(9, (40, 30), noise=0.0, visibility="cut"),
    "leaving": Spec(12, (40, 30), noise=0.0, visibility="leaving", speed=25.0),
    "half turn": Spec(2, (40, 30), noise=0.0, roll=180.0, speed=20.0),
    "large picture": Spec(6, (40, 30), noise=0.0, picture=(1920, 1080)),
}


def scene(spec: Spec, seed: int = 0) -> Scene:
    return generate(spec, np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(4))
def test_affine_tracks_of_one_body_have_rank_four(seed: int) -> None:
    for body in scene(SPECS["affine"], seed).bodies:
        singular = np.linalg.svd(body.tracks.reshape(len(body.tracks), -1), compute_uv=False)
        assert singular[4] < 1e-9 * singular[0]


@pytest.mark.parametrize("name", ["perspective", "moving camera", "half turn"])
def test_bodies_before_a_pinhole_camera_move_rigidly(name: str) -> None:
    spec = SPECS[name]
    centre = np.array(spec.picture) / 2
    for body in scene(spec).bodies:
        depth = body.projections[:, 2, :3]
        across = body.projections[:, :2, :3] - centre[:, None] * depth[:, None]
        gram = across @ np.swapaxes(across, 1, 2)
        focal = np.sqrt(gram[:, 0, 0])
        np.testing.assert_allclose(focal, focal[0])
        np.testing.assert_allclose(gram[:, 0, 1] / focal[0] ** 2, 0.0, atol=1e-9)
        np.testing.assert_allclose(gram[:, 1, 1], gram[:, 0, 0])
        np.testing.assert_allclose(np.linalg.norm(depth, axis=1), 1.0)
        np.testing.assert_allclose(np.einsum("fij,fj->fi", across, depth), 0.0, atol=1e-9)


@pytest.mark.parametrize("name", SPECS)
def test_oracle_knows_every_track_of_exact_scenes(name: str) -> None:
    for seed in range(3):
        assert scene(SPECS[name], seed).oracle() == 0.0


def test_oracle_errs_where_labels_are_wrong() -> None:
    found = scene(SPECS["perspective"])
    wrong = np.roll(found.labels, 1)
    assert achievable(found.bodies, found.points, wrong, 0.3)[1] > 0.3


def test_oracle_takes_the_best_threshold() -> None:
    spec = Spec(2, (40, 30), 60, "reach", noise=1.5, speed=15.0)
    found = scene(spec, 3)
    labels, error = achievable(found.bodies, found.points, found.labels, found.noise)
    assert error == pytest.approx(np.mean(labels != found.labels))
    own = misfits(found.bodies, found.points, found.noise)
    nearest, least = own.argmin(axis=0) + 1, own.min(axis=0)
    each = [np.mean(np.where(least <= t, nearest, 0) != found.labels) for t in least]
    assert error == pytest.approx(min(each))
    assert 0 < error < 0.3


def test_oracle_rejects_what_no_motion_explains() -> None:
    found = scene(Spec(10, (40, 30), 50))
    own = misfits(found.bodies, found.points, found.noise).min(axis=0)
    assert own[found.labels == 0].min() > 10 * own[found.labels > 0].max()


def test_one_motion_twice_is_confused() -> None:
    body, other, _ = scene(SPECS["perspective"]).bodies
    halves = [Body(body.points[part], body.projections) for part in (slice(20), slice(20, 40))]
    assert confusions(halves, 0.5).min() > 0.7
    assert confusions([body, other], 0.5).max() <= 0.1
    assert confusions([body], 0.5).max() == 0.0


def test_affine_body_repeats_the_tracks() -> None:
    body = scene(SPECS["affine"]).bodies[0]
    np.testing.assert_allclose(affine_body(body.tracks).tracks, body.tracks, atol=1e-8)


@pytest.mark.parametrize("name", SPECS)
def test_same_seed_same_bytes(name: str) -> None:
    first, again, other = (scene(SPECS[name], seed) for seed in (1, 1, 2))
    assert first.points.tobytes() == again.points.tobytes()
    assert first.labels.tobytes() == again.labels.tobytes()
    assert first.points.tobytes() != other.points.tobytes()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("frames", [2, 6])
def test_share_of_outliers_is_as_asked(kind: str, frames: int) -> None:
    found = scene(Spec(frames, (40, 20), 60, kind, speed=8.0))
    assert np.mean(found.labels == 0) == 0.5
    assert np.bincount(found.labels).tolist() == [60, 40, 20]
    assert found.factors["outliers"] == 0.5
    assert np.isfinite(found.points).all()


def test_noise_is_as_asked() -> None:
    found = scene(Spec(10, (200, 200), noise=0.7))
    assert np.std(found.points - found.exact) == pytest.approx(0.7, rel=0.03)


def test_uniform_noise_contains_no_body() -> None:
    rng = np.random.default_rng(5)
    tracks = outlier_tracks("uniform", 300, np.zeros((1, 8, 2)), PICTURE, 3.0, rng)
    vectors = tracks.reshape(len(tracks), -1)
    for _ in range(200):
        base, *others = vectors[rng.permutation(300)[:4]]
        flat = np.linalg.qr((np.array(others) - base).T)[0]
        away = vectors - base
        residual = np.linalg.norm(away - away @ flat @ flat.T, axis=1) / np.sqrt(13)
        assert (residual < 20).sum() == 4


def test_outliers_stay_within_their_reach() -> None:
    rng = np.random.default_rng(0)
    tracks = outlier_tracks("reach", 200, np.zeros((1, 6, 2)), PICTURE, 3.0, rng)
    assert np.abs(tracks - tracks[:, :1]).max() <= REACH
    assert np.ptp(jitter(200, 6, PICTURE, rng), axis=1).max() <= 2 * JITTER


def test_shuffled_tracks_have_another_order() -> None:
    rng = np.random.default_rng(0)
    frames = np.arange(5.0)
    tracks = np.stack([np.stack([frames, frames + 10 * k], axis=1) for k in range(6)])
    found = shuffled(tracks, 300, rng)
    assert (np.sort(found[..., 0], axis=1) == frames).all()
    assert (found[..., 0] != frames).any(axis=1).all()
    assert (found[..., 0] != frames[::-1]).any(axis=1).all()
    pairs = shuffled(tracks[:, :2], 300, rng)
    assert (pairs[:, 1, 1] - pairs[:, 0, 1] != 1).all()


def test_unknown_kind_of_outliers() -> None:
    with pytest.raises(ValueError, match="expected one of uniform"):
        outlier_tracks("odd", 1, np.zeros((1, 3, 2)), PICTURE, 3.0, np.random.default_rng(0))


@pytest.mark.parametrize("name", SPECS)
def test_tracks_stay_in_the_picture(name: str) -> None:
    found = scene(SPECS[name])
    seen = found.points[np.isfinite(found.points)].reshape(-1, 2)
    assert (seen >= 0).all()
    assert (seen <= np.array(SPECS[name].picture) - 1).all()


def runs(visible: np.ndarray) -> np.ndarray:
    """Number of runs of True in each row."""
    padded = np.pad(visible.astype(int), ((0, 0), (1, 0)))
    return (np.diff(padded, axis=1) == 1).sum(axis=1)


@pytest.mark.parametrize("name", ["cut", "leaving"])
def test_incomplete_tracks_are_whole_runs(name: str) -> None:
    visible = np.isfinite(scene(SPECS[name]).points).all(axis=2)
    assert (runs(visible) == 1).all()
    assert visible.sum(axis=1).min() >= visible.shape[1] / 3
    assert not visible.all()


def test_cut_tracks_of_every_length() -> None:
    tracks = cut_tracks(np.ones((3000, 9, 2)), np.random.default_rng(0))
    length = np.isfinite(tracks).all(axis=2).sum(axis=1)
    share = np.bincount(length, minlength=10)[3:] / 3000
    np.testing.assert_allclose(share, 1 / 7, atol=0.03)


@pytest.mark.parametrize("shape", SHAPES)
def test_shapes_are_about_one_large(shape: str) -> None:
    points = SHAPES[shape](np.random.default_rng(0), 400, np.array([0.0, 0.0, 1.0]))
    assert points.shape == (400, 3)
    assert 0.7 < np.linalg.norm(points, axis=1).max() < 1.8


def test_shapes_look_at_the_camera() -> None:
    view = np.array([0.6, 0.0, 0.8])
    assert (SHAPES["ball"](np.random.default_rng(0), 200, view) @ view <= 0).all()


def test_rotation_is_one() -> None:
    turn = rotation(np.array([0.3, -0.4, 1.2]))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.trace(turn), 1 + 2 * np.cos(1.3))


@pytest.mark.parametrize("seed", range(5))
def test_random_scenes_are_within_their_bounds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    found = random_scene(6, "reach", rng)
    sizes = np.bincount(found.labels)
    assert sizes[1:].min() >= 25
    assert 1 <= len(found.bodies) == len(sizes) - 1 <= 4
    assert sizes[0] <= 0.5 * sizes.sum()
    assert found.noise <= 1
    for wide in (wider_scene("complete", "uniform", rng), random_pair("shuffled", rng)):
        sizes = np.bincount(wide.labels)
        assert sizes[1:].min() >= SMALLEST
        assert len(sizes) <= 7
        assert sizes[0] <= 0.7 * sizes.sum() + 1
        assert 20 <= sizes.sum() <= 2000
        assert 0.1 <= wide.noise <= 2


def test_special_scenes() -> None:
    rng = np.random.default_rng(0)
    assert np.bincount(few_matches(5, rng).labels).tolist() == [0, 5, 5, 5]
    assert moving_camera(rng).factors["camera"] == "moving"


def test_sizes_add_up() -> None:
    rng = np.random.default_rng(0)
    for bodies in range(1, 7):
        sizes = shared_out(100, bodies, 8, rng, static=True)
        assert sum(sizes) == 100
        assert min(sizes) >= 8
        assert sizes[0] >= 25


def test_mismatches_beside_the_bodies_of_the_tests() -> None:
    case = moving_bodies(0.5, np.random.default_rng(0))
    assert np.mean(case.labels == 0) == 0.5
    assert case.oracle < 0.02


def labelled(tracks: int = 60, frames: int = 9) -> Case:
    points = np.arange(tracks * frames * 2.0).reshape(tracks, frames, 2)
    return Case(points, np.repeat([1, 2, 3], [40, 17, 3]), name="numbers")


def test_changes_of_a_sequence() -> None:
    case, rng = labelled(), np.random.default_rng(0)
    assert (first_frames(3)(case, rng).points == case.points[:, :3]).all()
    assert (thinned_frames(5)(case, rng).points == case.points[:, ::2]).all()
    assert len(half_of_the_matches(case, rng).points) == 30
    assert set(as_one_scene(case, rng).labels) == {1}
    assert np.isnan(cut_at_random(case, rng).points).any()
    other = in_random_order(case, rng)
    assert (other.points[np.argsort(other.points[:, 0, 0])] == case.points).all()
    assert (other.labels[np.argsort(other.points[:, 0, 0])] == case.labels).all()


def test_pairs_of_frames_leave_small_motions_open() -> None:
    case, rng = labelled(), np.random.default_rng(0)
    case.points[:5, 4] = np.nan
    pair = pair_of_frames(0, 4)(case, rng)
    assert pair.points.shape == (55, 2, 2)
    assert pair.counts == (2, 3)


def outcome(error: float, motions: tuple[int, int], **changes: object) -> Outcome:
    case = Case(np.zeros((0, 2, 2)), np.zeros(0, dtype=np.int64), **changes)
    return judged(case, 0, "", error, motions, 0.1)


def test_what_is_right() -> None:
    assert outcome(0.04, (2, 2)).right
    assert not outcome(0.06, (2, 2)).right
    assert outcome(0.06, (2, 2), oracle=0.02).right
    assert not outcome(0.0, (2, 3)).right
    assert outcome(1.0, (0, 1), counts=(0, 1)).right
    assert not outcome(0.3, (0, 1)).right


def test_rows_have_names_of_their_own() -> None:
    for rows in unseen.TABLES.values():
        names = [row.name for row in rows]
        assert len(set(names)) == len(names)
    assert [row.name for row in chosen(unseen.TABLES["sequences"], ["two"])] == ["two-bodies"]


def test_table_on_standard_output(capsys: pytest.CaptureFixture[str]) -> None:
    unseen.main(["sequences", "--rows", "two-bodies", "noise-uniform", "--scenes", "2"])
    out = capsys.readouterr().out
    assert "99 % right" in out
    assert "| 20 frames | 1 |" in out
    assert "| noise: uniform |" in out


def test_json_has_every_outcome(capsys: pytest.CaptureFixture[str]) -> None:
    unseen.main(["two-views", "--rows", "few", "--scenes", "3", "--seeds", "4:6", "--json"])
    found = json.loads(capsys.readouterr().out)["two-views"]["few"]
    assert found["runs"] == len(found["outcomes"]) == 6
    assert {one["seed"] for one in found["outcomes"]} == {4, 5}
    assert found["error"] == pytest.approx(np.mean([one["error"] for one in found["outcomes"]]))


def test_spread_between_seeds() -> None:
    row = chosen(unseen.TABLES["sequences"], ["two-bodies"])[0]
    one = [outcome(0.1, (2, 2)), outcome(0.3, (2, 2))]
    assert "| 2 | 20.00% |" in unseen.lines_of(row, one)[0]
    two = [one[0], replace(one[1], seed=1)]
    assert "| 20.00% (10.00% to 30.00%) |" in unseen.lines_of(row, two)[0]


def test_no_data_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("MSSEGMENT_DATA", "/nowhere")
    unseen.main(["sequences", "--rows", "hopkins-given"])
    assert "skipped: no hopkins155: set MSSEGMENT_DATA" in capsys.readouterr().out


def test_unknown_row_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        unseen.main(["--rows", "hopkins-gave"])
    assert caught.value.code == 2
    assert "no row 'hopkins-gave'; the rows are hopkins-given" in capsys.readouterr().err


@pytest.mark.parametrize("kind", RENDERED)
def test_rendered_pictures_are_moved_as_their_maps_say(kind: str) -> None:
    pair = RENDERED[kind](np.random.default_rng(4))
    first, second = (picture.astype(float) for picture in pair.pictures)
    rng = np.random.default_rng(0)
    before = rng.integers([40, 40], [600, 440], (4000, 2))
    rays = np.column_stack([before, np.ones(len(before))])
    layer = pair.layers[before[:, 1], before[:, 0]]
    after = np.einsum("nij,nj->ni", pair.maps[layer], rays)
    after = after[:, :2] / after[:, 2:]
    points = np.stack([before, after], axis=1)
    assert (pair.truth(points) == np.where(pair.moving & (layer == layer.max()), BODY, 1)).all()
    wrong = points + np.array([[0.0, 0.0], [0.0, 3.0]])
    assert (pair.truth(wrong) == 0).all()
    shown = np.rint(after).astype(int)
    shown_inside = ((shown >= 0) & (shown < [640, 480])).all(axis=1)
    (x1, y1), (x2, y2) = before[shown_inside].T, shown[shown_inside].T
    assert np.corrcoef(first[y1, x1], second[y2, x2])[0, 1] > 0.6
