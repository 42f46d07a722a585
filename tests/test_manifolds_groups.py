"""Matrix groups: logarithms and exponentials against SciPy's, and the cases that are singular."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import scipy.linalg
import scipy.spatial.transform
from hypothesis import given, settings
from hypothesis import strategies as st

from mssegment.manifolds import (
    MANIFOLDS,
    SL3,
    AffineGroup,
    Manifold,
    MatrixGroup,
    Rotations,
    from_name,
    log_gradient,
)

IDENTITY = np.eye(3)
GROUPS = [
    group
    for family in MANIFOLDS.values()
    for group in map(from_name, family.examples)
    if isinstance(group, MatrixGroup)
]


@pytest.fixture(params=GROUPS, ids=lambda group: group.name)
def group(request: pytest.FixtureRequest) -> Manifold:
    return request.param


def affine(a, b=(0.3, -0.7)):
    """[A b; 0 1]."""
    m = np.eye(3)
    m[:2, :2], m[:2, 2] = a, b
    return m


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


TINY = (0.0, 1e-14, 1e-10, 1e-8, 1e-5, 1e-3)
WITH_LOGARITHM = [
    *(affine(np.eye(2) + e * np.array([[1.0, 2.0], [-3.0, 0.5]])) for e in TINY),
    *(affine([[1.0, shear], [0.0, 1.0]]) for shear in (1e-9, 0.1, 3.0, 100.0)),
    *(affine(np.diag([1.0, d])) for d in (2.0, 0.5, 10.0, 1e-3, 1.0 + 1e-7)),
    *(affine(np.diag([1.0 + e, 2.0])) for e in TINY),
    *(affine(np.diag([1.0 - e, 0.2])) for e in TINY),
    *(affine([[2.0, 1.0], [0.0, 2.0 + e]]) for e in TINY),
    *(affine([[0.3, 5.0], [-e, 0.3]]) for e in TINY),
    *(affine(rotation(t)) for t in (1e-9, 1e-3, 0.5, np.pi / 2, 2.0, 3.1, -3.1)),
    *(affine(2.5 * rotation(t)) for t in (0.2, 3.0)),
    affine(np.diag([3.0, 3.0])),
    affine(np.diag([1e3, 1e-3])),
]
WITHOUT_LOGARITHM = [
    affine(np.diag([-1.0, 2.0])),
    affine(np.diag([-1.0, -2.0])),
    affine([[-1.0, 1e-3], [0.0, -1.0]]),
    affine(np.diag([0.0, 1.0])),
    affine(np.zeros((2, 2))),
    affine([[0.0, 1.0], [1.0, 0.0]]),
]


@pytest.mark.parametrize("m", WITH_LOGARITHM)
def test_affine_logarithm_is_scipys(m):
    """(17): also where A - I is singular because one eigenvalue is 1."""
    found = AffineGroup().log(IDENTITY, m)
    np.testing.assert_allclose(found, np.real(scipy.linalg.logm(m)), atol=1e-7)
    np.testing.assert_allclose(scipy.linalg.expm(found), m, rtol=1e-11, atol=1e-12 * abs(m).max())


@pytest.mark.parametrize("m", WITH_LOGARITHM[:-1])
def test_affine_exponential_is_scipys(m):
    """(16)."""
    v = m - IDENTITY
    np.testing.assert_allclose(
        AffineGroup().exp(IDENTITY, v), scipy.linalg.expm(v), rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize("m", WITHOUT_LOGARITHM)
def test_without_a_real_logarithm_the_distance_is_infinite(m):
    group = AffineGroup()
    assert np.isnan(group.log(IDENTITY, m)).any()
    assert group.dist(IDENTITY, m) == np.inf
    assert (group.neg_half_grad_sq_dist(IDENTITY, m) == 0).all()
    both = group.prepare(np.stack([m, IDENTITY]), precise=False).block(IDENTITY[None])
    assert both.scaled_sq_dist[0, 0] == np.inf
    summed, total = both.weighted_sum(np.exp(-both.scaled_sq_dist))
    assert np.isfinite(summed).all()
    assert total[0] == pytest.approx(1.0)


@given(st.lists(st.floats(-4.0, 4.0), min_size=6, max_size=6))
@settings(max_examples=300, deadline=None)
def test_affine_exp_and_log_invert_each_other(numbers):
    """Where the imaginary parts of the eigenvalues stay within (-pi, pi), log inverts exp."""
    v = np.zeros((3, 3))
    v[:2] = np.reshape(numbers, (2, 3))
    m = AffineGroup().exp(IDENTITY, v)
    np.testing.assert_allclose(m, scipy.linalg.expm(v), rtol=1e-8, atol=1e-8 * abs(m).max())
    if np.abs(np.linalg.eigvals(v).imag).max() < 3.0:
        size = max(1.0, np.abs(v).max()) * np.linalg.cond(m)
        np.testing.assert_allclose(AffineGroup().log(IDENTITY, m), v, atol=1e-12 * size)


@pytest.mark.parametrize("length", [1e-9, 1e-4, 0.3, 1.0, 2.0])
def test_special_linear_logarithm_and_exponential_are_scipys(length, rng):
    group = SL3()
    x = np.broadcast_to(IDENTITY, (40, 3, 3))
    v = length * group.random_tangent(x, rng)
    m = group.exp(x, v)
    expected = np.array([scipy.linalg.expm(each) for each in v])
    np.testing.assert_allclose(m, expected, rtol=1e-12, atol=1e-13)
    logs = np.array([np.real(scipy.linalg.logm(each)) for each in m])
    np.testing.assert_allclose(group.log(x, m), logs, atol=1e-9 * max(length, 1e-3))
    np.testing.assert_allclose(np.trace(group.log(x, m), axis1=1, axis2=2), 0, atol=1e-12)


@pytest.mark.parametrize("m", [np.diag([-2.0, -0.25, 2.0]), np.diag([1.0, -2.0, -0.5])])
def test_special_linear_without_a_real_logarithm(m):
    assert SL3().dist(IDENTITY, m) == np.inf


def test_jordan_blocks_of_special_linear():
    """Shears: all eigenvalues 1, the logarithm is the finite series."""
    n = np.array([[0.0, 2.0, -1.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(SL3().log(IDENTITY, IDENTITY + n), n - n @ n / 2, atol=1e-8)


def test_pruned_pairs_are_only_those_out_of_reach(group, rng):
    x, y = group.random_point(rng, 30), group.random_point(rng, 200)
    h = 0.15
    whole = group.prepare(y, h).block(x)
    for precise, tolerance in ((True, 1e-9), (False, 2e-3)):
        pruned = group.prepare(y, h, precise, cutoff=5.0).block(x)
        near = whole.scaled_sq_dist <= 25.0
        if type(group) is not Rotations:  # which are not pruned
            assert not np.isfinite(pruned.scaled_sq_dist).all()
        np.testing.assert_allclose(
            pruned.scaled_sq_dist[near], whole.scaled_sq_dist[near], rtol=tolerance, atol=tolerance
        )
        far = np.isfinite(pruned.scaled_sq_dist) & ~near
        np.testing.assert_allclose(
            pruned.scaled_sq_dist[far], whole.scaled_sq_dist[far], rtol=tolerance
        )
        weights = np.exp(-whole.scaled_sq_dist) * near
        for a, b in zip(pruned.weighted_sum(weights), whole.weighted_sum(weights), strict=True):
            np.testing.assert_allclose(a, b, atol=tolerance)


def test_lower_bound_of_the_distance(group, rng):
    """|m - m^-1|_F / 2 <= sinh |log m|_F, by which pairs are left out."""
    m = group.random_point(rng, 500)
    unit = group.to_unit(m)
    bound = np.arcsinh(0.5 * np.linalg.norm(unit - np.linalg.inv(unit), axis=(1, 2)))
    assert (bound <= group.dist(np.eye(group.size), m) + 1e-12).all()


def test_logarithms_of_special_linear_at_every_distance(rng):
    """Few nodes, more, and square roots: each takes over where the one before ends."""
    group = SL3()
    v = group.random_tangent(np.broadcast_to(IDENTITY, (3000, 3, 3)), rng)
    v *= rng.uniform(0.0, 3.0, (3000, 1, 1))
    first = np.moveaxis(np.array([scipy.linalg.expm(each) for each in v]), 0, 2)
    for kind, tolerance in ((np.float64, 1e-12), (np.float32, 2e-5)):
        for some in (v, v[np.linalg.norm(v, axis=(1, 2)) < 0.3]):
            place = np.flatnonzero(np.isin(v[:, 0, 0], some[:, 0, 0]))
            found = group.algebra_log(first[:, :, place].astype(kind))
            np.testing.assert_allclose(np.moveaxis(found, 2, 0), some, atol=tolerance)
    near = group.algebra_log(first, max_norm=1.5)
    inside = np.linalg.norm(v, axis=(1, 2)) < 1.5
    np.testing.assert_allclose(np.moveaxis(near, 2, 0)[inside], v[inside], atol=1e-12)


def test_gradient_of_equation_21_is_ten_percent_off_at_length_0_3(rng):
    """The design's figure for the first-order approximation, against the exact gradient."""
    first, exact = AffineGroup(), AffineGroup(exact=True)
    x = first.random_point(rng, 200)
    y = first.exp(x, 0.3 * first.random_tangent(x, rng))
    error = (
        first.norm(x, first.neg_half_grad_sq_dist(x, y) - exact.neg_half_grad_sq_dist(x, y)) / 0.3
    )
    assert 0.02 < np.median(error) < 0.15


