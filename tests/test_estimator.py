"""The estimator: scikit-learn's contract, weights, seeds, several bandwidths, defaults."""

from __future__ import annotations

import pickle
import subprocess
import sys

import numpy as np
import pytest
import scipy.stats

from mssegment import MultiModel
from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import MANIFOLDS, Euclidean, Rotations, Sphere, from_name
from mssegment.meanshift import ConvergenceWarning, Kernel, MeanShift, auto_bandwidth
from mssegment.meanshift.kernels import Gaussian

CENTRES = np.array([[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) + 10.0


def blobs(rng, n=300, spread=0.4, centres=CENTRES):
    """The three blobs of scikit-learn's tests, and their labels."""
    label = np.arange(n) % len(centres)
    return centres[label] + spread * rng.standard_normal((n, centres.shape[1])), label


def same_partition(a, b):
    return np.array_equal(a[:, None] == a, b[:, None] == b)


def test_scikit_learns_checks():
    """All of ``check_estimator``, without exceptions."""
    checks = pytest.importorskip("sklearn.utils.estimator_checks", reason="needs scikit-learn")
    checks.check_estimator(MeanShift())


def test_clone_and_grid_of_parameters():
    base = pytest.importorskip("sklearn.base", reason="needs scikit-learn")
    kernel = Gaussian()
    bandwidths = np.array([0.5, 1.0])
    manifold = Sphere(2)
    original = MeanShift(manifold, bandwidths, kernel, min_count=3, random_state=4)
    copy = base.clone(original)
    assert copy.get_params()["min_count"] == 3
    assert copy.manifold.name == manifold.name
    np.testing.assert_array_equal(copy.bandwidth, bandwidths)
    assert base.is_clusterer(original)


def test_scikit_learn_is_not_imported():
    code = (
        "import sys, numpy as np; from mssegment.meanshift import MeanShift; "
        "m = MeanShift().fit(np.eye(3)); m.predict(np.eye(3)); repr(m); m.get_params(); "
        "print('sklearn' in sys.modules, 'scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_parameters_are_stored_untouched():
    bandwidth, seeds, kernel = np.ones(3), [[0.0]], Gaussian()
    estimator = MeanShift("euclidean", bandwidth, kernel, seeds=seeds)
    assert estimator.bandwidth is bandwidth
    assert estimator.seeds is seeds
    assert estimator.kernel is kernel
    assert estimator.set_params(min_count=2).min_count == 2
    assert "min_count=2" in repr(estimator)
    with pytest.raises(ValueError, match="Invalid parameter 'radius'"):
        estimator.set_params(radius=1.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("bandwidth", -1.0),
        ("bandwidth", "wide"),
        ("bandwidth", [1.0, -1.0]),
        ("bandwidth", np.nan),
        ("min_count", -1),
        ("min_count", 1.5),
        ("max_iter", 0),
        ("sample_above", -5),
        ("n_jobs", 0),
        ("n_jobs", "two"),
        ("random_state", "seed"),
        ("random_state", -1),
        ("bandwidth", True),
        ("bandwidth", 1e300),
        ("cluster_all", "yes"),
        ("callback", 3),
        ("kernel", "sharp"),
        ("kernel", 3),
        ("manifold", "moon"),
        ("manifold", 7),
        ("manifold", "product"),
    ],
)
def test_wrong_parameters_are_named(name, value):
    with pytest.raises(ConfigurationError, match=name.split("_")[0]):
        MeanShift(**{name: value}).fit(np.zeros((2, 2)) + np.arange(2.0))


def test_the_second_argument_of_fit_is_ignored(rng):
    points, label = blobs(rng)
    without = MeanShift().fit(points)
    np.testing.assert_array_equal(MeanShift().fit(points, label).labels_, without.labels_)
    np.testing.assert_array_equal(MeanShift().fit_predict(points, label), without.labels_)


@pytest.mark.parametrize("seed", range(5))
def test_three_blobs_at_default_settings(seed):
    """As well as the nearest true centre, which knows them."""
    adjusted_rand = pytest.importorskip("sklearn.metrics").adjusted_rand_score
    points, label = blobs(np.random.default_rng(seed))
    found = MeanShift().fit(points)
    assert len(found.cluster_centers_) == 3
    nearest = np.linalg.norm(points[:, None] - CENTRES, axis=2).argmin(axis=1)
    best = adjusted_rand(label, nearest)
    assert adjusted_rand(label, found.labels_) >= best - 0.03


def test_new_points_belong_to_the_mode_that_they_reach(rng):
    points, label = blobs(rng, spread=0.2)
    found = MeanShift().fit(points)
    np.testing.assert_array_equal(found.predict(points), found.labels_)
    new = CENTRES + 0.1
    np.testing.assert_array_equal(
        found.predict(new), [found.labels_[label == i][0] for i in range(3)]
    )
    far = [[1e3, 1e3]]
    assert found.predict(far)[0] >= 0
    assert MeanShift(cluster_all=False).fit(points).predict(far).tolist() == [-1]
    assert same_partition(pickle.loads(pickle.dumps(found)).predict(points), found.labels_)


def test_an_unfitted_estimator_says_so():
    with pytest.raises(ValueError, match="not fitted"):
        MeanShift().predict(np.zeros((2, 2)))


def test_weights_are_repetitions(rng):
    points, _ = blobs(rng, n=60)
    weights = rng.integers(0, 4, 60)
    weighted = MeanShift().fit(points, sample_weight=weights)
    repeated = MeanShift().fit(np.repeat(points, weights, axis=0))
    assert weighted.bandwidth_ == pytest.approx(repeated.bandwidth_, rel=1e-12)
    np.testing.assert_allclose(weighted.cluster_centers_, repeated.cluster_centers_, atol=1e-3)
    np.testing.assert_allclose(weighted.densities_, repeated.densities_, rtol=1e-6)
    np.testing.assert_array_equal(weighted.predict(points), repeated.predict(points))


def test_a_weight_moves_the_mode():
    points = np.array([[0.0], [1.0]])
    found = MeanShift(bandwidth=2.0).fit(points, sample_weight=[3.0, 1.0])
    even = MeanShift(bandwidth=2.0).fit(points)
    assert even.cluster_centers_[0, 0] == pytest.approx(0.5, abs=1e-3)
    assert found.cluster_centers_[0, 0] < 0.3


@pytest.mark.parametrize(
    "weights", [[1.0], [[1.0, 1.0]], [-1.0, 1.0], [np.nan, 1.0], [0.0, 0.0], "ab", [1e300, 1.0]]
)
def test_wrong_weights_are_refused(weights):
    with pytest.raises(DataError, match="weight"):
        MeanShift().fit(np.eye(2), sample_weight=weights)


def test_seeds_are_where_trajectories_start(rng):
    points, label = blobs(rng, spread=0.2)
    found = MeanShift(seeds=CENTRES[:2] + 0.05).fit(points)
    assert len(found.cluster_centers_) == 2
    assert set(found.labels_[label == 2]) <= {0, 1}
    apart = MeanShift(seeds=CENTRES[:2] + 0.05, cluster_all=False).fit(points)
    assert (apart.labels_[label == 2] == -1).all()
    with pytest.raises(DataError, match="shape"):
        MeanShift(seeds=np.zeros((1, 5))).fit(points)


def test_bandwidths_of_single_points(rng):
    """Equal ones are one bandwidth; those of neighbours resolve dense clusters by a wide one."""
    points, _ = blobs(rng, n=90)
    one = MeanShift(bandwidth=0.4).fit(points)
    each = MeanShift(bandwidth=np.full(90, 0.4)).fit(points)
    np.testing.assert_array_equal(each.labels_, one.labels_)
    np.testing.assert_allclose(each.densities_, one.densities_, rtol=1e-5)
    dense = np.concatenate(
        [0.01 * rng.standard_normal((60, 2)), [0.15, 0.0] + 0.01 * rng.standard_normal((60, 2))]
    )
    wide = np.array([20.0, 0.0]) + 2.0 * rng.standard_normal((60, 2))
    found = MeanShift(bandwidth="knn").fit(np.concatenate([dense, wide]))
    assert found.bandwidth_.shape == (180,)
    labels = found.labels_
    assert len(set(labels[:60])) == 1
    assert len(set(labels[60:120])) == 1
    assert labels[0] != labels[60]
    assert np.bincount(labels[120:]).max() > 50


def test_a_kernel_of_ones_own(rng):
    class Cauchy(Kernel):
        """k(z) = 1 / (1 + z)."""

        name = "cauchy"

        def profile(self, z):
            return 1.0 / (1.0 + z)

        def weights(self, z):
            profile = self.profile(z)
            return profile**2, profile.sum(axis=1)

    points, label = blobs(rng, spread=0.1)
    found = MeanShift(bandwidth=0.3, kernel=Cauchy()).fit(points)
    assert same_partition(found.labels_, label)


def test_convergence_is_reported(rng):
    points, _ = blobs(rng)
    assert MeanShift().fit(points).converged_
    with pytest.warns(ConvergenceWarning, match="max_iter"):
        assert not MeanShift(max_iter=1).fit(points).converged_


def test_progress_is_reported(rng):
    steps = []
    MeanShift(callback=lambda step, active: steps.append((step, active))).fit(blobs(rng)[0])
    assert steps[0][0] == 1
    assert all(active <= 300 for _, active in steps)


def test_matrices_may_be_given_as_rows(rng):
    group = Rotations(3)
    centres = group.random_point(rng, 2)
    at = centres[np.arange(60) % 2]
    points = group.exp(at, 0.05 * group.random_tangent(at, rng))
    found = MeanShift("so3").fit(points.reshape(60, 9))
    assert found.cluster_centers_.shape == (2, 9)
    assert found.n_features_in_ == 9
    named = MeanShift("special_orthogonal").fit(points)
    assert named.cluster_centers_.shape == (2, 3, 3)
    np.testing.assert_array_equal(named.labels_, found.labels_)


@pytest.mark.parametrize(
    "name",
    ["euclidean(2)", "sphere(2)", "spd(2)", "special_orthogonal(3)", "special_euclidean(3)"],
)
@pytest.mark.parametrize("seed", range(3))
def test_outliers_leave_the_densest_mode_where_the_inliers_are(name, seed):
    """60 % outliers, default bandwidth: hardly worse than the mean of the true inliers."""
    rng = np.random.default_rng(seed)
    manifold = from_name(name)
    centre = manifold.random_point(rng, 1)
    at = np.repeat(centre, 80, axis=0)
    inliers = manifold.exp(at, manifold.project_tangent(at, 0.05 * rng.standard_normal(at.shape)))
    outliers = manifold.random_point(rng, 120)
    found = MeanShift(manifold).fit(np.concatenate([inliers, outliers]))
    mean = centre
    for _ in range(20):
        mean = manifold.exp(mean, manifold.log(mean, inliers).mean(axis=0)[None])
    noise = np.sqrt(np.mean(manifold.dist(at, inliers) ** 2) / 80)
    error = manifold.dist(found.cluster_centers_[:1], centre)[0]
    assert error <= manifold.dist(mean, centre)[0] + 2.5 * noise


def test_auto_bandwidth_is_the_rule():
    points = np.concatenate([np.arange(25.0), 100.0 + 3.0 * np.arange(75)])[:, None]
    found = auto_bandwidth(Euclidean(1), points, np.random.default_rng(0))
    distances = np.sort(np.abs(points - points.T), axis=1)[:, 10]
    deviation = np.quantile(distances, 0.25) / scipy.stats.chi(1).ppf(0.3)
    assert found == pytest.approx(5 / 3 * deviation * (4 / 5 / (100 / 3)) ** (1 / 7))
    weighted = auto_bandwidth(Euclidean(1), points, np.random.default_rng(0), np.ones(100))
    assert weighted == pytest.approx(found)


def chain_of_clusters(manifold, rng, per=70, deviation=0.05, apart=6.0):
    """Three normal clusters, each so many standard deviations from the next."""
    centre = manifold.random_point(rng, 1)[0]
    step = manifold.random_tangent(centre, rng)
    step *= apart * deviation / manifold.norm(centre, step)
    parts = []
    for k in range(3):
        own = np.broadcast_to(manifold.exp(centre, k * step), (per, *centre.shape))
        tangents = manifold.random_tangent(own, rng)
        radii = deviation * np.sqrt(rng.chisquare(manifold.dim, per)) / manifold.norm(own, tangents)
        parts.append(manifold.exp(own, radii.reshape(-1, *[1] * centre.ndim) * tangents))
    return np.concatenate(parts)


@pytest.mark.parametrize(
    "name",
    ["euclidean(1)", "euclidean(2)", "euclidean(8)", "so2", "so3", "spd(2)", "sphere(2)"],
)
def test_auto_bandwidth_tells_clusters_in_any_dimension(name):
    manifold = from_name(name)
    counts = [
        MeanShift(manifold).fit(chain_of_clusters(manifold, np.random.default_rng(seed))).counts_
        for seed in range(6)
    ]
    assert sum(np.count_nonzero(count > 3) == 3 for count in counts) >= 5


MASKED = np.ma.masked_array(np.eye(3), mask=np.eye(3) > 0)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (MASKED, "masked values"),
        (np.array([["2020-01-01", "2021-01-01"]], dtype="M8[D]"), "must be numbers"),
        ([["1", "2"]], "must be numbers"),
        ([[1.0, 2.0], [3.0]], "must be an array of numbers"),
        ([[{}, 1.0]], "must be an array of numbers"),
        (1e300 * np.eye(3), "choose another unit"),
        (1e-200 * np.eye(3), "choose another unit"),
    ],
)
@pytest.mark.parametrize("estimator", [MeanShift(), MultiModel("line")])
def test_what_is_no_number_is_refused(estimator, points, message):
    with pytest.raises(DataError, match=message):
        estimator.fit(points)


