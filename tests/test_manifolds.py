"""The laws of manifolds, by trait, over the whole registry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mssegment import manifolds
from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import (
    MANIFOLDS,
    SE2,
    SE3,
    SL3,
    AffineGroup,
    Euclidean,
    Grassmann,
    Manifold,
    from_name,
)

NAMES = [name for family in MANIFOLDS.values() for name in family.examples]


@pytest.fixture(params=NAMES)
def manifold(request: pytest.FixtureRequest) -> Manifold:
    return from_name(request.param)


def shaped(numbers: np.ndarray, manifold: Manifold) -> np.ndarray:
    return numbers.reshape(numbers.shape + (1,) * len(manifold.point_shape))


def close_pair(manifold: Manifold, rng, size=20, length=0.5):
    """Points x and, ``length`` away from each, y."""
    x = manifold.random_point(rng, size)
    return x, manifold.exp(x, length * manifold.random_tangent(x, rng))


def test_name_is_the_inverse_of_from_name(manifold):
    assert from_name(manifold.name).name == manifold.name
    assert type(from_name(manifold.name)) is type(manifold)
    assert manifold.name in repr(manifold)


def test_every_family_is_exported_and_has_examples():
    for name, family in MANIFOLDS.items():
        assert getattr(manifolds, family.__name__) is family
        assert family.examples
        assert all(example.startswith(name.removesuffix(")")) for example in family.examples)


def test_documented_constructors_give_the_names_of_the_registry():
    built = [Euclidean(3), Grassmann(10, 3), AffineGroup(2), AffineGroup(exact=True)]
    built += [SL3(), SL3(exact=True), SE2(), SE2(exact=True), SE3(), SE3(exact=True)]
    for manifold in built:
        same = from_name(manifold.name)
        assert type(same) is type(manifold)
        assert vars(same) == vars(manifold)


@pytest.mark.parametrize(
    "build", [lambda: Euclidean(0), lambda: Grassmann(3, 3), lambda: AffineGroup(3)]
)
def test_arguments_without_a_manifold_are_refused(build):
    with pytest.raises(ConfigurationError):
        build()


def test_random_points_are_points(manifold, rng):
    x = manifold.random_point(rng, 7)
    assert x.shape == (7, *manifold.point_shape)
    manifold.check_point(x)
    manifold.check_point(x[0])


def test_projection_gives_points_and_keeps_them(manifold, rng):
    x = manifold.random_point(rng, 7)
    manifold.check_point(manifold.project(x + 0.01 * rng.standard_normal(x.shape)))
    np.testing.assert_allclose(manifold.project(x), x, atol=1e-12)


def test_tangents_are_a_space_of_the_stated_dimension(manifold, rng):
    x = manifold.random_point(rng, 1)
    many = np.repeat(x, 3 * manifold.dim + 5, axis=0)
    tangents = manifold.project_tangent(many, rng.standard_normal(many.shape))
    np.testing.assert_allclose(manifold.project_tangent(many, tangents), tangents, atol=1e-12)
    assert np.linalg.matrix_rank(tangents.reshape(len(many), -1), tol=1e-9) == manifold.dim


def test_random_tangents_have_unit_norm(manifold, rng):
    x = manifold.random_point(rng, 9)
    v = manifold.random_tangent(x, rng)
    np.testing.assert_allclose(manifold.norm(x, v), 1.0, atol=1e-12)
    np.testing.assert_allclose(manifold.inner(x, v, -2.0 * v), -2.0, atol=1e-12)


def test_log_inverts_exp(manifold, rng):
    x = manifold.random_point(rng, 20)
    v = 0.7 * manifold.random_tangent(x, rng)
    np.testing.assert_allclose(manifold.log(x, manifold.exp(x, v)), v, atol=1e-10)


def test_exp_inverts_log(manifold, rng):
    x, y = close_pair(manifold, rng)
    arrived = manifold.exp(x, manifold.log(x, y))
    manifold.check_point(arrived, tolerance=1e-10)
    np.testing.assert_allclose(manifold.dist(arrived, y), 0.0, atol=1e-7)


def test_exp_of_zero_stays(manifold, rng):
    x = manifold.random_point(rng, 5)
    np.testing.assert_allclose(manifold.exp(x, np.zeros_like(x)), x, atol=1e-12)


def test_exp_leaves_with_its_velocity(manifold, rng):
    x = manifold.random_point(rng, 5)
    v = manifold.random_tangent(x, rng)
    t = 1e-5
    velocity = (manifold.exp(x, t * v) - manifold.exp(x, -t * v)) / (2 * t)
    np.testing.assert_allclose(velocity, v, atol=1e-8)


def test_long_geodesics_stay_on_the_manifold(manifold, rng):
    x = manifold.random_point(rng, 5)
    manifold.check_point(manifold.exp(x, 6.0 * manifold.random_tangent(x, rng)))


def test_exp_is_a_one_parameter_flow(manifold, rng):
    x = manifold.random_point(rng, 5)
    v = 0.5 * manifold.random_tangent(x, rng)
    half = manifold.exp(x, v)
    back = manifold.log(half, x)
    np.testing.assert_allclose(
        manifold.dist(manifold.exp(half, -back), manifold.exp(x, 2 * v)), 0, atol=1e-7
    )


def test_distance_is_symmetric_and_separates(manifold, rng):
    x, y = close_pair(manifold, rng)
    np.testing.assert_allclose(manifold.dist(x, y), manifold.dist(y, x), atol=1e-10)
    np.testing.assert_allclose(manifold.dist(x, x), 0, atol=1e-7)
    assert (manifold.dist(x, y) > 0.1).all()


def far_points(manifold: Manifold, rng, size):
    """Random points, moved by up to 3 in a random direction."""
    x = manifold.random_point(rng, size)
    lengths = shaped(rng.uniform(0.0, 3.0, size), manifold)
    return manifold.exp(x, lengths * manifold.random_tangent(x, rng))


def test_triangle_inequality_where_and_only_where_it_is_a_metric(manifold, rng):
    x, y, z = (far_points(manifold, rng, 4000) for _ in range(3))
    with np.errstate(invalid="ignore"):
        slack = manifold.dist(x, y) + manifold.dist(y, z) - manifold.dist(x, z)
    slack = slack[~np.isnan(slack)]
    assert (slack.min() >= -1e-9) == manifold.is_metric


def test_distance_is_geodesic_where_and_only_where_it_claims_to_be(manifold, rng):
    """Then it is the length of the logarithm, which is -1/2 times the gradient of its square."""
    x, y = close_pair(manifold, rng, length=0.8)
    log = manifold.log(x, y)
    length_is_distance = np.allclose(manifold.dist(x, y), manifold.norm(x, log), rtol=1e-9)
    u = manifold.random_tangent(x, rng)
    slope = -0.5 * directional_derivative(manifold, x, y, u)
    log_is_gradient = np.allclose(manifold.inner(x, log, u), slope, atol=1e-7)
    assert (length_is_distance and log_is_gradient) == manifold.dist_is_geodesic
    assert (manifold.dist(x, y) <= manifold.norm(x, log) + 1e-9).all()


def test_distances_are_bounded_where_and_only_where_it_is_compact(manifold, rng):
    x = manifold.random_point(rng, 40)
    widest = manifold.dist(x, manifold.random_point(rng, 40)).max()
    away = manifold.dist(x, manifold.exp(x, 2.0 * widest * manifold.random_tangent(x, rng)))
    assert manifold.is_compact == bool((away < 1.5 * widest).all())


def test_basis_does_not_matter(manifold, rng):
    if len(manifold.point_shape) != 2:
        pytest.skip("points are not matrices")
    x, y = close_pair(manifold, rng)
    k = x.shape[-1]
    if not manifold.basis_free:
        q = np.linalg.qr(rng.standard_normal((20, k, k)))[0] * rng.choice([-1, 1], (20, 1, 1))
        try:
            manifold.check_point(x @ q)
        except DataError:
            return
        assert (manifold.dist(x @ q, x) > 1e-3).any()
        return
    q, r = (np.linalg.qr(rng.standard_normal((20, k, k)))[0] for _ in range(2))
    np.testing.assert_allclose(manifold.dist(x @ q, y @ r), manifold.dist(x, y), atol=1e-12)
    v = manifold.random_tangent(x, rng)
    np.testing.assert_allclose(
        manifold.dist(manifold.exp(x @ q, v @ q), manifold.exp(x, v)), 0, atol=1e-7
    )
    np.testing.assert_allclose(
        manifold.neg_half_grad_sq_dist(x @ q, y @ r), manifold.neg_half_grad_sq_dist(x, y) @ q
    )


def test_left_translation_does_not_matter(manifold, rng):
    shape = manifold.point_shape
    if len(shape) != 2 or shape[0] != shape[1]:
        pytest.skip("points are not square matrices")
    x, y = close_pair(manifold, rng)
    g = manifold.random_point(rng, 1)
    if not manifold.left_invariant:
        with pytest.raises(DataError):
            manifold.check_point(g @ x)
        return
    np.testing.assert_allclose(manifold.dist(g @ x, g @ y), manifold.dist(x, y), rtol=1e-8)
    np.testing.assert_allclose(
        manifold.neg_half_grad_sq_dist(g @ x, g @ y),
        g @ manifold.neg_half_grad_sq_dist(x, y),
        atol=1e-9,
    )


def directional_derivative(manifold, x, y, u, t=1e-5):
    ahead, behind = manifold.exp(x, t * u), manifold.exp(x, -t * u)
    return (manifold.dist(ahead, y) ** 2 - manifold.dist(behind, y) ** 2) / (2 * t)


def test_half_gradient_is_exact_where_and_only_where_it_claims_to_be(manifold, rng):
    """(1), with (13) or the exact gradient, against finite differences."""
    x, y = close_pair(manifold, rng, length=0.8)
    u = manifold.random_tangent(x, rng)
    expected = -0.5 * directional_derivative(manifold, x, y, u)
    found = manifold.inner(x, manifold.neg_half_grad_sq_dist(x, y), u)
    assert np.allclose(found, expected, atol=1e-7) == manifold.exact_gradient


def test_half_gradient_is_right_to_first_order(manifold, rng):
    """(21): the relative error goes to 0 at least as fast as the distance."""
    x = manifold.random_point(rng, 30)
    v, u = manifold.random_tangent(x, rng), manifold.random_tangent(x, rng)
    errors = []
    for length in (0.2, 0.02):
        y = manifold.exp(x, length * v)
        expected = -0.5 * directional_derivative(manifold, x, y, u, t=1e-4 * length)
        found = manifold.inner(x, manifold.neg_half_grad_sq_dist(x, y), u)
        errors.append(np.abs(found - expected).max() / length)
    assert errors[0] < 0.3
    assert errors[1] < 0.15 * errors[0] + 1e-6


def test_pairwise_agrees_with_pairs(manifold, rng):
    x, y = manifold.random_point(rng, 4), manifold.random_point(rng, 9)
    each = manifold.dist(x[:, None], y[None]) ** 2
    np.testing.assert_allclose(manifold.pairwise_dist2(x, y), each, rtol=1e-9, atol=1e-12)


def test_mean_tangent_is_the_weighted_mean_of_half_gradients(manifold, rng):
    x, y = manifold.random_point(rng, 4), manifold.random_point(rng, 9)
    w = rng.uniform(size=(4, 9))
    w[2] = 0.0
    pull = manifold.neg_half_grad_sq_dist(x[:, None], y[None])
    expected = np.einsum("mn,mn...->m...", w, pull) / shaped(
        w.sum(axis=1) + (w.sum(axis=1) == 0), manifold
    )
    np.testing.assert_allclose(manifold.mean_tangent(x, y, w), expected, atol=1e-11)


def test_prepared_points_agree_with_the_default(manifold, rng):
    x, y = manifold.random_point(rng, 4), manifold.random_point(rng, 9)
    own, default = (
        manifold.prepare(y, 0.3).block(x),
        Manifold.prepare(manifold, y, 0.3).block(x),
    )
    np.testing.assert_allclose(own.scaled_sq_dist, default.scaled_sq_dist, rtol=1e-9, atol=1e-9)
    w = rng.uniform(size=(4, 9))
    for a, b in zip(own.weighted_sum(w), default.weighted_sum(w), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


def test_nearest_prepared_points_are_those_of_all_pairs(manifold, rng):
    """Also where most distances are not computed, and where points coincide."""
    y = manifold.random_point(rng, 40)
    y = np.concatenate([y, manifold.exp(y, 0.01 * manifold.random_tangent(y, rng)), y[:5]])
    prepared = manifold.prepare(y, 0.3)
    for count in (1, 7, 80):
        found = np.sort(prepared.nearest(y[:9], count), axis=1)
        whole = np.sort(prepared.block(y[:9]).scaled_sq_dist, axis=1)[:, : count + 1]
        np.testing.assert_allclose(found, whole, rtol=1e-9, atol=1e-12)


def test_single_precision_is_near(manifold, rng):
    x, y = manifold.random_point(rng, 4), manifold.random_point(rng, 9)
    near, exact = (
        manifold.prepare(y, 1.0, precise=False).block(x).scaled_sq_dist,
        manifold.prepare(y).block(x).scaled_sq_dist,
    )
    np.testing.assert_allclose(near, exact, rtol=1e-4, atol=1e-5)


def test_one_point_without_batch_axes(manifold, rng):
    x, y = close_pair(manifold, rng, size=1)
    assert manifold.exp(x[0], manifold.log(x[0], y[0])).shape == manifold.point_shape
    np.testing.assert_allclose(manifold.dist(x[0], y[0]), manifold.dist(x, y)[0], atol=1e-14)
    np.testing.assert_allclose(
        manifold.neg_half_grad_sq_dist(x[0], y[0]), manifold.neg_half_grad_sq_dist(x, y)[0]
    )


def test_no_points_at_all(manifold):
    none = np.zeros((0, *manifold.point_shape))
    assert manifold.dist(none, none).shape == (0,)
    assert manifold.exp(none, none).shape == none.shape
    assert manifold.pairwise_dist2(none, none).shape == (0, 0)


def test_wrong_points_are_named(manifold, rng):
    x = manifold.random_point(rng, 3)
    with pytest.raises(DataError, match="shape"):
        manifold.check_point(np.zeros((3, 1, 2, 5)))
    x[1] = np.nan
    with pytest.raises(DataError, match=r"point 1 .*not finite"):
        manifold.check_point(x)
    if manifold.dim < np.prod(manifold.point_shape):
        x[1] = 7.0
        with pytest.raises(DataError, match="point 1 is not on"):
            manifold.check_point(x)


def test_lists_and_integers_are_numbers(manifold, rng):
    """Nothing is concatenated, and no small integer wraps."""
    x, y = close_pair(manifold, rng, size=3)
    v = manifold.random_tangent(x, rng)
    for method, arrays in (
        (manifold.exp, (x, v)),
        (manifold.log, (x, y)),
        (manifold.dist, (x, y)),
        (manifold.inner, (x, v, v)),
        (manifold.norm, (x, v)),
        (manifold.neg_half_grad_sq_dist, (x, y)),
        (manifold.project, (x,)),
        (manifold.project_tangent, (x, v)),
        (manifold.constraint_violation, (x,)),
        (manifold.pairwise_dist2, (x, y)),
    ):
        np.testing.assert_array_equal(method(*(each.tolist() for each in arrays)), method(*arrays))
    assert (Euclidean(1).log(np.uint8([2]), np.uint8([1])) == -1).all()
    assert (Euclidean(2).exp([1, 2], [0.5, 0.5]) == [1.5, 2.5]).all()


@pytest.mark.parametrize("companion", [1e-8, 3.0, 1e4, 1e8])
def test_exp_of_a_row_does_not_depend_on_its_batch(manifold, companion, rng):
    x = manifold.random_point(rng, 40)
    v = shaped(np.geomspace(1e-6, 2.0, 40), manifold) * manifold.random_tangent(x, rng)
    alone = np.stack([manifold.exp(a, b) for a, b in zip(x, v, strict=True)])
    other = manifold.random_point(rng, 1)
    with np.errstate(all="ignore"):
        long = companion * manifold.random_tangent(other, rng)
        beside = manifold.exp(np.concatenate([x, other]), np.concatenate([v, long]))[:40]
    size = np.abs(alone).max(axis=tuple(range(1, alone.ndim)), keepdims=True)
    assert (np.abs(beside - alone) <= 1e-13 * np.maximum(size, 1.0)).all()


def test_what_projection_returns_is_a_point(manifold):
    """Or it says which array has no point near it."""
    rng = np.random.default_rng(4)
    for scale in (0.0, 1e-200, 1e-9, 1.0, 1e9, 1e100):
        for x in scale * rng.standard_normal((20, *manifold.point_shape)):
            try:
                projected = manifold.project(x)
            except DataError:
                continue
            manifold.check_point(projected)
    with pytest.raises(DataError, match="not finite"):
        manifold.project(np.full(manifold.point_shape, np.nan))


@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_hostile_arrays_become_points_or_an_error(data):
    """For any finite array, project gives a point or refuses it."""
    manifold = from_name(data.draw(st.sampled_from(NAMES)))
    numbers = st.floats(-1e6, 1e6, allow_subnormal=False)
    x = data.draw(hnp.arrays(np.float64, (2, *manifold.point_shape), elements=numbers))
    try:
        projected = manifold.project(x)
    except DataError:
        return
    manifold.check_point(projected, tolerance=1e-5)
    with np.errstate(all="ignore"):
        distance = manifold.dist(projected[0], projected[1])
    assert not np.isnan(distance)
    assert distance >= 0


@pytest.mark.parametrize(
    "name",
    [
        "",
        "grassmann",
        "grassmann(3)",
        "grassmann(3,3)",
        "grassmann(2,x)",
        "grassmann(0,0)",
        "affine(3)",
        "moon(2)",
        "euclidean(0)",
        "euclidean(-1)",
        "affine(2,inexact)",
        "special_linear(2)",
        "special_euclidean(4)",
        "special_euclidean(2,3)",
    ],
)
def test_unknown_names_are_refused_in_one_line(name):
    with pytest.raises(ConfigurationError) as caught:
        from_name(name)
    assert "\n" not in str(caught.value)
