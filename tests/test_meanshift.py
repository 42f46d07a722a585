"""Mean shift: fixed points, climbing, an independent implementation, robustness, determinism."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import MANIFOLDS, Euclidean, Grassmann, Manifold, from_name
from mssegment.meanshift import (
    KERNELS,
    MeanShift,
    ModeSearch,
    find_clusters,
    kernel_named,
    mean_shift_to_convergence,
    nearest_neighbour_bandwidth,
)
from mssegment.meanshift.ascent import ascend, shift
from mssegment.meanshift.trajectories import OVERRELAXATION

NAMES = [name for family in MANIFOLDS.values() for name in family.examples]
EXACT = [name for name in NAMES if from_name(name).exact_gradient]
WIDE = [name for name in NAMES if from_name(name).dim > 1]
"""On a line the scattered points cover the clusters."""
GROUPS = [name for name in NAMES if from_name(name).left_invariant]


def narrow(manifold: Manifold, points, constant=0.5):
    """The bandwidth of the paper's rule."""
    return nearest_neighbour_bandwidth(manifold, points, np.random.default_rng(0), constant)


def clusters(manifold: Manifold, rng, n=60, spread=0.04, count=3, scattered=0.4):
    """``count`` clusters around random points and a share of scattered points."""
    centres = manifold.random_point(rng, count)
    inside = np.arange(round((1 - scattered) * n)) % count
    x = centres[inside]
    v = manifold.project_tangent(x, spread * rng.standard_normal(x.shape))
    points = manifold.exp(x, v)
    return np.concatenate([points, manifold.random_point(rng, n - len(points))]), inside, centres


@pytest.mark.parametrize("name", WIDE)
def test_finds_the_clusters(name, rng):
    manifold = from_name(name)
    points, inside, centres = clusters(manifold, rng, n=150)
    found = MeanShift(manifold, narrow(manifold, points)).fit(points)
    labels = found.labels_[: len(inside)]
    for i in range(3):
        values, counts = np.unique(labels[inside == i], return_counts=True)
        assert counts.max() >= 0.95 * np.sum(inside == i)
        assert manifold.dist(found.modes_[values[counts.argmax()]], centres[i]) < 0.1
    assert set(labels) <= set(range(len(found.modes_)))
    assert (np.diff(found.densities_) <= 1e-6 / len(points)).all()
    assert found.counts_.sum() == np.sum(found.labels_ >= 0)
    np.testing.assert_array_equal(np.bincount(found.labels_), found.counts_)


@pytest.mark.parametrize("name", NAMES)
def test_modes_are_fixed_points_with_the_density_of_equation_7(name, rng):
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng)
    found = MeanShift(manifold, narrow(manifold, points)).fit(points)
    step, density = shift(
        manifold.prepare(points, found.bandwidth_), KERNELS["gaussian"], found.modes_
    )
    length = manifold.norm(found.modes_, step) / found.bandwidth_
    assert manifold.constraint_violation(found.modes_).max() < 1e-13
    isolated = found.densities_ * len(points) < 1.01
    assert (length[~isolated] < 1e-3).all()
    assert (length[isolated] < 1e-2).all()
    # two points 2 h apart have a very flat mode
    tolerance = np.where(found.densities_ * len(points) < 2.0, 1e-2, 1e-3)
    assert (np.abs(density / found.densities_ - 1) < tolerance).all()
    d2 = manifold.pairwise_dist2(found.modes_, points)
    expected = np.exp(-d2 / (2 * found.bandwidth_**2)).mean(axis=1)
    assert (np.abs(expected / found.densities_ - 1) < tolerance).all()


@pytest.mark.parametrize("name", EXACT)
@pytest.mark.parametrize("kernel", sorted(KERNELS))
def test_density_never_falls_where_the_gradient_is_exact(name, kernel, rng):
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng)
    bandwidth = narrow(manifold, points, 1.0)
    prepared = manifold.prepare(points, bandwidth)
    x, last = points, np.zeros(len(points))
    for _ in range(15):
        step, density = shift(prepared, kernel_named(kernel), x)
        assert (density >= last - 1e-9).all()
        x, last = manifold.exp(x, step), density


