"""Structures in data that is no picture: the estimator, and its sampling without a threshold."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from mssegment import MultiModel, models
from mssegment.errors import ConfigurationError, DataError
from mssegment.evaluation import evaluate
from mssegment.records import replace
from mssegment.sampling.null_model import NullModel, draw_chimeras
from mssegment.sampling.options import SamplingOptions
from mssegment.sampling.structures import _Data, measured_log_tests, optimized
from tests.structures import bodies, hyperplanes, spheres, subspaces

CASES = {
    "line": (hyperplanes, {}, {}),
    "plane": (hyperplanes, {"dimension": 3, "per": 100, "outliers": 200}, {}),
    "hyperplane": (hyperplanes, {"dimension": 5, "per": 100, "outliers": 150}, {}),
    "subspace": (subspaces, {}, {"rank": 2}),
    "quadric": (spheres, {"per": 100, "outliers": 60}, {}),
    "rigid3d": (bodies, {}, {}),
}


def error(found: MultiModel, truth: np.ndarray) -> float:
    return evaluate(found.labels_ + 1, truth).misclassification


@pytest.mark.parametrize("name", CASES)
def test_number_and_labels_of_structures(name: str) -> None:
    """Neither the number nor the noise is given; a line crosses others, where nobody can tell."""
    make, data, parameters = CASES[name]
    points, truth = make(np.random.default_rng(7), **data)
    found = MultiModel(name, **parameters).fit(points)
    assert found.n_structures_ == truth.max()
    assert error(found, truth) < 0.08
    assert len(found.structures_) == len(found.scales_) == found.n_structures_
    sizes = [len(each.inliers) for each in found.structures_]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize("noise", [0.002, 0.005, 0.02])
def test_the_noise_is_measured(noise: float) -> None:
    points, _ = hyperplanes(np.random.default_rng(3), count=2, noise=noise)
    found = MultiModel("line").fit(points)
    assert found.n_structures_ == 2
    assert found.scales_ == pytest.approx([noise, noise], rel=0.3)


@pytest.mark.parametrize("name", ["line", "hyperplane"])
@pytest.mark.parametrize("kind", ["uniform", "normal", "clusters"])
def test_no_structure_is_a_result(name: str, kind: str) -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform(-1.0, 1.0, (200, 3))
    if kind == "normal":
        points = rng.standard_normal((200, 3))
    if kind == "clusters":
        points = rng.integers(4, size=(200, 1)) * [[3.0, 1.0, 2.0]] + rng.standard_normal((200, 3))
    found = MultiModel(name).fit(points)
    assert found.n_structures_ == 0
    assert set(found.labels_) == {-1}
    assert found.predict(points).tolist() == [-1] * 200


def test_one_structure_without_outliers() -> None:
    points, _ = hyperplanes(np.random.default_rng(2), count=1, outliers=0)
    found = MultiModel("line").fit(points)
    assert found.n_structures_ == 1
    assert (found.labels_ == 0).mean() > 0.95


@pytest.mark.parametrize("factor", [1e-12, 1.0, 1e12])
def test_the_unit_and_the_origin_do_not_matter(factor: float) -> None:
    points, truth = hyperplanes(np.random.default_rng(4), count=2)
    found = MultiModel("line").fit(factor * (points + np.array([3.0, -5.0])))
    assert found.n_structures_ == 2
    assert error(found, truth) < 0.08
    assert found.scales_ == pytest.approx(factor * np.array([0.01, 0.01]), rel=0.35)


def test_a_few_points_far_away_do_not_matter() -> None:
    points, truth = hyperplanes(np.random.default_rng(4), count=2)
    points[truth == 0][:5] *= 1e6
    assert MultiModel("line").fit(points).n_structures_ == 2


def test_the_seed_decides_and_threads_do_not() -> None:
    points, _ = hyperplanes(np.random.default_rng(6), count=2)
    one, two = (MultiModel("line", random_state=3, n_jobs=n).fit(points) for n in (1, 2))
    assert np.array_equal(one.labels_, two.labels_)
    for a, b in zip(one.structures_, two.structures_, strict=True):
        assert np.array_equal(a.point, b.point)


def test_equations_hold_on_the_inliers() -> None:
    points, _ = hyperplanes(np.random.default_rng(1), count=2, dimension=3, per=100)
    found = MultiModel("plane").fit(points)
    for plane in found.structures_:
        assert np.linalg.norm(plane.coefficients[:3]) == pytest.approx(1.0)
        own = points[plane.inliers]
        miss = own @ plane.coefficients[:3] + plane.coefficients[3]
        assert np.abs(miss).max() == pytest.approx(plane.limit, rel=1e-6)
    points, _ = hyperplanes(np.random.default_rng(1), count=2)
    space = np.column_stack([points, np.zeros(len(points))])
    for line in MultiModel("line").fit(space).structures_:
        away = space[line.inliers] - line.origin
        away -= (away @ line.basis) @ line.basis.T
        assert np.linalg.norm(away, axis=1).max() == pytest.approx(line.limit, rel=1e-6)
    points, _ = spheres(np.random.default_rng(1))
    for quadric in MultiModel("quadric").fit(points).structures_:
        raised = np.column_stack([points[quadric.inliers], np.ones(len(quadric.inliers))])
        gradient = 2 * np.linalg.norm((raised @ quadric.matrix)[:, :3], axis=1)
        values = np.einsum("pi,ij,pj->p", raised, quadric.matrix, raised)
        assert np.abs(values / gradient).max() < 0.06
    points, _ = bodies(np.random.default_rng(1))
    for body in MultiModel("rigid3d").fit(points).structures_:
        first, second = np.moveaxis(points[body.inliers], 1, 0)
        moved = first @ body.matrix[:3, :3].T + body.matrix[:3, 3]
        assert np.linalg.norm(moved - second, axis=1).max() < 0.08


def test_new_points_belong_to_the_nearest_structure() -> None:
    points, _ = hyperplanes(np.random.default_rng(8), count=2)
    found = pickle.loads(pickle.dumps(MultiModel("line").fit(points)))
    assert (found.predict(points) == found.labels_).mean() > 0.98
    for k, line in enumerate(found.structures_):
        a, b, c = line.coefficients
        foot = -c * np.array([[a, b]])
        apart = np.abs(found.residuals(foot)[1 - k]) > 3 * found.structures_[1 - k].limit
        assert not apart or found.predict(foot) == [k]


def test_a_given_number_is_kept() -> None:
    points, truth = hyperplanes(np.random.default_rng(9), count=3)
    assert MultiModel("line", n_structures=2).fit(points).n_structures_ == 2
    assert MultiModel("line", n_structures=0).fit(points).n_structures_ == 0
    exact = MultiModel("line", n_structures=3).fit(points)
    assert exact.n_structures_ == 3
    assert error(exact, truth) < 0.1


def test_many_points_are_selected_on_a_sample() -> None:
    rng = np.random.default_rng(10)
    points, truth = hyperplanes(rng, count=2, dimension=3, per=3000, outliers=3000)
    found = MultiModel("plane").fit(points)
    assert found.n_structures_ == 2
    assert error(found, truth) < 0.06


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"model": "affine"}, "model must be one of hyperplane"),
        ({"model": "circle"}, "found 'circle'"),
        ({"model": "subspace"}, "needs rank, the dimension of its subspaces"),
        ({"model": "line", "rank": 1}, "rank has no effect on model line"),
        ({"bandwidth": None}, "found None"),
        ({"random_state": -1}, "at least 0"),
        ({"model": "subspace", "rank": 3}, "from 1 to 2"),
        (
            {"model": "subspace", "rank": 0},
            "rank must be None or a whole number of at least 1, found 0",
        ),
        ({"n_structures": -1}, "n_structures must be"),
        ({"n_hypotheses": "many"}, "n_hypotheses must be 'auto'"),
        ({"bandwidth": -1.0}, "bandwidth must be 'auto' or a positive number"),
    ],
)
def test_wrong_parameters(parameters: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        MultiModel(**parameters).fit(np.random.default_rng(0).normal(size=(50, 3)))


@pytest.mark.parametrize(
    ("model", "points", "message"),
    [
        ("plane", np.zeros((50, 2)), "3 is required by model plane"),
        ("rigid3d", np.zeros((50, 3)), r"wants \[n, 2, 3\]"),
        ("line", np.eye(3), r"3 sample\(s\)"),
        ("line", np.full((50, 2), np.nan), "not finite"),
        ("line", np.ones((50, 2)), "elemental subsets are degenerate"),
        ("plane", np.arange(150.0).reshape(50, 3), "elemental subsets are degenerate"),
    ],
)
def test_wrong_data(model: str, points: np.ndarray, message: str) -> None:
    with pytest.raises(DataError, match=message):
        MultiModel(model).fit(points)


def test_scikit_learns_checks() -> None:
    """All of ``check_estimator``, without exceptions; few hypotheses, for speed."""
    checks = pytest.importorskip("sklearn.utils.estimator_checks", reason="needs scikit-learn")
    checks.check_estimator(MultiModel(n_hypotheses=5))


def test_optimized_hypotheses_are_more_meaningful() -> None:
    rng = np.random.default_rng(0)
    points, truth = hyperplanes(rng, count=1, per=60, outliers=60)
    model = models.make("line")
    observed = model.observe(points[:, None], model.normalization(points[:, None]))
    null = NullModel.of(model, observed, rng)
    rough, _ = model.minimal_fit(observed[rng.integers(len(points), size=(200, 2))])
    before = optimized(null, observed, rough, rounds=0)[2]
    found, inliers, after = optimized(null, observed, rough)
    assert (after <= before).all()
    best = after.argmin()
    assert after[best] < -10.0
    assert truth[inliers[best]].mean() > 0.9
    model.manifold.check_point(found)


def test_chimeras_lie_where_the_data_lie() -> None:
    rng = np.random.default_rng(0)
    data = rng.uniform(2.0, 3.0, (500, 1, 3)) * [1.0, 2.0, 3.0]
    drawn = draw_chimeras(data, 800, rng)
    assert drawn.shape == (800, 1, 3)
    assert drawn.mean(axis=0) == pytest.approx(data.mean(axis=0), rel=0.05)
    assert drawn.std(axis=0).sum() == pytest.approx(data.std(axis=0).sum(), rel=0.1)
    pairs = rng.standard_normal((50, 2, 3))
    mixed = draw_chimeras(pairs, 100, rng)
    assert all((mixed[:, f, None] == pairs[:, f]).all(axis=2).any(axis=1).all() for f in (0, 1))


@pytest.mark.parametrize(("name", "dimension"), [("line", 2), ("plane", 3), ("hyperplane", 4)])
@pytest.mark.parametrize("spread", [0.01, 0.1])
def test_tight_clusters_are_no_structures(name: str, dimension: int, spread: float) -> None:
    """Three of them always lie on a plane."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        centres = rng.uniform(-1.0, 1.0, (dimension + 1, 1, dimension))
        points = centres + spread * rng.standard_normal((dimension + 1, 60, dimension))
        found = MultiModel(name, random_state=seed).fit(points.reshape(-1, dimension))
        assert found.n_structures_ == 0