def test_data_frames_are_no_masked_arrays(rng):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(rng.standard_normal((20, 2)), columns=["a", "b"])
    assert MeanShift().fit(frame).feature_names_in_.tolist() == ["a", "b"]


@pytest.mark.parametrize("name", ["stiefel(4,2)", "so3", "sphere(3)", "grassmann(5,2)"])
def test_points_in_single_precision_are_projected(name, rng):
    """On Stiefel manifolds, logarithms of points that are 1e-7 off gave three times the modes."""
    manifold = from_name(name)
    points = manifold.random_point(rng, 30).astype(np.float32)
    found, exact = (MeanShift(manifold).fit(x) for x in (points, manifold.project(points)))
    np.testing.assert_array_equal(found.labels_, exact.labels_)


@pytest.mark.parametrize("name", ["essential", "special_orthogonal", "se2", "se3", "spd", "affine"])
def test_families_of_square_matrices_may_be_rows(name, rng):
    member = from_name(MANIFOLDS[name].examples[0] if name in MANIFOLDS else name)
    points = member.random_point(rng, 12)
    rows = MeanShift(name).fit(points.reshape(12, -1))
    np.testing.assert_array_equal(rows.labels_, MeanShift(name).fit(points).labels_)


def test_seeds_far_from_all_points_are_refused():
    with pytest.raises(DataError, match="no seed is near a point"):
        MeanShift(bandwidth=0.1, seeds=[[1e3, 1e3]]).fit(np.eye(2))


def test_as_many_bandwidths_as_points():
    with pytest.raises(DataError, match="one for each of 3 points, found 2"):
        MeanShift(bandwidth=[1.0, 2.0]).fit(np.eye(3))