@pytest.mark.parametrize("name", EXACT)
def test_relaxed_steps_climb_too(name, rng):
    """The quadratic lower bound that a shift maximises is higher all the way to twice the shift."""
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng)
    for constant in (0.5, 1.0):
        bandwidth = narrow(manifold, points, constant)
        prepared = manifold.prepare(points, bandwidth)
        step, density = shift(prepared, KERNELS["gaussian"], points)
        _, further = shift(
            prepared, KERNELS["gaussian"], manifold.exp(points, OVERRELAXATION * step)
        )
        assert (further >= density * (1 - 1e-9)).all()


@pytest.mark.parametrize("name", EXACT)
def test_shift_is_the_gradient_of_the_log_density(name, rng):
    """(8)-(9): m = h^2 grad log f for the Gaussian kernel, against finite differences."""
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng)
    prepared, h, t = manifold.prepare(points, 0.3), 0.3, 1e-5
    x = points[:20]
    step, _ = shift(prepared, KERNELS["gaussian"], x)
    u = manifold.random_tangent(x, rng)
    ahead, behind = (
        np.log(shift(prepared, KERNELS["gaussian"], manifold.exp(x, s * t * u))[1]) for s in (1, -1)
    )
    np.testing.assert_allclose(
        manifold.inner(x, step, u), h**2 * (ahead - behind) / (2 * t), atol=1e-6
    )


def textbook_mean_shift(points, h):
    """Euclidean mean shift (5)-(6) as a textbook writes it."""
    ends = []
    for x in points:
        for _ in range(5000):
            w = np.exp(-0.5 * ((points - x) ** 2).sum(axis=1) / h**2)
            new = (w[:, None] * points).sum(axis=0) / w.sum()
            moved = np.linalg.norm(new - x)
            x = new
            if moved < 1e-9:
                break
        ends.append(x)
    return np.array(ends)


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_euclidean_case_is_the_classical_algorithm(rng, offset):
    manifold = from_name("euclidean(2)")
    points = offset + clusters(manifold, rng, n=90, spread=0.1)[0]
    h = 0.15
    ends = textbook_mean_shift(points, h)
    plain, _ = mean_shift_to_convergence(manifold, points, h, tolerance=1e-9)
    np.testing.assert_allclose(plain, ends, atol=1e-5)
    found = MeanShift(manifold, bandwidth=h).fit(points)
    away = np.linalg.norm(found.modes_[found.labels_] - ends, axis=1)
    assert np.mean(away > h) <= 0.01
    assert np.median(away) < 1e-4


def test_the_reference_is_the_paper_as_it_is_written(rng):
    """(14)-(15) for every start and every point by itself, with the SVD of each step."""
    manifold, h = Grassmann(4, 2), 0.3
    points, _, _ = clusters(manifold, rng, n=20, spread=0.1)
    ends, _ = mean_shift_to_convergence(manifold, points, h, tolerance=1e-6)
    for start, end in zip(points, ends, strict=True):
        x, length = start, np.inf
        while length > 1e-6 * h:
            weights = [np.exp(-(2 - np.trace(x.T @ y @ y.T @ x)) / (2 * h * h)) for y in points]
            across = np.eye(4) - x @ x.T
            pulls = [w * across @ y @ y.T @ x for w, y in zip(weights, points, strict=True)]
            step = np.sum(pulls, axis=0) / np.sum(weights)
            u, s, v = np.linalg.svd(step, full_matrices=False)
            x = x @ v.T @ np.diag(np.cos(s)) @ v + u @ np.diag(np.sin(s)) @ v
            length = np.linalg.norm(step)
        assert manifold.dist(x, end) < 1e-6 * h


@pytest.mark.parametrize("name", NAMES)
def test_plain_steps_are_those_of_equation_10(name, rng):
    """Each is as long as the shift, until that is within the tolerance."""
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng, n=40)
    h = narrow(manifold, points, 1.0)
    prepared = manifold.prepare(points, h)
    found = ascend(
        prepared,
        KERNELS["gaussian"],
        points[:5],
        tolerance=0.05,
        max_iterations=8,
        accelerated=False,
        record=True,
    )
    for path, converged in zip(found.paths(), found.converged, strict=True):
        path = np.stack(path)
        steps, _ = shift(prepared, KERNELS["gaussian"], path[:-1])
        np.testing.assert_allclose(manifold.exp(path[:-1], steps), path[1:], atol=1e-9)
        length = manifold.norm(path[:-1], steps) / h
        assert (length[:-1] > 0.05).all()
        assert converged == (length[-1] <= 0.05)
        assert len(path) == 9 or converged


