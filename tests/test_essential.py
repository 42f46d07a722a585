"""Rigid motions before a calibrated camera: the five-point solver and the model ``essential``."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import mssegment
from mssegment import models
from mssegment.evaluation import evaluate
from mssegment.geometry.five_point import five_point
from mssegment.geometry.rotations import degrees, rotation, skew
from mssegment.models import make
from mssegment.records import Camera, Floats, Integers

CAMERA = Camera(800.0, 780.0, 320.0, 240.0)
FOCAL, MIDDLE = np.array([800.0, 780.0]), np.array([320.0, 240.0])


def project(space: Floats) -> Floats:
    return np.asarray(space[..., :2] / space[..., 2:] * FOCAL + MIDDLE)


def body(
    rng: np.random.Generator, count: int, degrees_turned: float, size: float = 0.6
) -> tuple[Floats, Floats, Floats]:
    """Points of a cube before and after a motion [count, 2, 3], its R and t: X2 = R (X1 + t)."""
    centre = rng.uniform([-1.2, -0.9, 4.0], [1.2, 0.9, 6.0])
    first = centre + rng.uniform(-size, size, (count, 3))
    axis = rng.standard_normal(3)
    turn = rotation(np.radians(degrees_turned) * axis / np.linalg.norm(axis))
    shift = 0.2 * rng.standard_normal(3)
    second = (first - centre) @ turn.T + centre + shift
    # x2 = R x1 + (c + s - R c)
    return np.stack([first, second], axis=1), turn, turn.T @ (centre + shift) - centre


@pytest.mark.parametrize("plane", [False, True])
def test_the_five_point_solver_finds_the_exact_matrix_among_its_solutions(
    rng: np.random.Generator, plane: bool
) -> None:
    """Planes, too, where the eight-point algorithm has no unique solution."""
    space = rng.uniform([-1.0, -1.0, 3.0], [1.0, 1.0, 5.0], (200, 5, 3))
    if plane:
        space[..., 2] = 4.0 + 0.3 * space[..., 0] - 0.2 * space[..., 1]
    turns = rotation(0.4 * rng.standard_normal((200, 3)))
    shifts = rng.standard_normal((200, 3))
    shifts /= np.linalg.norm(shifts, axis=1, keepdims=True)
    moved = space @ np.swapaxes(turns, 1, 2) + shifts[:, None]
    first, second = space / space[..., 2:], moved / moved[..., 2:]
    found = five_point(first, second)
    exact = (skew(shifts) @ turns)[:, None]
    nearest = np.minimum(
        np.linalg.norm(found - exact, axis=(2, 3)), np.linalg.norm(found + exact, axis=(2, 3))
    )
    assert np.quantile(np.nanmin(nearest, axis=1), 0.95) < 1e-8
    # every solution is an essential matrix that satisfies the five equations
    real = np.isfinite(found).all(axis=(2, 3))
    rows, columns = np.nonzero(real)
    solutions = found[rows, columns]
    equations = np.einsum("spi,sij,spj->sp", second[rows], solutions, first[rows])
    assert np.abs(equations).max() < 1e-9
    values = np.linalg.svd(solutions, compute_uv=False)
    assert np.quantile(np.abs(values - [1.0, 1.0, 0.0]).max(axis=1), 0.95) < 1e-6
    assert real.sum(axis=1).max() <= 10


def test_five_equal_matches_have_no_solution() -> None:
    rays = np.ones((1, 5, 3))
    assert np.isnan(five_point(rays, rays)).all()


@pytest.mark.parametrize("turned", [0.0, 1.0, 10.0, 60.0])
def test_rotation_and_direction_are_those_of_the_motion(
    rng: np.random.Generator, turned: float
) -> None:
    model = make("essential")
    space, turn, shift = body(rng, 40, turned)
    points = project(space)
    normalization = model.normalization(points, CAMERA)
    found, valid = model.fit(model.observe(points, normalization), np.ones((1, 40)))
    assert valid[0]
    pose = model.in_pixels(found[0], normalization)
    assert np.allclose(pose["rotation"], turn, atol=1e-6)
    assert np.allclose(pose["direction"], shift / np.linalg.norm(shift), atol=1e-5)
    epipole = project(shift)
    assert np.allclose(pose["epipole"], epipole, rtol=1e-4)


def test_the_pose_is_that_of_opencv(rng: np.random.Generator) -> None:
    model = make("essential")
    points = project(body(rng, 60, 12.0)[0])
    normalization = model.normalization(points, CAMERA)
    found, _ = model.fit(model.observe(points, normalization), np.ones((1, 60)))
    pose = model.in_pixels(found[0], normalization)
    matrix = np.array([[800.0, 0.0, 320.0], [0.0, 780.0, 240.0], [0.0, 0.0, 1.0]])
    first, second = points[:, 0].copy(), points[:, 1].copy()
    theirs, _ = cv2.findEssentialMat(first, second, matrix, cv2.RANSAC, 0.9999, 0.1)
    _, turn, shift, _ = cv2.recoverPose(theirs, first, second, matrix)
    assert degrees(turn.T @ pose["rotation"]) < 0.1
    ours = pose["rotation"] @ pose["direction"]
    assert np.degrees(np.arccos(np.clip(ours @ shift[:, 0], -1.0, 1.0))) < 0.5


def test_points_that_move_the_other_way_are_far_from_the_motion(rng: np.random.Generator) -> None:
    """On the epipolar line, but behind the camera: minus the motion has the same matrix."""
    model = make("essential")
    space, turn, shift = body(rng, 40, 5.0)
    points = project(space)
    backwards = project((space[:, 0] - shift) @ turn.T)
    normalization = model.normalization(points, CAMERA)
    observed = model.observe(points, normalization)
    found, _ = model.fit(observed, np.ones((1, 40)))
    away = model.displacements(found, observed, normalization)
    assert away is not None
    assert (away > 0).all()
    wrong = model.observe(np.stack([points[:, 0], backwards], axis=1), normalization)
    assert model.residuals(found, observed, normalization).max() < 1e-4
    assert model.residuals(found, wrong, normalization).min() > 0.3 * away.min()


def scene(rng: np.random.Generator, bodies: int, outliers: int) -> tuple[Floats, Integers]:
    spaces = [body(rng, 60, 8.0)[0] for _ in range(bodies)]
    points = project(np.concatenate(spaces))
    points += rng.normal(0.0, 0.2, points.shape)
    stray = rng.uniform([0.0, 0.0], [640.0, 480.0], (outliers, 2, 2))
    labels = np.repeat(np.arange(1, bodies + 1), 60)
    return np.concatenate([points, stray]), np.append(labels, np.zeros(outliers, np.int64))


@pytest.mark.parametrize("seed", range(3))
def test_bodies_that_turn_before_the_camera_are_told_apart(seed: int) -> None:
    points, truth = scene(np.random.default_rng(seed), bodies=3, outliers=60)
    found = mssegment.segment_tracks(points, {"hypothesize.model": "essential"}, camera=CAMERA)
    assert len(found.motions) == 3
    assert evaluate(truth, found.labels).misclassification < 0.06


def test_one_body_is_one_motion_whatever_its_depth() -> None:
    points, truth = scene(np.random.default_rng(5), bodies=1, outliers=40)
    found = mssegment.segment_tracks(points, {"hypothesize.model": "essential"}, camera=CAMERA)
    assert len(found.motions) == 1
    assert evaluate(truth, found.labels).misclassification < 0.06


@pytest.mark.parametrize("matches", [50, 200])
def test_there_is_no_motion_in_noise(rng: np.random.Generator, matches: int) -> None:
    points = rng.uniform([0.0, 0.0], [640.0, 480.0], (matches, 2, 2))
    found = mssegment.segment_tracks(points, {"hypothesize.model": "essential"}, camera=CAMERA)
    assert len(found.motions) == 0


def test_rotation_and_direction_are_in_the_documents(tmp_path: Path) -> None:
    points, _ = scene(np.random.default_rng(0), bodies=2, outliers=20)
    found = mssegment.segment_tracks(points, {"hypothesize.model": "essential"}, camera=CAMERA)
    found.save(tmp_path / "out")
    report = (tmp_path / "out" / "report.json").read_text()
    assert '"rotation"' in report
    assert '"direction"' in report


def street(rng: np.random.Generator) -> tuple[Floats, Integers]:
    """A static scene with depth before a camera that drives forward and turns, and a car."""
    world = rng.uniform([-6.0, -3.0, 5.0], [6.0, 1.5, 30.0], (150, 3))
    car = rng.uniform([-1.0, 0.0, 9.0], [1.0, 1.4, 12.0], (50, 3))
    second = np.concatenate([world, car + np.array([0.9, 0.0, -0.6])])
    moved = second @ rotation(np.array([0.0, 0.02, 0.0])).T - np.array([0.0, 0.0, 0.8])
    points = project(np.stack([np.concatenate([world, car]), moved], axis=1))
    return points + rng.normal(0.0, 0.2, points.shape), np.repeat([1, 2], [150, 50])


@pytest.mark.parametrize("seed", range(3))
def test_with_a_camera_auto_sees_a_scene_with_depth_as_one_motion(seed: int) -> None:
    points, truth = street(np.random.default_rng(seed))
    found = mssegment.segment_tracks(points, camera=CAMERA)
    assert len(found.motions) == 2
    assert "essential" in {motion.model for motion in found.motions}
    assert evaluate(truth, found.labels).misclassification < 0.04


def test_auto_needs_a_camera_for_it() -> None:
    assert "essential" not in models.automatic(2)
    assert "essential" in models.automatic(2, calibrated=True)
    assert "essential" not in models.automatic(5, calibrated=True)