@pytest.mark.parametrize(("name", "dimension"), [("line", 2), ("plane", 3)])
def test_many_small_clusters_are_no_structures(name: str, dimension: int) -> None:
    """Each with a fourteenth of the points."""
    for seed in range(2):
        rng = np.random.default_rng(seed)
        centres = rng.uniform(-1.0, 1.0, (14, 1, dimension))
        points = centres + 0.03 * rng.standard_normal((14, 50, dimension))
        assert MultiModel(name).fit(points.reshape(-1, dimension)).n_structures_ == 0


def test_noisy_hyperplanes_are_found() -> None:
    """Four times the usual noise, half outliers: one subset in 3000 is clean."""
    points, truth = hyperplanes(
        np.random.default_rng(3), dimension=5, per=100, outliers=300, noise=0.04
    )
    found = MultiModel("hyperplane").fit(points)
    assert found.n_structures_ == 3
    assert error(found, truth) < 0.26
    assert found.scales_.mean() == pytest.approx(0.04, rel=0.15)


def test_the_number_of_tests_is_what_data_without_structure_need() -> None:
    """Fewer than elemental subsets, and enough: the best of another set is about as likely."""
    rng = np.random.default_rng(2)
    model = models.make("plane")
    points, other = rng.standard_normal((2, 300, 1, 3))
    data, apart = (_Data.of(model, x / np.sqrt(3.0), rng) for x in (points, other))
    measured = measured_log_tests(data, SamplingOptions(), rng)
    assert 0.0 < measured < data.null.log_tests - 5.0
    null = replace(apart.null, log_tests=measured)
    rough, valid = model.minimal_fit(apart.observed[rng.integers(300, size=(500, 3))])
    assert abs(optimized(null, apart.observed, rough[valid])[2].min()) < 8.0