@pytest.mark.parametrize("name", NAMES)
def test_agrees_with_the_plain_algorithm(name, rng):
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng, n=120)
    found = MeanShift(manifold, narrow(manifold, points)).fit(points)
    ends, _ = mean_shift_to_convergence(manifold, points, found.bandwidth_)
    away = manifold.dist(found.modes_[found.labels_], ends) / found.bandwidth_
    assert np.mean(away > 1) <= 0.02
    assert np.median(away) < 0.01


def assert_same_bytes(a, b):
    for attribute in ("modes_", "labels_", "densities_", "counts_"):
        assert getattr(a, attribute).tobytes() == getattr(b, attribute).tobytes()


@pytest.mark.parametrize("name", NAMES)
def test_same_seed_same_bytes(name):
    manifold = from_name(name)
    points, _, _ = clusters(manifold, np.random.default_rng(3), n=300)
    a, b = (MeanShift(manifold, n_jobs=threads, random_state=5).fit(points) for threads in (1, 2))
    assert_same_bytes(a, b)


@pytest.mark.parametrize("name", NAMES)
def test_one_point(name, rng):
    point = from_name(name).random_point(rng, 1)
    found = MeanShift(name).fit(point)
    np.testing.assert_allclose(found.modes_, point, atol=1e-6)
    assert found.labels_.tolist() == [0]
    assert found.densities_ == pytest.approx([1.0])


@pytest.mark.parametrize("name", NAMES)
def test_all_points_equal(name, rng):
    points = np.repeat(from_name(name).random_point(rng, 1), 20, axis=0)
    found = MeanShift(name).fit(points)
    assert found.counts_.tolist() == [20]
    assert found.bandwidth_ > 0


@pytest.mark.parametrize("name", NAMES)
def test_many_duplicates(name, rng):
    few = from_name(name).random_point(rng, 3)
    found = MeanShift(name).fit(np.repeat(few, [30, 20, 10], axis=0))
    assert sorted(found.counts_.tolist()) == [10, 20, 30]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("bandwidth", [1e-9, 1e-6, 1e3])
def test_extreme_bandwidths(name, bandwidth, rng):
    points = clusters(from_name(name), rng, n=30)[0]
    with np.errstate(all="ignore"):
        found = MeanShift(name, bandwidth=bandwidth).fit(points)
    assert np.isfinite(found.modes_).all()
    assert len(found.modes_) == (30 if bandwidth < 1 else 1)


@pytest.mark.parametrize("name", GROUPS)
def test_infinite_distances_keep_points_apart(name, rng):
    """Half a turn has no unique logarithm."""
    near = clusters(from_name(name), rng, n=20, count=1, scattered=0.0)[0]
    turned = near @ np.diag([-1.0, -1.0, 1.0, 1.0][: near.shape[-1]])
    with np.errstate(all="ignore"):
        found = MeanShift(name, bandwidth=0.1).fit(np.concatenate([near, turned]))
    assert not set(found.labels_[:20]) & set(found.labels_[20:])
    assert np.isfinite(found.densities_).all()


def test_saddle_points_are_dropped():
    """Half way between two equal points 3 h apart the density has a saddle, not a mode."""
    points = np.array([[-1.5, 0.0], [1.5, 0.0], [0.0, 0.0]])
    kept = MeanShift("euclidean(2)", bandwidth=1.0).fit(np.repeat(points, [30, 30, 1], axis=0))
    assert len(kept.modes_) == 2
    assert kept.counts_.sum() == 61


def test_small_modes_can_be_left_out(rng):
    points, _, _ = clusters(from_name("grassmann(3,1)"), rng, n=100)
    h = narrow(from_name("grassmann(3,1)"), points)
    whole = MeanShift("grassmann(3,1)", h).fit(points)
    part = MeanShift("grassmann(3,1)", h, min_count=5, cluster_all=False).fit(points)
    everything = MeanShift("grassmann(3,1)", h, min_count=5).fit(points)
    assert (everything.labels_ >= 0).all()
    assert (part.counts_ >= 5).all()
    assert np.sum(part.labels_ == -1) == whole.counts_[whole.counts_ < 5].sum()


