"""Fusion of measurements with outliers: accuracy, units, files, errors."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mssegment.cli import invoke
from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import Euclidean, Sphere, from_name
from mssegment.meanshift import fuse


def poses(rng, n=200, outliers=0.6, unit=1.0):
    """Measurements of one pose, 1.2 degrees and 5 cm each, and poses anywhere in a room."""
    good = round(n * (1 - outliers))
    true = np.eye(4)
    true[:3, :3] = Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix()
    true[:3, 3] = unit * rng.uniform(-5, 5, 3)
    points = np.tile(np.eye(4), (n, 1, 1))
    noise = Rotation.from_rotvec(0.02 * rng.standard_normal((good, 3))).as_matrix()
    points[:good, :3, :3] = true[:3, :3] @ noise
    points[:good, :3, 3] = true[:3, 3] + 0.05 * unit * rng.standard_normal((good, 3))
    seed = int(rng.integers(1 << 30))
    if n > good:
        points[good:, :3, :3] = Rotation.random(n - good, random_state=seed).as_matrix()
    points[good:, :3, 3] = unit * rng.uniform(-5, 5, (n - good, 3))
    return points, true, good


def errors(pose, true):
    """Radians, and the unit of translations."""
    turn = Rotation.from_matrix(true[:3, :3].T @ pose[:3, :3]).magnitude()
    return np.array([turn, np.linalg.norm(pose[:3, 3] - true[:3, 3])])


@pytest.mark.parametrize("unit", [1.0, 1000.0])
def test_poses_with_outliers_are_fused_as_well_as_the_inliers_alone(unit):
    """Over 20 scenes, at most 1.2 times the error of the mean of the true inliers."""
    own, best = [], []
    for seed in range(20):
        points, true, good = poses(np.random.default_rng(seed), unit=unit)
        found = fuse(points, "se3")
        own.append(errors(found.modes[0].point, true))
        mean = np.eye(4)
        mean[:3, :3] = Rotation.from_matrix(points[:good, :3, :3]).mean().as_matrix()
        mean[:3, 3] = points[:good, :3, 3].mean(axis=0)
        best.append(errors(mean, true))
    ratio = np.sqrt(np.mean(np.square(own), axis=0) / np.mean(np.square(best), axis=0))
    assert (ratio < 1.2).all()


def test_the_unit_does_not_matter(rng):
    points, _, _ = poses(rng)
    scaled = points.copy()
    scaled[:, :3, 3] *= 1000.0
    a, b = fuse(points, "se3"), fuse(scaled, "se3")
    np.testing.assert_array_equal(a.labels, b.labels)
    assert b.manifold.length_scale == pytest.approx(1000.0 * a.manifold.length_scale)
    np.testing.assert_allclose(b.modes[0].point[:3, 3], 1000 * a.modes[0].point[:3, 3], rtol=1e-9)


def test_support_and_covariance_are_those_of_the_inliers(rng):
    points, _, good = poses(rng, n=1000)
    mode = fuse(points, "se3").modes[0]
    inside = set(mode.support.tolist())
    assert len(inside & set(range(good))) > 0.97 * good
    assert len(inside - set(range(good))) < 0.02 * good
    deviations = np.sqrt(np.diag(mode.covariance))
    np.testing.assert_allclose(deviations[:3], 0.02, rtol=0.12)
    np.testing.assert_allclose(deviations[3:], 0.05, rtol=0.12)


def test_two_values_are_two_modes(rng):
    first, _, _ = poses(rng, n=60, outliers=0.0)
    second, _, _ = poses(rng, n=40, outliers=0.0)
    found = fuse(np.concatenate([first, second]), "se3")
    assert [len(mode.support) for mode in found.modes] == pytest.approx([60, 40], abs=2)
    assert set(found.labels[:60]) <= {0, -1}


def test_weights_count(rng):
    points = np.concatenate([rng.normal(0.0, 0.1, 30), rng.normal(3.0, 0.1, 20)])[:, None]
    assert fuse(points, "euclidean").modes[0].point[0] == pytest.approx(0.0, abs=0.2)
    weights = np.repeat([1.0, 3.0], [30, 20])
    found = fuse(points, Euclidean(1), weights)
    assert found.modes[0].point[0] == pytest.approx(3.0, abs=0.2)
    assert found.modes[0].weight == pytest.approx(60.0, abs=6.0)


def test_measurements_with_four_decimals_are_projected(rng):
    points, _, _ = poses(rng)
    found = fuse(points.round(4), "se3")
    assert 1e-6 < found.corrected < 1e-3
    found.manifold.check_point(found.modes[0].point, tolerance=1e-12)
    points[7, :3, :3] *= 1.2
    with pytest.raises(DataError, match="measurement 7"):
        fuse(points, "se3")


@pytest.mark.parametrize(
    "name", ["sphere(2)", "spd(2)", "so2", "se2", "essential", "grassmann(3,1)"]
)
def test_other_manifolds(name, rng):
    manifold = from_name(name)
    at = np.repeat(manifold.random_point(rng, 1), 60, axis=0)
    good = manifold.exp(at, manifold.project_tangent(at, 0.03 * rng.standard_normal(at.shape)))
    points = np.concatenate([good, manifold.random_point(rng, 60)])
    mode = fuse(points, name).modes[0]
    assert manifold.dist(mode.point, at[0]) < 0.04
    assert len(set(mode.support.tolist()) & set(range(60))) > 50


def test_coordinates_of_tangents(rng):
    """Orthonormal in general; rotation vector and translation for rigid motions."""
    for name in ("sphere(3)", "spd(2)", "stiefel(4,2)", "affine(2)", "essential"):
        manifold = from_name(name)
        x = manifold.random_point(rng, 1)[0]
        v = manifold.project_tangent(
            np.broadcast_to(x, (5, *x.shape)), rng.standard_normal((5, *x.shape))
        )
        coordinates = manifold.coordinates(x, v)
        assert coordinates.shape == (5, manifold.dim)
        np.testing.assert_allclose(np.linalg.norm(coordinates, axis=1), manifold.norm(x, v))
        rebuilt = np.tensordot(coordinates, manifold.tangent_basis(x), axes=1)
        np.testing.assert_allclose(rebuilt, v, atol=1e-12)
    group = from_name("se3(length_scale=3)")
    turn = np.zeros((1, 4, 4))
    turn[0, 1, 0], turn[0, 0, 1], turn[0, 0, 3] = 0.5, -0.5, 7.0
    np.testing.assert_allclose(
        group.coordinates(np.eye(4), turn), [[0, 0, 0.5, 7, 0, 0]], atol=1e-12
    )


@pytest.fixture
def written(tmp_path, rng):
    """One set of poses in every format, millimetres in the table."""
    points, true, _ = poses(rng)
    q = Rotation.from_matrix(points[:, :3, :3]).as_quat()
    rows = np.column_stack([np.arange(200.0), points[:, :3, 3], q])
    np.savetxt(tmp_path / "tum.txt", rows, fmt="%.6f", header="time tx ty tz qx qy qz qw")
    np.savetxt(tmp_path / "kitti.txt", points[:, :3].reshape(200, 12), fmt="%.4f")
    names = "qw,x,y,z,qx,qy,qz"
    table = np.column_stack([q[:, 3], points[:, :3, 3], q[:, :3]])
    np.savetxt(tmp_path / "named.csv", table, fmt="%.5f", delimiter=",", header=names, comments="")
    np.save(tmp_path / "array.npy", points)
    np.save(tmp_path / "rows.npy", points[:, :3].reshape(200, 12))
    (tmp_path / "list.json").write_text(json.dumps({"poses": points.tolist()}))
    return tmp_path, true


@pytest.mark.parametrize(
    "file", ["tum.txt", "kitti.txt", "named.csv", "array.npy", "rows.npy", "list.json"]
)
def test_files_of_poses(written, file):
    folder, true = written
    output = folder / "fused.json"
    invoke(["fuse", str(folder / file), "-o", str(output), "--format", "json", "-q"])
    document = json.loads(output.read_text())
    assert document["schema"] == "mssegment/fusion/1"
    np.testing.assert_allclose(document["modes"][0]["point"], true, atol=0.05)
    assert len(document["labels"]) == 200
    assert np.shape(document["modes"][0]["covariance"]) == (6, 6)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("1 2 3 4 5\n2 3 4 5 6\n", "5 columns; expected 12 or 16"),
        ("0 0 0 0 0 0 2\n", "quaternion of norm 2"),
        ("[1, 2", "damaged JSON"),
        ('{"a": [], "b": []}', "2 lists"),
        ("[[1, 2], [3]]", "not all of one shape"),
    ],
)
def test_files_that_hold_no_poses_are_refused(tmp_path, content, message):
    path = tmp_path / "poses.txt"
    path.write_text(content)
    from mssegment.datasets.poses import read_measurements

    with pytest.raises(DataError, match=message):
        read_measurements(path.read_bytes(), str(path), (4, 4))


def test_a_sphere_of_directions_by_its_family(rng):
    directions = Sphere(2).project(np.array([0.0, 0.0, 1.0]) + 0.05 * rng.standard_normal((40, 3)))
    found = fuse(directions.round(4), "sphere")
    assert found.modes[0].point[2] > 0.99


@pytest.mark.parametrize(
    ("name", "count", "outliers"),
    [
        ("euclidean(1)", 40, 0.0),
        ("euclidean(1)", 200, 0.6),
        ("euclidean(2)", 300, 0.8),
        ("so2", 300, 0.8),
        ("so3", 40, 0.0),
        ("so3", 500, 0.85),
    ],
)
def test_the_error_is_that_of_the_inliers_whatever_the_outliers(name, count, outliers):
    manifold, own, best = from_name(name), [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        good = round(count * (1.0 - outliers))
        true = manifold.random_point(rng, 1)[0]
        at = np.broadcast_to(true, (good, *true.shape))
        tangents = manifold.random_tangent(at, rng)
        radii = 0.05 * np.sqrt(rng.chisquare(manifold.dim, good)) / manifold.norm(at, tangents)
        tangents = radii.reshape(-1, *[1] * true.ndim) * tangents
        others = manifold.random_point(rng, count - good)
        if isinstance(manifold, Euclidean):
            others = true + rng.uniform(-3.0, 3.0, (count - good, manifold.dim))
        found = fuse(np.concatenate([manifold.exp(at, tangents), others]), manifold)
        own.append(float(manifold.dist(found.modes[0].point, true)))
        best.append(float(manifold.norm(true, tangents.mean(axis=0))))
    assert np.mean(own) < 1.5 * np.mean(best)


@pytest.mark.parametrize("name", ["euclidean(3)", "so3", "se3"])
@pytest.mark.parametrize("count", [3, 4, 5, 6, 8])
def test_a_few_measurements_without_outliers_agree(name, count):
    manifold, shares = from_name(name), []
    for seed in range(20):
        rng = np.random.default_rng([seed, count])
        true = np.broadcast_to(manifold.random_point(rng, 1), (count, *manifold.point_shape))
        tangents = rng.normal(0, 0.02, (count, manifold.dim)) @ manifold.tangent_basis(
            true[0]
        ).reshape(manifold.dim, -1)
        points = manifold.exp(true, tangents.reshape(true.shape))
        found = fuse(points, manifold, random_state=0)
        shares.append(len(found.modes[0].support) / count if found.modes else 0.0)
    assert np.count_nonzero(shares) >= 18
    assert np.mean(shares) > 0.8


def test_two_values_of_different_precision(rng):
    points = np.concatenate(
        [
            rng.normal(0.0, 0.05, (100, 2)),
            rng.normal(1.5, 0.25, (100, 2)),
            rng.uniform(-3.0, 3.0, (100, 2)),
        ]
    )
    modes = sorted(fuse(points, "euclidean").modes, key=lambda mode: mode.point[0])
    assert len(modes) == 2
    for mode, value, deviation in zip(modes, (0.0, 1.5), (0.05, 0.25), strict=True):
        np.testing.assert_allclose(mode.point, value, atol=4.0 * deviation / 10.0)
        np.testing.assert_allclose(np.sqrt(np.diag(mode.covariance)), deviation, rtol=0.4)


@pytest.mark.parametrize("name", ["so3", "sphere(2)", "grassmann(3,1)", "so2"])
@pytest.mark.parametrize("count", [60, 200])
def test_where_no_measurements_agree_there_is_no_value(name, count, rng):
    """Uniform all over a compact manifold; the mean of all of them would say nothing."""
    points = from_name(name).random_point(rng, count)
    assert fuse(points, name).modes == ()


def test_chance_makes_no_second_value(rng):
    """A value that half of the measurements have, and others about it: no clump of them is one."""
    for _ in range(5):
        good = 0.05 * rng.standard_normal((50, 2))
        found = fuse(np.concatenate([good, rng.uniform(-4.0, 4.0, (50, 2))]), "euclidean")
        assert len(found.modes) == 1
        assert np.linalg.norm(found.modes[0].point) < 0.05


@pytest.mark.parametrize("count", [1, 2, 8, 20])
def test_few_measurements_without_others_are_one_value(count, rng):
    for _ in range(5):
        found = fuse(rng.normal(5.0, 0.1, (count, 1)), "euclidean")
        assert len(found.modes) == 1
        assert 2 * len(found.modes[0].support) > count
        assert abs(found.modes[0].point[0] - 5.0) < 0.3


@pytest.mark.parametrize(
    "parameters",
    [
        {"bandwidth": "knn"},
        {"bandwidth": 0.0},
        {"length_scale": -1.0},
        {"length_scale": None},
        {"min_share": "much"},
        {"min_share": 1.5},
        {"random_state": -1},
    ],
)
def test_wrong_parameters_are_named(parameters):
    name = next(iter(parameters))
    with pytest.raises(ConfigurationError, match=f"{name} must be") as error:
        fuse(np.eye(2), "euclidean", **parameters)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("form", ["text", "json", "csv"])
def test_no_value_is_said(form, tmp_path, rng, capsys):
    points = from_name("so3").random_point(rng, 80)
    np.savetxt(tmp_path / "turns.csv", points.reshape(80, 9), delimiter=",")
    words = ["fuse", str(tmp_path / "turns.csv"), "--manifold", "so3", "--format", form]
    assert invoke(words) == 0
    assert "no measurements agree by more than chance" in capsys.readouterr().err
