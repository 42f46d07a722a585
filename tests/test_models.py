"""Laws of every motion model, over the registry; and facts of each one."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment import models
from mssegment.geometry import epipolar
from mssegment.models.affine import is_plausible
from mssegment.models.translation import constraint_rows, sampson
from mssegment.preprocessing.rotation_compensation import find_rotation
from mssegment.records import Camera

CAMERA = Camera(800.0, 780.0, 320.0, 240.0)
TRACKS = 30


def exact_tracks(model, rng):
    """Tracks of one motion, without noise: [P, F, 2] pixels."""
    x = rng.uniform([50.0, 50.0], [300.0, 250.0], (TRACKS, 2))
    if model.name == "affine":
        return np.stack([x, x @ np.array([[1.1, -0.1], [0.15, 0.95]]) + [12.0, -7.0]], axis=1)
    if model.name == "homography":
        y = np.c_[x, np.ones(TRACKS)] @ np.array(
            [[1.1, 0.1, 2e-4], [-0.1, 0.9, -1e-4], [5.0, 8.0, 1.0]]
        )
        return np.stack([x, y[:, :2] / y[:, 2:]], axis=1)
    if model.name == "translation":
        space = np.c_[(x - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones(TRACKS)]
        space *= rng.uniform(3.0, 5.0, (TRACKS, 1))
        both = [space, space + np.array([0.12, -0.08, 0.2])]
        return np.stack(
            [s[:, :2] / s[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy] for s in both],
            axis=1,
        )
    shape = rng.uniform(-60.0, 60.0, (TRACKS, model.rank - 1))
    return np.stack(
        [
            shape @ rng.normal(size=(model.rank - 1, 2)) + rng.uniform(100.0, 400.0, 2)
            for _ in range(model.frames)
        ],
        axis=1,
    )


MODELS = [
    pytest.param(lambda n=name: models.make(n, frames=2 if n != "factorization" else 5), id=name)
    for name in models.MODELS
] + [pytest.param(lambda: models.make("factorization", frames=4, rank=4), id="rank 4")]


@pytest.fixture(params=MODELS)
def model(request):
    return request.param()


@pytest.fixture
def scene(model, rng):
    points = exact_tracks(model, rng)
    normalization = model.normalization(points, CAMERA)
    return points, normalization, model.observe(points, normalization)


def subsets(model, rng, count=60):
    return np.stack([rng.choice(TRACKS, model.subset_size, replace=False) for _ in range(count)])


def test_an_elemental_subset_of_exact_tracks_explains_them_all(model, scene, rng):
    _, normalization, observed = scene
    points, valid = model.minimal_fit(observed[subsets(model, rng)])
    assert valid.mean() > 0.5
    assert model.residuals(points[valid], observed, normalization).max() < 1e-6


def test_least_squares_of_exact_tracks_is_exact(model, scene):
    _, normalization, observed = scene
    points, valid = model.fit(observed, np.ones((2, TRACKS)))
    assert valid.all()
    assert model.residuals(points, observed, normalization).max() < 1e-6
    assert model.algebraic_residuals(points, observed, normalization).max() < 1e-6


def test_fits_are_points_of_the_manifold(model, scene, rng):
    _, _, observed = scene
    model.manifold.check_point(model.fit(observed, np.ones((1, TRACKS)))[0])
    points, valid = model.minimal_fit(observed[subsets(model, rng)])
    model.manifold.check_point(points[valid])
    assert points.shape[1:] == model.manifold.point_shape
    assert model.parameters == model.manifold.dim


def test_minimal_fit_is_least_squares_on_the_subset(model, scene, rng):
    points, normalization, _ = scene
    observed = model.observe(points + rng.normal(0.0, 0.3, points.shape), normalization)
    chosen = subsets(model, rng)
    weights = np.zeros((len(chosen), TRACKS))
    np.put_along_axis(weights, chosen, 1.0, axis=1)
    minimal, valid = model.minimal_fit(observed[chosen])
    fitted, also = model.fit(observed, weights)
    both = valid & also
    assert both.mean() > 0.4
    own = np.take_along_axis(
        model.residuals(minimal[both], observed, normalization), chosen[both], axis=1
    )
    assert own.max() < 1e-5
    squared = model.manifold.dist(minimal[both], fitted[both]) ** 2
    assert np.median(squared) < 1e-9


def test_no_motion_nearby_has_smaller_weighted_residuals(model, scene, rng):
    points, normalization, _ = scene
    observed = model.observe(points + rng.normal(0.0, 1.0, points.shape), normalization)
    weights = rng.uniform(0.2, 1.0, (1, TRACKS))
    best, _ = model.fit(observed, weights)
    cost = (weights * model.residuals(best, observed, normalization) ** 2).sum()
    around = np.repeat(best, 40, axis=0)
    tangents = model.manifold.random_tangent(around, rng)
    for step in (1e-3, 1e-2):
        moved = model.manifold.exp(around, step * tangents)
        costs = (weights * model.residuals(moved, observed, normalization) ** 2).sum(axis=1)
        assert (costs >= cost * (1 - 1e-6)).all()


def test_tracks_without_weight_do_not_matter(model, scene, rng):
    points, normalization, _ = scene
    points = points.copy()
    points[:8] = rng.uniform(0.0, 500.0, points[:8].shape)
    observed = model.observe(points, normalization)
    weights = np.ones((1, TRACKS))
    weights[:, :8] = 0.0
    fitted, _ = model.fit(observed, weights)
    assert model.residuals(fitted, observed, normalization)[0, 8:].max() < 1e-6


def test_every_motion_may_have_tracks_of_its_own(model, scene, rng):
    """Fits to and residuals of [B, n, F, 2] are those of all tracks, the others without weight."""
    points, normalization, _ = scene
    observed = model.observe(points + rng.normal(0.0, 0.3, points.shape), normalization)
    own = np.stack([rng.permutation(TRACKS)[:12] for _ in range(5)])
    few, weights = rng.uniform(0.0, 1.0, own.shape), np.zeros((5, TRACKS))
    few[:, 0] = 0.0
    np.put_along_axis(weights, own, few, axis=1)
    for fitted, valid in (model.fit(observed, weights), model.fit(observed[own], few)):
        assert valid.all()
        whole = model.residuals(fitted, observed, normalization)
        expected = np.take_along_axis(whole, own, axis=1)
        found = model.residuals(fitted, observed[own], normalization)
        np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9)
    one, other = model.fit(observed, weights)[0], model.fit(observed[own], few)[0]
    np.testing.assert_allclose(model.manifold.dist(one, other), 0.0, atol=1e-7)


def test_order_of_tracks_does_not_matter(model, scene, rng):
    points, normalization, _ = scene
    observed = model.observe(points + rng.normal(0.0, 0.5, points.shape), normalization)
    order = rng.permutation(TRACKS)
    one = model.residuals(model.fit(observed, np.ones((1, TRACKS)))[0], observed, normalization)
    shuffled = observed[order]
    two = model.residuals(model.fit(shuffled, np.ones((1, TRACKS)))[0], shuffled, normalization)
    np.testing.assert_allclose(two, one[:, order], rtol=1e-5, atol=1e-7)


def test_residuals_are_pixels_whatever_the_size_of_the_picture(model, scene, rng):
    if model.needs_camera:
        pytest.skip("a camera's picture has its size")
    points, _, _ = scene
    points = points + rng.normal(0.0, 0.5, points.shape)
    rows = []
    for factor in (1.0, 3.0):
        normalization = model.normalization(factor * points, None)
        observed = model.observe(factor * points, normalization)
        fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
        rows.append(model.residuals(fitted, observed, normalization) / factor)
    np.testing.assert_allclose(rows[1], rows[0], rtol=1e-5, atol=1e-8)


def test_noise_has_the_stated_dimension(model, scene, rng):
    points, normalization, observed = scene
    true, _ = model.fit(observed, np.ones((1, TRACKS)))
    sigma, squares = 0.01, []
    for _ in range(60):
        noisy = points.copy()
        # a model that takes the first view as given has the noise of the second
        first = 0 if model.name in ("translation", "factorization") else 1
        noisy[:, first:] += rng.normal(0.0, sigma, noisy[:, first:].shape)
        residuals = model.residuals(true, model.observe(noisy, normalization), normalization)
        squares.append(model.residual_terms * np.mean(residuals**2))
    assert np.mean(squares) == pytest.approx(model.residual_dimension * sigma**2, rel=0.1)


def test_degenerate_subsets_are_unsound(model, scene):
    _, _, observed = scene
    same = np.repeat(observed[:1], model.subset_size, axis=0)[None]
    _, valid = model.minimal_fit(same)
    assert not valid.any()


def test_a_fit_to_too_few_tracks_is_no_failure(model, scene):
    _, _, observed = scene
    weights = np.zeros((2, TRACKS))
    weights[1, 0] = 1.0
    points, _ = model.fit(observed, weights)
    assert points.shape == (2, *model.manifold.point_shape)


def test_collinear_matches_make_no_affine_motion(rng):
    line = np.linspace(0.0, 1.0, 3)[:, None] * [1.0, 2.0]
    _, valid = models.make("affine").minimal_fit(np.stack([line, line + 0.5], axis=1)[None])
    assert not valid.any()


def test_reflections_and_wild_stretches_are_implausible():
    flip, wild, half_turn = np.diag([1.0, -1.0]), np.diag([9.0, 1.0]), -np.diag([1.0, 1.1])
    assert not is_plausible(np.stack([flip, wild, half_turn])).any()
    assert is_plausible(np.array([[0.0, -1.0], [1.0, 0.0]]))


def test_homography_that_turns_a_quadrangle_inside_out_is_unsound():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    swapped = square[[0, 2, 1, 3]]
    _, valid = models.make("homography").minimal_fit(np.stack([square, swapped], axis=1)[None])
    assert not valid.any()


def test_homography_transfer_error_both_ways(rng):
    model = models.make("homography")
    points = exact_tracks(model, rng)
    normalization = model.normalization(points, None)
    observed = model.observe(points, normalization)
    fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
    assert model.symmetric_residuals(fitted, observed, normalization).max() < 1e-6


def test_translation_obeys_equation_25(rng):
    model = models.make("translation")
    points = exact_tracks(model, rng)
    observed = model.observe(points, model.normalization(points, CAMERA))
    t = np.array([0.12, -0.08, 0.2])
    np.testing.assert_allclose(constraint_rows(observed) @ t, 0.0, atol=1e-12)


def test_sampson_derivatives_against_finite_differences(rng):
    model = models.make("translation")
    points = exact_tracks(model, rng) + rng.normal(0.0, 2.0, (TRACKS, 2, 2))
    observed = model.observe(points, model.normalization(points, CAMERA))
    t = np.array([[0.3, -0.4, 0.866]])
    _, jacobian = sampson(t, observed)
    for i in range(3):
        step = 1e-6 * np.eye(3)[i]
        slope = (sampson(t + step, observed)[0] - sampson(t - step, observed)[0]) / 2e-6
        np.testing.assert_allclose(jacobian[..., i], slope, atol=1e-6)


def test_translation_without_camera_says_so(rng):
    with pytest.raises(ValueError, match="camera"):
        models.make("translation").normalization(rng.normal(size=(5, 2, 2)), None)


def turned_view(rng, degrees):
    """Matches of a translating camera that also turns, most static, some of another body."""
    x = rng.uniform([0.0, 0.0], [640.0, 480.0], (200, 2))
    space = np.c_[(x - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy], np.ones(200)]
    space *= rng.uniform(4.0, 20.0, (200, 1))
    angle = np.deg2rad(degrees)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    moved = space + np.array([0.1, 0.02, 0.5])
    moved[:40] += [0.4, 0.0, 0.0]
    moved = moved @ turn.T
    y = moved[:, :2] / moved[:, 2:] * [CAMERA.fx, CAMERA.fy] + [CAMERA.cx, CAMERA.cy]
    return np.stack([x, y], axis=1) + rng.normal(0.0, 0.1, (200, 2, 2)), turn


def test_the_rotation_of_the_camera_is_found(rng):
    points, turn = turned_view(rng, 0.5)
    found = find_rotation(points, CAMERA, rng)
    assert found is not None
    # it turns the second view back
    np.testing.assert_allclose(found.rotation @ turn, np.eye(3), atol=1e-3)
    assert found.share > 0.7


def test_a_camera_that_only_translates_is_left_alone(rng):
    points, _ = turned_view(rng, 0.0)
    found = find_rotation(points, CAMERA, rng)
    assert found is None or found.degrees < 0.05


def test_mismatches_have_no_rotation(rng):
    assert find_rotation(rng.uniform(0.0, 480.0, (60, 2, 2)), CAMERA, rng) is None
    assert find_rotation(rng.uniform(0.0, 480.0, (4, 2, 2)), CAMERA, rng) is None


def test_a_translation_goes_one_way_along_its_epipolar_lines(rng):
    model = models.make("translation")
    points = exact_tracks(model, rng)
    normalization = model.normalization(points, CAMERA)
    observed = model.observe(points, normalization)
    fitted, valid = model.fit(observed, np.ones((1, TRACKS)))
    assert valid.all()
    np.testing.assert_allclose(model.residuals(fitted, observed, normalization), 0.0, atol=1e-6)
    # the same matches backwards lie on the same lines, but move towards the epipole
    backwards = observed[:, ::-1]
    moved = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    behind = model.residuals(fitted, backwards, normalization)[0]
    assert (behind > 0.5 * moved).all()
    # the other orientation of the same line in space is their motion
    other = model.orientations(fitted)[1:]
    np.testing.assert_allclose(model.residuals(other, backwards, normalization), 0.0, atol=1e-6)
    turned, _ = model.fit(backwards, np.ones((1, TRACKS)))
    np.testing.assert_allclose(turned, other, atol=1e-6)


def test_displacements_are_what_a_translation_leaves_free(rng):
    model = models.make("translation")
    points = exact_tracks(model, rng)
    normalization = model.normalization(points, CAMERA)
    observed = model.observe(points, normalization)
    fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
    moved = np.linalg.norm((observed[:, 1] - observed[:, 0]), axis=1) * normalization.scale
    found = model.displacements(fitted, observed, normalization)
    np.testing.assert_allclose(found[0], moved, rtol=1e-6)
    assert models.make("affine").displacements(fitted, observed, normalization) is None


def test_linearized_distances_agree_with_finite_differences(rng):
    first = np.c_[rng.uniform(-0.5, 0.5, (6, 2)), np.ones(6)]
    directions = rng.normal(size=(1, 3))
    directions /= np.linalg.norm(directions)
    # near the constraint, where the gradient in the denominator does not matter
    space = first * rng.uniform(3.0, 6.0, (6, 1)) + 0.3 * directions
    second = space / space[:, 2:]
    still = np.eye(3)[None]
    error, jacobian = epipolar.linearized(directions, still, first, second)
    np.testing.assert_allclose(error, 0.0, atol=1e-12)
    for k in range(5):
        change = np.zeros((1, 5))
        change[0, k] = 1e-6
        ahead = epipolar.linearized(*epipolar.step(directions, still, change), first, second)[0]
        back = epipolar.linearized(*epipolar.step(directions, still, -change), first, second)[0]
        np.testing.assert_allclose((ahead - back) / 2e-6, jacobian[..., k], rtol=1e-5, atol=1e-7)


def test_rotations_are_orthogonal_and_have_their_angle(rng):
    vectors = rng.normal(size=(20, 3)) * 0.3
    matrices = epipolar.rotation(vectors)
    np.testing.assert_allclose(
        matrices @ np.swapaxes(matrices, 1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12
    )
    angles = np.degrees(np.linalg.norm(vectors, axis=1))
    np.testing.assert_allclose(epipolar.degrees(matrices), angles, rtol=1e-9)
    np.testing.assert_allclose((matrices @ vectors[..., None])[..., 0], vectors, atol=1e-12)


def test_the_rotation_is_found_beside_a_large_moving_body(rng):
    # 45 % of the matches are a body with a translation of its own
    space = rng.uniform([-4.0, -2.0, 1.0], [4.0, 2.0, 1.0], (220, 3)) * rng.uniform(4, 20, (220, 1))
    space[:100] = rng.uniform([1.0, -0.5, 7.0], [3.0, 0.5, 8.0], (100, 3))
    turn = epipolar.rotation(np.radians([0.1, 0.5, -0.1]))
    moved = space + np.array([0.02, 0.01, 0.6])
    moved[:100] += [-0.35, 0.02, -0.2]
    focal, centre = np.array([CAMERA.fx, CAMERA.fy]), np.array([CAMERA.cx, CAMERA.cy])
    both = [s[:, :2] / s[:, 2:] * focal + centre for s in (space, moved @ turn.T)]
    points = np.stack(both, axis=1) + rng.normal(0.0, 0.1, (220, 2, 2))
    found = find_rotation(points, CAMERA, rng)
    assert found is not None
    assert epipolar.degrees(found.rotation @ turn) < 0.03