def test_trajectories_on_request(rng):
    manifold = from_name("grassmann(3,1)")
    points, _, _ = clusters(manifold, rng, n=50)
    search = ModeSearch(manifold, KERNELS["gaussian"], narrow(manifold, points), record=True)
    found = find_clusters(search, points, rng)
    paths = found.paths()
    assert len(paths) == 50
    for start, path, label in zip(points, paths, found.labels, strict=True):
        np.testing.assert_array_equal(path[0], start)
        np.testing.assert_array_equal(path[-1], found.modes[label])


@pytest.mark.parametrize("bandwidth", [0.0, -1.0, np.nan, np.inf, "wide"])
def test_wrong_bandwidths_are_refused(bandwidth):
    with pytest.raises(ConfigurationError, match="bandwidth"):
        MeanShift("euclidean(2)", bandwidth=bandwidth).fit(np.zeros((3, 2)))


def test_wrong_input_is_refused():
    with pytest.raises(DataError, match="at least 1 point"):
        MeanShift("euclidean(2)").fit(np.zeros((0, 2)))
    with pytest.raises(DataError, match="shape"):
        MeanShift("euclidean(2)").fit(np.zeros((4, 3)))
    with pytest.raises(DataError, match="finite"):
        MeanShift("euclidean(2)").fit(np.full((4, 2), np.nan))
    with pytest.raises(ConfigurationError, match="kernel"):
        MeanShift("euclidean(2)", kernel="sharp").fit(np.zeros((3, 2)))


@pytest.fixture(scope="module")
def many():
    manifold = from_name("grassmann(6,2)")
    points, inside, _ = clusters(manifold, np.random.default_rng(8), n=9000)
    return manifold, points, inside


def test_a_sample_gives_the_modes_and_members_of_the_whole(many):
    manifold, points, inside = many
    h = narrow(manifold, points)
    fast = MeanShift(manifold, h).fit(points)
    exact = MeanShift(manifold, h, sample_above=None).fit(points)
    assert fast.sampled_
    assert not exact.sampled_
    assert (manifold.dist(fast.modes_[:3], exact.modes_[:3]) < 0.01 * fast.bandwidth_).all()
    np.testing.assert_allclose(fast.densities_[:3], exact.densities_[:3], rtol=1e-3)
    members = slice(0, len(inside))
    assert np.mean(fast.labels_[members] == exact.labels_[members]) > 0.995


def test_a_sample_gives_the_same_bytes_in_any_number_of_threads_and_chunks(many):
    manifold, points, _ = many
    h = narrow(manifold, points)
    a, b = (MeanShift(manifold, h, n_jobs=threads).fit(points) for threads in (1, 2))
    assert_same_bytes(a, b)
    search = ModeSearch(manifold, KERNELS["gaussian"], h)
    small = find_clusters(search, points, np.random.default_rng(0), memory_mb=2.0)
    away = np.sqrt(manifold.pairwise_dist2(small.modes[:3], a.modes_[:3])).min(axis=1)
    assert (away < 0.2 * a.bandwidth_).all()


def test_points_far_from_the_sample_have_no_mode():
    """Where the kernel sum over the sample is zero, the label is -1."""
    rng = np.random.default_rng(1)
    near, far = 0.1 * rng.standard_normal((9000, 2)), 1e3 * rng.standard_normal((20, 2))
    found = MeanShift("euclidean(2)", 0.2, cluster_all=False).fit(np.concatenate([near, far]))
    assert found.counts_[0] > 8990
    assert np.sum(found.labels_[9000:] == -1) >= 15


SCALES = [1e-12, 1e-9, 1e-3, 1e3, 1e9, 1e12]


