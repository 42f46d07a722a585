"""The equations of section 4.1 of the paper, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.manifolds import Grassmann

SIZES = [(3, 1), (10, 3), (13, 4), (5, 4)]


@pytest.fixture(params=SIZES)
def manifold(request) -> Grassmann:
    return Grassmann(*request.param)


def t(x):
    return np.swapaxes(x, -1, -2)


def test_equation_11_is_the_gradient_of_any_function(manifold, rng):
    """f(x) = tr(A x B x'), which depends on the basis of x unless B = I: take B = I."""
    n = manifold.n
    a = rng.standard_normal((n, n))
    a = a + a.T
    x = manifold.random_point(rng, 1)[0]
    gradient = manifold.project_tangent(x, 2 * a @ x)
    u = manifold.random_tangent(x, rng)

    def f(step):
        y = manifold.exp(x, step * u)
        return np.trace(y.T @ a @ y)

    slope = (f(1e-5) - f(-1e-5)) / 2e-5
    assert manifold.inner(x, gradient, u) == pytest.approx(slope, abs=1e-7)
    np.testing.assert_allclose(x.T @ gradient, 0, atol=1e-12)


def test_equation_12_is_the_sine_of_the_principal_angles(manifold, rng):
    x, y = manifold.random_point(rng, 20), manifold.random_point(rng, 20)
    d2 = manifold.k - np.trace(t(x) @ y @ t(y) @ x, axis1=1, axis2=2)
    np.testing.assert_allclose(manifold.dist(x, y) ** 2, d2, atol=1e-12)
    angles = manifold.principal_angles(x, y)
    np.testing.assert_allclose((np.sin(angles) ** 2).sum(axis=1), d2, atol=1e-12)
    chordal = np.linalg.norm(x @ t(x) - y @ t(y), axis=(1, 2)) / np.sqrt(2)
    np.testing.assert_allclose(manifold.dist(x, y), chordal, atol=1e-12)


def test_equation_13_is_half_the_gradient(manifold, rng):
    """With the factor 2 of the derivative of a square that the paper drops."""
    x, y = manifold.random_point(rng, 5), manifold.random_point(rng, 5)
    paper = -(np.eye(manifold.n) - x @ t(x)) @ y @ t(y) @ x
    np.testing.assert_allclose(manifold.neg_half_grad_sq_dist(x, y), -paper, atol=1e-12)
    u = manifold.random_tangent(x, rng)
    ahead, behind = (manifold.dist(manifold.exp(x, s * u), y) ** 2 for s in (1e-5, -1e-5))
    np.testing.assert_allclose(2 * manifold.inner(x, paper, u), (ahead - behind) / 2e-5, atol=1e-8)


def test_equation_14_is_the_mean_tangent(manifold, rng):
    x, y = manifold.random_point(rng, 3), manifold.random_point(rng, 8)
    g = rng.uniform(size=(3, 8))
    for i in range(3):
        across = np.eye(manifold.n) - x[i] @ x[i].T
        expected = sum(g[i, j] * across @ y[j] @ y[j].T @ x[i] for j in range(8)) / g[i].sum()
        np.testing.assert_allclose(manifold.mean_tangent(x, y, g)[i], expected, atol=1e-12)


@pytest.mark.parametrize("length", [0.0, 1e-6, 0.1, 1.0, 3.0, 20.0])
def test_equation_15_with_its_svd(manifold, length, rng):
    x = manifold.random_point(rng, 10)
    v = length * manifold.random_tangent(x, rng)
    u, s, vt = np.linalg.svd(v, full_matrices=False)
    expected = (x @ t(vt)) * np.cos(s)[:, None] @ vt + u * np.sin(s)[:, None] @ vt
    np.testing.assert_allclose(manifold.exp(x, v), expected, atol=1e-11)


def test_orthogonal_lines_are_a_right_angle_apart():
    """Distance 1, the largest there is on G(N, 1), not 0."""
    lines = np.eye(3)[:, :, None]
    manifold = Grassmann(3, 1)
    np.testing.assert_allclose(manifold.pairwise_dist2(lines, lines), 1 - np.eye(3), atol=1e-12)
    np.testing.assert_allclose(manifold.principal_angles(lines[0], lines[1]), np.pi / 2)


def test_principal_angles_are_accurate_when_small(rng):
    manifold = Grassmann(10, 3)
    x = manifold.random_point(rng, 1)[0]
    u, _, vt = np.linalg.svd(manifold.random_tangent(x, rng), full_matrices=False)
    angles = np.array([1e-10, 1e-9, 1e-8])
    y = manifold.exp(x, (u * angles) @ vt)
    np.testing.assert_allclose(manifold.principal_angles(x, y), angles, rtol=1e-5)
    assert manifold.norm(x, manifold.log(x, y)) == pytest.approx(np.linalg.norm(angles), rel=1e-5)


@pytest.mark.parametrize(("n", "k"), [(3, 1), (4, 2), (13, 4)])
def test_hundreds_of_steps_stay_on_the_manifold(n: int, k: int, rng: np.random.Generator) -> None:
    """As many as the longest trajectory of a mean shift has."""
    manifold = Grassmann(n, k)
    x = manifold.random_point(rng, 20)
    for _ in range(300):
        x = manifold.exp(x, rng.uniform(0.01, 0.5) * manifold.random_tangent(x, rng))
    assert manifold.constraint_violation(x).max() < 1e-10
