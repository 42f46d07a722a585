"""Laws that hold for every registered motion model, and properties of single models."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment import models
from mssegment.errors import DataError
from mssegment.models import EXAMPLE_CAMERA
from mssegment.models.affine import is_plausible
from mssegment.models.translation import constraint_rows
from mssegment.records import HypothesisSet, Normalization, replace

TRACKS = 30
NAMES = [*models.MODELS, *models.EVIDENCE]


def laws_of(name):
    """The models of a name that the laws are tested on: every rank of a model with ranks."""
    kind = models.class_named(name)
    frames = kind.max_frames or 5
    ranks = (3, 4) if kind.has_ranks else (3,)
    dimensions = (kind.coordinates,) if kind.coordinates else (2, 3, 6)
    return [
        models.make(name, frames=frames, rank=rank, dimension=dimension)
        for dimension in dimensions
        for rank in ranks
        if kind.of_pictures or not kind.has_ranks or rank < dimension
    ]


MODELS = [
    pytest.param(model, id=f"{model.name} on {model.manifold.name}")
    for name in NAMES
    for model in laws_of(name)
]


@pytest.fixture(params=MODELS)
def model(request):
    return request.param


@pytest.fixture
def scene(model, rng):
    points = model.example_tracks(rng, TRACKS)
    normalization = model.normalization(points, EXAMPLE_CAMERA)
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
    # with as many equations as parameters the subset is met exactly
    if model.subset_size * model.residual_dimension == model.parameters:
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


def test_each_motion_may_have_its_own_tracks(model, scene, rng):
    """Tracks [B, n, F, 2] have the fits and residuals of all tracks with the others at weight 0."""
    points, normalization, _ = scene
    observed = model.observe(points + rng.normal(0.0, 0.3, points.shape), normalization)
    count = max(12, model.subset_size + 2)
    own = np.stack([rng.permutation(TRACKS)[:count] for _ in range(5)])
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


def test_residuals_scale_with_the_image(model, scene, rng):
    if model.needs_camera:
        pytest.skip("the size of the image is that of the camera")
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
        # a model that predicts points takes the first view as exact
        first = 0 if model.leaves_parallax_free else 1
        noisy[:, first:] += rng.normal(0.0, sigma, noisy[:, first:].shape)
        residuals = model.residuals(true, model.observe(noisy, normalization), normalization)
        squares.append(model.residual_terms * np.mean(residuals**2))
    assert np.mean(squares) == pytest.approx(model.residual_dimension * sigma**2, rel=0.1)


def test_degenerate_subsets_are_invalid(model, scene):
    if model.subset_size == 1:
        pytest.skip("one track cannot be degenerate")
    _, _, observed = scene
    same = np.repeat(observed[:1], model.subset_size, axis=0)[None]
    _, valid = model.minimal_fit(same)
    assert not valid.any()


def test_a_fit_to_too_few_tracks_does_not_fail(model, scene):
    _, _, observed = scene
    weights = np.zeros((2, TRACKS))
    weights[1, 0] = 1.0
    points, _ = model.fit(observed, weights)
    assert points.shape == (2, *model.manifold.point_shape)


def test_collinear_matches_are_degenerate_for_affine(rng):
    line = np.linspace(0.0, 1.0, 3)[:, None] * [1.0, 2.0]
    _, valid = models.make("affine").minimal_fit(np.stack([line, line + 0.5], axis=1)[None])
    assert not valid.any()


def test_reflections_and_extreme_stretches_are_implausible():
    flip, stretch, half_turn = np.diag([1.0, -1.0]), np.diag([9.0, 1.0]), -np.diag([1.0, 1.1])
    assert not is_plausible(np.stack([flip, stretch, half_turn])).any()
    assert is_plausible(np.array([[0.0, -1.0], [1.0, 0.0]]))


def test_homography_that_reverses_a_quadrangle_is_invalid():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    swapped = square[[0, 2, 1, 3]]
    _, valid = models.make("homography").minimal_fit(np.stack([square, swapped], axis=1)[None])
    assert not valid.any()


def test_translation_satisfies_equation_25(rng):
    model = models.make("translation")
    points = model.example_tracks(rng, TRACKS)
    observed = model.observe(points, model.normalization(points, EXAMPLE_CAMERA))
    fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
    np.testing.assert_allclose(constraint_rows(observed) @ fitted[0], 0.0, atol=1e-12)


def test_translation_requires_a_camera(rng):
    with pytest.raises(ValueError, match="camera"):
        models.make("translation").normalization(rng.normal(size=(5, 2, 2)), None)


def test_a_translation_has_one_direction_along_its_epipolar_lines(rng):
    model = models.make("translation")
    points = model.example_tracks(rng, TRACKS)
    normalization = model.normalization(points, EXAMPLE_CAMERA)
    observed = model.observe(points, normalization)
    fitted, valid = model.fit(observed, np.ones((1, TRACKS)))
    assert valid.all()
    np.testing.assert_allclose(model.residuals(fitted, observed, normalization), 0.0, atol=1e-6)
    # reversed matches are on the same lines, but move towards the epipole
    backwards = observed[:, ::-1]
    moved = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    behind = model.residuals(fitted, backwards, normalization)[0]
    assert (behind > 0.5 * moved).all()
    # their motion is the other orientation of the same point on G(3,1)
    other = model.orientations(fitted)[1:]
    np.testing.assert_allclose(model.residuals(other, backwards, normalization), 0.0, atol=1e-6)
    reversed_fit, _ = model.fit(backwards, np.ones((1, TRACKS)))
    np.testing.assert_allclose(reversed_fit, other, atol=1e-6)


def test_displacements_of_a_translation_are_along_its_epipolar_lines(rng):
    model = models.make("translation")
    points = model.example_tracks(rng, TRACKS)
    normalization = model.normalization(points, EXAMPLE_CAMERA)
    observed = model.observe(points, normalization)
    fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
    moved = np.linalg.norm((observed[:, 1] - observed[:, 0]), axis=1) * normalization.scale
    found = model.displacements(fitted, observed, normalization)
    np.testing.assert_allclose(found[0], moved, rtol=1e-6)
    assert models.make("affine").displacements(fitted, observed, normalization) is None


def test_the_residual_of_a_flat_is_the_distance_in_r4(rng):
    model = models.make("flat")
    subset, other = rng.normal(size=(1, 3, 2, 2)), rng.normal(size=(7, 2, 2))
    found, _ = model.minimal_fit(subset)
    origin, *directions = subset.reshape(3, 4)
    basis, _ = np.linalg.qr((np.array(directions) - origin).T)
    gap = other.reshape(7, 4) - origin
    expected = ((gap - gap @ basis @ basis.T) ** 2).sum(axis=1)
    found_squares = model.ranking_sq_residuals(found, other)[:, 0]
    np.testing.assert_allclose(found_squares, expected, atol=1e-10)


def test_homographies_are_ranked_by_transfer_errors_both_ways(rng):
    model = models.make("homography")
    points = model.example_tracks(rng, TRACKS) + rng.normal(0.0, 1.0, (TRACKS, 2, 2))
    observed = model.observe(points, model.normalization(points))
    fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
    unit = Normalization(np.zeros((2, 2)), 1.0)
    there = model.residuals(fitted, observed, unit)
    back = model.residuals(np.linalg.inv(fitted), observed[:, ::-1], unit)
    np.testing.assert_allclose(
        model.ranking_sq_residuals(fitted, observed).T, there**2 + back**2, rtol=1e-9
    )


def test_residuals_rank_exact_tracks_first(model, scene, rng):
    _, _, observed = scene
    mixed = observed.copy()
    mixed[TRACKS // 2 :] = observed[rng.permutation(TRACKS)[: TRACKS - TRACKS // 2]]
    last = mixed[TRACKS // 2 :, -1]
    last += rng.uniform(0.3, 0.6, last.shape)
    fitted, _ = model.fit(observed, np.ones((1, TRACKS)))
    squares = model.ranking_sq_residuals(fitted, mixed)
    assert squares.shape == (TRACKS, 1)
    assert squares[: TRACKS // 2].max() < 1e-9
    assert np.median(squares[TRACKS // 2 :]) > 1e-6


def test_model_of_a_set(model, scene, rng):
    _, normalization, observed = scene
    chosen = subsets(model, rng, 5)
    found, _ = model.minimal_fit(observed[chosen])
    entry = HypothesisSet(
        model.name, model.manifold.name, tuple(range(model.frames)), normalization, chosen, found
    )
    again = models.of_set(entry)
    wrong_frames = 1 if model.min_frames > 1 else 2
    assert type(again) is type(model)
    assert again.manifold.name == model.manifold.name
    for wrong, message in (
        ({"model": "sphere"}, "no model is called 'sphere'"),
        ({"frames": (0,) * wrong_frames}, f"does not accept {wrong_frames} frames"),
        ({"manifold": "euclidean(3)"}, "belongs to manifold"),
        ({"points": found[:, :1]}, "points have shape"),
    ):
        with pytest.raises(DataError, match=message):
            models.of_set(replace(entry, **wrong))


def test_auto_selects_models_that_accept_the_frames():
    assert models.automatic(2) == ("affine", "homography")
    assert models.automatic(3) == models.automatic(40) == ("factorization",)
    for frames in (2, 3, 40):
        assert all(models.MODELS[name].accepts(frames) for name in models.automatic(frames))


def test_registries_load_the_models_they_name():
    for name in NAMES:
        kind = models.class_named(name)
        assert kind.name == name
        assert kind.purpose


def test_remarks_on_motions_of_several_ranks(rng: np.random.Generator) -> None:
    kinds = [models.make("factorization", frames=5, rank=rank) for rank in (3, 4, 3)]
    points = [kind.manifold.random_point(rng, 1)[0] for kind in kinds]
    assert models.remarks(kinds, points) == ()