def turn(angle, size):
    """A rotation about a skew axis, or of the plane, in the upper left of an identity matrix."""
    m = np.eye(size)
    if size == 4:
        m[:3, :3] = scipy.spatial.transform.Rotation.from_rotvec(
            angle * np.array([2.0, -1.0, 2.0]) / 3.0
        ).as_matrix()
    else:
        m[:2, :2] = rotation(angle)
    return m


@pytest.mark.parametrize("gap", [0.0, *(10.0**-k for k in range(17))])
def test_turns_up_to_half_a_turn_have_a_logarithm(group, gap):
    """Its norm is sqrt 2 times the angle, also within rounding of half a turn, in a batch too."""
    angle = np.pi - gap
    if group.name == "special_orthogonal(3)":
        m = turn(angle, 4)[:3, :3]
    else:
        m = turn(angle, group.size)[: group.size, : group.size]
    e = np.eye(group.size)
    assert group.dist(e, m) == pytest.approx(np.sqrt(2) * angle, rel=1e-14)
    log = group.log(e, m)
    np.testing.assert_allclose(group.exp(e, log), m, atol=1e-14 * 10)
    np.testing.assert_allclose(log[:3, :3], -log[:3, :3].T, atol=1e-12)
    block = group.prepare(m[None], 1.0).block(e[None])
    assert block.scaled_sq_dist[0, 0] == pytest.approx(2 * angle**2, rel=1e-12)