def blobs(rng, n=240):
    """Three blobs of the plane, 8 standard deviations apart, and scattered points."""
    centres = np.array([[0.0, 0.0], [8.0, 0.0], [0.0, 8.0]])
    inside = centres[np.arange(n) % 3] + rng.standard_normal((n, 2))
    return np.concatenate([inside, rng.uniform(-4.0, 12.0, (n // 8, 2))])


@pytest.mark.parametrize("scale", SCALES)
def test_labels_do_not_depend_on_the_unit(scale, rng):
    points = blobs(rng)
    at_one = MeanShift("euclidean(2)").fit(points)
    scaled = MeanShift("euclidean(2)").fit(scale * points)
    np.testing.assert_array_equal(scaled.labels_, at_one.labels_)
    assert scaled.bandwidth_ == pytest.approx(scale * at_one.bandwidth_, rel=1e-9)
    np.testing.assert_allclose(scaled.modes_, scale * at_one.modes_, atol=1e-4 * scale)


@pytest.mark.parametrize("scale", SCALES)
def test_labels_do_not_depend_on_the_unit_of_translations(scale, rng):
    """With the length scale in the same unit."""
    manifold = from_name("special_euclidean(3)")
    points, _, _ = clusters(manifold, rng, n=150)
    at_one = MeanShift(manifold).fit(points)
    scaled = points.copy()
    scaled[:, :3, 3] *= scale
    found = MeanShift(f"special_euclidean(3,length_scale={scale!r})").fit(scaled)
    np.testing.assert_array_equal(found.labels_, at_one.labels_)


@pytest.mark.parametrize("seed", range(4))
def test_labels_do_not_depend_on_isometries_nor_on_the_order(seed):
    rng = np.random.default_rng(seed)
    points = blobs(rng)
    whole = MeanShift("euclidean(2)").fit(points)
    labels = whole.labels_
    turn = np.linalg.qr(rng.standard_normal((2, 2)))[0]
    order = rng.permutation(len(points))
    for moved in (points @ turn, points + 1e6, (points - 300.0) @ turn):
        found = MeanShift("euclidean(2)").fit(moved).labels_
        assert np.mean(found != labels) == 0
    found = MeanShift("euclidean(2)", whole.bandwidth_).fit(points[order]).labels_
    expected = labels[order]
    np.testing.assert_array_equal(found[:, None] == found, expected[:, None] == expected)


@pytest.mark.parametrize("name", ["special_euclidean(3)", "affine(2,exact)"])
def test_labels_do_not_depend_on_a_common_translation(name, rng):
    """Poses in coordinates of a map: hundreds of kilometres away, clusters of a metre."""
    manifold = from_name(name)
    points, _, _ = clusters(manifold, rng, n=120)
    labels = MeanShift(manifold).fit(points).labels_
    far = np.eye(manifold.size)
    far[:2, -1] = (4.5e5, 5.4e6)
    np.testing.assert_array_equal(MeanShift(manifold).fit(far @ points).labels_, labels)


def test_an_outlier_leaves_the_digits_of_the_others(rng):
    """Squared distances beside a point at 1e6 standard deviations."""
    points = blobs(rng)
    remote = np.concatenate([points, [[1e6, -1e6]], [[1e9, 1e9]]])
    for precise, tolerance in ((True, 1e-12), (False, 1e-2)):
        z = Euclidean(2).prepare(remote, 0.5, precise).block(remote).scaled_sq_dist
        exact = np.sum((remote[:, None] - remote) ** 2, axis=-1) / 0.25
        np.testing.assert_allclose(z, exact, rtol=tolerance, atol=tolerance)
    labels = MeanShift("euclidean(2)", 0.7).fit(points).labels_
    beside = MeanShift("euclidean(2)", 0.7).fit(remote).labels_
    np.testing.assert_array_equal(beside[:-2, None] == beside[:-2], labels[:, None] == labels)


@pytest.mark.parametrize("length", [2.5, 5.0, 6.0, 8.0, 12.0])
@pytest.mark.parametrize("bandwidth", [0.3, 1.0, 1.5])
@pytest.mark.parametrize("name", [name for name in GROUPS if "exact" in name])
def test_two_tight_clusters_at_any_distance_are_one_or_two_modes(name, bandwidth, length, rng):
    manifold = from_name(name)
    x = manifold.random_point(rng, 1)
    centres = np.concatenate([x, manifold.exp(x, length * manifold.random_tangent(x, rng))])
    at = np.repeat(centres, 15, axis=0)
    points = manifold.exp(at, 0.02 * manifold.random_tangent(at, rng))
    found = MeanShift(manifold, bandwidth).fit(points)
    assert np.isfinite(found.modes_).all()
    assert np.isfinite(found.densities_).all()
    assert len(found.modes_) <= 2
