"""Geometry that several models share, each formula against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.geometry import epipolar
from mssegment.geometry.levenberg_marquardt import damped_step, minimize
from mssegment.geometry.projective import (
    homogeneous,
    homogeneous_rows,
    transfer,
    transfer_sq_error,
)
from mssegment.geometry.robust import StudentTFit, hard_em
from mssegment.geometry.rotations import (
    degrees,
    rotation,
    skew,
    step_on_sphere,
    tangent_basis,
)


@pytest.fixture
def two_views(rng):
    """An essential matrix, and rays of points that satisfy it: E [1, 3, 3], x1, x2 [20, 3]."""
    space = rng.uniform([-1.0, -1.0, 4.0], [1.0, 1.0, 6.0], (20, 3))
    rotated, shift = rotation(0.1 * rng.normal(size=3)), rng.normal(size=3)
    moved = space @ rotated.T + shift
    first, second = (x / x[:, 2:] for x in (space, moved))
    return (skew(shift) @ rotated)[None], first, second


def test_rotations_are_orthogonal_and_have_their_angle(rng):
    vectors = rng.normal(size=(20, 3)) * 0.3
    matrices = rotation(vectors)
    np.testing.assert_allclose(
        matrices @ np.swapaxes(matrices, 1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-12
    )
    angles = np.degrees(np.linalg.norm(vectors, axis=1))
    np.testing.assert_allclose(degrees(matrices), angles, rtol=1e-9)
    np.testing.assert_allclose((matrices @ vectors[..., None])[..., 0], vectors, atol=1e-12)


def test_skew_matrices_are_cross_products(rng):
    a, b = rng.normal(size=(2, 10, 3))
    np.testing.assert_allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-12)
    np.testing.assert_allclose(epipolar.cross(a, b), np.cross(a, b), atol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 9])
def test_tangent_bases_are_orthonormal_and_steps_stay_on_the_sphere(rng, n):
    x = rng.normal(size=(30, n))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    x[0], x[1] = np.eye(n)[0], -np.eye(n)[0]
    basis = tangent_basis(x)
    np.testing.assert_allclose(
        np.swapaxes(basis, 1, 2) @ basis, np.tile(np.eye(n - 1), (30, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.einsum("bi,bij->bj", x, basis), 0.0, atol=1e-12)
    moved = step_on_sphere(x, rng.normal(size=(30, n - 1)))
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1), 1.0, atol=1e-12)


def test_sampson_distance_is_the_distance_to_the_nearest_exact_match(two_views, rng):
    matrices, first, second = two_views
    np.testing.assert_allclose(epipolar.sampson(matrices, first, second).error, 0.0, atol=1e-12)
    noise = 1e-4 * rng.normal(size=(2, 20, 2))
    off1, off2 = first.copy(), second.copy()
    off1[:, :2] += noise[0]
    off2[:, :2] += noise[1]
    terms = epipolar.sampson(matrices, off1, off2)
    # Newton steps along the gradient of x2' E x1 reach the nearest match that is exact
    near1, near2 = off1.copy(), off2.copy()
    for _ in range(20):
        at = epipolar.sampson(matrices, near1, near2)
        step = (at.error / at.gradient)[0]
        near1[:, :2] -= (step * at.lines1[0, :2]).T
        near2[:, :2] -= (step * at.lines2[0, :2]).T
    gap = np.concatenate([near1 - off1, near2 - off2], axis=1)
    np.testing.assert_allclose(np.abs(terms.error[0]), np.linalg.norm(gap, axis=1), rtol=1e-3)


def test_sampson_derivatives_agree_with_finite_differences(rng):
    matrices, first, second = rng.normal(size=(4, 3, 3)), *rng.normal(size=(2, 7, 3))
    first[:, 2] = second[:, 2] = 1.0
    error, jacobian = epipolar.sampson_jacobian(matrices, first, second)
    np.testing.assert_allclose(error, epipolar.sampson(matrices, first, second).error)
    for k in range(9):
        change = 1e-6 * np.eye(9)[k].reshape(3, 3)
        ahead = epipolar.sampson(matrices + change, first, second).error
        back = epipolar.sampson(matrices - change, first, second).error
        np.testing.assert_allclose((ahead - back) / 2e-6, jacobian[..., k], rtol=1e-4, atol=1e-7)


def test_rotated_translations_agree_with_finite_differences(rng):
    first = homogeneous(rng.uniform(-0.5, 0.5, (6, 2)))
    directions = rng.normal(size=(1, 3))
    directions /= np.linalg.norm(directions)
    # near the constraint, where the gradient in the denominator does not matter
    space = first * rng.uniform(3.0, 6.0, (6, 1)) + 0.3 * directions
    second = space / space[:, 2:]
    still = np.eye(3)[None]
    jacobian_at = epipolar.rotated_translation_jacobian
    error, jacobian = jacobian_at(directions, still, first, second)
    np.testing.assert_allclose(error, 0.0, atol=1e-12)
    step = epipolar.step_rotated_translation
    for k in range(5):
        change = np.zeros((1, 5))
        change[0, k] = 1e-6
        ahead = jacobian_at(*step(directions, still, change), first, second)[0]
        back = jacobian_at(*step(directions, still, -change), first, second)[0]
        np.testing.assert_allclose((ahead - back) / 2e-6, jacobian[..., k], rtol=1e-5, atol=1e-7)


def test_each_matrix_may_have_its_own_matches(rng):
    matrices, first, second = (rng.normal(size=(5, 3, 3)) for _ in range(3))
    error, jacobian = epipolar.sampson_jacobian(matrices, first, second)
    for i in range(5):
        one, slopes = epipolar.sampson_jacobian(matrices[i : i + 1], first[i], second[i])
        np.testing.assert_allclose(error[i], one[0], atol=1e-12)
        np.testing.assert_allclose(jacobian[i], slopes[0], atol=1e-12)


def test_homographies_map_points(rng):
    matrices, points = rng.normal(size=(3, 3, 3)), rng.normal(size=(8, 2))
    x, y, depth = transfer(matrices, homogeneous_rows(points))
    for i, matrix in enumerate(matrices):
        image = homogeneous(points) @ matrix.T
        np.testing.assert_allclose(np.stack([x[i], y[i]], axis=1), image[:, :2] / image[:, 2:])
        np.testing.assert_allclose(depth[i], image[:, 2])
    errors = transfer_sq_error(matrices, homogeneous_rows(points), np.zeros((8, 2)))
    assert (np.isinf(errors) == (depth <= 1e-9)).all()
    seen = np.isfinite(errors)
    np.testing.assert_allclose(errors[seen], (x**2 + y**2)[seen])


def test_levenberg_marquardt_fits_circles_and_never_increases_the_cost(rng):
    """Many circles x^2 + y^2 = r^2 about unknown centres, from bad starts."""
    true = rng.uniform(1.0, 3.0, (6, 3))
    angle = rng.uniform(0.0, 2.0, (6, 15))
    x = true[:, :1] + true[:, 2:] * np.cos(angle)
    y = true[:, 1:2] + true[:, 2:] * np.sin(angle)

    def linearize(state, rows):
        u, v = x[rows] - state[0][:, :1], y[rows] - state[0][:, 1:2]
        length = np.hypot(u, v)
        slopes = np.stack([-u / length, -v / length, -np.ones_like(u)], axis=-1)
        return length - state[0][:, 2:], slopes

    def retract(state, steps):
        return (state[0] + steps,)

    start, rows = np.tile([1.0, 1.0, 1.0], (6, 1)), np.arange(6)
    costs = []
    for rounds in range(25):
        (found,) = minimize((start,), linearize, retract, rounds=rounds)
        costs.append((linearize((found,), rows)[0] ** 2).sum(axis=1))
    assert (np.diff(costs, axis=0) <= 1e-12).all()
    np.testing.assert_allclose(found, true, atol=1e-6)
    # residuals of weight zero have no influence
    x[:, 0] += 5.0
    weights = np.ones_like(x)
    weights[:, 0] = 0.0
    (weighted,) = minimize((start,), linearize, retract, rounds=40, weights=weights)
    np.testing.assert_allclose(weighted, true, atol=1e-6)


def test_a_parameter_without_influence_does_not_change():
    jacobian = np.zeros((1, 4, 2))
    jacobian[..., 0] = 1.0
    step = damped_step(jacobian, np.full((1, 4), 2.0), np.array([0.0]))
    np.testing.assert_allclose(step, [[-2.0, 0.0]])


def test_student_t_ignores_distant_vectors(rng):
    vectors = rng.normal(size=(200, 3)) @ np.diag([3.0, 1.0, 0.5])
    vectors[:10] += 100.0
    fit = StudentTFit(vectors, 5.0, 1e-3)
    members = np.ones((1, 200))
    fitted = fit(members)
    assert np.median(fitted.squared[0, :10]) > 20 * np.median(fitted.squared[0, 10:])
    # groups that are fitted together do not influence each other
    halves = np.zeros((2, 200))
    halves[0, :100], halves[1, 100:] = 1.0, 1.0
    both, one = fit(halves), fit(halves[:1])
    np.testing.assert_allclose(both.squared[0], one.squared[0])
    np.testing.assert_allclose(both.log_det[0], one.log_det[0])


def test_hard_em_reassigns_vectors_and_dissolves_small_groups():
    place = np.r_[np.zeros(10), np.full(10, 5.0), 2.4]
    labels = np.r_[np.zeros(10, int), np.ones(10, int), 2]

    def costs(members):
        middle = members @ place / members.sum(axis=1)
        return (place - middle[:, None]) ** 2

    found = hard_em(labels, costs, rounds=10, min_size=2)
    np.testing.assert_array_equal(found, np.r_[np.zeros(10), np.ones(10), 0])
    assert not hard_em(labels, costs, rounds=10, min_size=11).any()