def cube_rotations():
    """The 24 rotations that map a cube onto itself."""
    signs = np.array(np.meshgrid(*[[1.0, -1.0]] * 3)).reshape(3, -1).T
    matrices = [
        np.eye(3)[list(order)] * sign[:, None]
        for order in itertools.permutations(range(3))
        for sign in signs
    ]
    return np.array([m for m in matrices if np.linalg.det(m) > 0])


@pytest.mark.parametrize("name", ["so3", "se3", "se3(exact)", "sl3", "sl3(exact)"])
def test_rotations_of_the_cube_are_at_finite_distances(name):
    """At the angles 0, 90, 120 and 180 degrees."""
    group = from_name(name)
    points = np.tile(np.eye(group.size), (24, 1, 1))
    points[:, :3, :3] = cube_rotations()
    d2 = group.pairwise_dist2(points, points)
    angles = np.sqrt(d2 / 2)
    known = np.array([0.0, np.pi / 2, 2 * np.pi / 3, np.pi])
    assert np.abs(angles[..., None] - known).min(axis=-1).max() < 1e-7
    gradient = group.neg_half_grad_sq_dist(points[:, None], points[None])
    log = group.log(points[:, None], points[None])
    assert (np.abs(log) < 10).all()
    np.testing.assert_allclose(gradient, log, atol=1e-7)  # of rotations, and of no other maps


@pytest.mark.parametrize("length", [1e-3, 0.1, 0.99, 1.01, 2.0, 4.0, 6.0, 8.0, 12.0])
def test_exact_gradient_at_every_distance(group, length, rng):
    """Against finite differences wherever the logarithm is unique, up to |log| 12."""
    if not group.exact_gradient:
        pytest.skip("first order")
    x = group.random_point(rng, 60)
    y = group.exp(x, length * group.random_tangent(x, rng))
    log = group.log(x, y)
    unique = np.isfinite(log).all(axis=(1, 2)) & (np.abs(group.norm(x, log) - length) < 1e-6)
    ratio = np.linalg.solve(x, y)
    angles = np.abs(np.angle(np.linalg.eigvals(ratio)))
    unique &= (angles < 3.1).all(axis=1) & (np.linalg.cond(ratio) < 1e5)
    x, y = x[unique], y[unique]
    if not len(x):
        assert length > 4.0
        return
    u, t = group.random_tangent(x, rng), 1e-4 * min(1.0, length)

    def slope_with(step):
        far = [group.dist(group.exp(x, s * step * u), y) ** 2 for s in (2, 1, -1, -2)]
        return (8.0 * (far[1] - far[2]) - (far[0] - far[3])) / (12.0 * step)

    slope = slope_with(t)
    of_differences = np.abs(slope - slope_with(2.0 * t))
    found = group.inner(x, group.neg_half_grad_sq_dist(x, y), u)
    allowed = 1e-7 * np.maximum(1.0, np.abs(found)) + of_differences
    assert (np.abs(found + 0.5 * slope) < allowed).all()
    assert np.median(of_differences) < 1e-6 * max(1.0, length)


def test_exact_gradient_of_a_batch_in_single_precision_is_finite(group, rng):
    """Distances of 3 to 12 overflowed the series."""
    x = group.random_point(rng, 5)
    y = np.concatenate([group.exp(x, s * group.random_tangent(x, rng)) for s in (1, 3, 6, 12)])
    for precise, tolerance in ((True, 1e-7), (False, 1e-2)):
        block = group.prepare(y, 1.5, precise).block(x)
        weights = np.exp(-0.5 * block.scaled_sq_dist)
        found, _ = block.weighted_sum(weights)
        with np.errstate(invalid="ignore"):
            pull = group.neg_half_grad_sq_dist(x[:, None], y[None])
        expected = np.einsum("mn,mnij->mij", weights, pull)
        np.testing.assert_allclose(found, expected, atol=tolerance * max(1, np.abs(expected).max()))


@pytest.mark.parametrize("error", [0.0, 1e-16, -3e-16])
def test_half_turns_about_an_axis_of_the_basis_are_seen_at_any_rounding(error):
    """Rows of C(a) that are rounding only: how large they are is up to the kernel of the CPU."""
    c = np.diag([1.0, 1.0, 0.8, 0.8, 0.8, 0.8, 2e-16, 2e-16 + error])
    quarter = -((np.pi / 2) ** 2) * np.diag([0.0, 0.0, 0.25, 0.25, 0.25, 0.25, 1.0, 1.0])
    divided = log_gradient._divided(quarter[None], c[None])
    assert np.abs(divided).max() < 1.0
