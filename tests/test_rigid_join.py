"""Motions that one epipolar geometry holds together are one rigid body; others are not."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment.geometry.epipolar import sampson
from mssegment.geometry.epipolar_fit import compatible_plane, fit_epipolar, mapped_points
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import rotation
from mssegment.preprocessing.noise import measured_noise
from mssegment.records import Floats
from mssegment.segmentation.rigid_join import rigid_bodies
from mssegment.segmentation.rigid_join.residuals import noise_of_groups

Places = tuple[tuple[tuple[int, int], float], ...]
NEAR: Places = (((40, 60), 8.0), ((240, 200), 12.0), ((440, 80), 18.0))
APART: Places = (((20, 60), 5.0), ((320, 250), 20.0), ((440, 40), 18.0))
"""Corners and depths of walls; those that are farther apart are two motions."""
FOCAL, CENTRE = 700.0, np.array([320.0, 240.0])
NOISE = 0.3


def wall(rng: np.random.Generator, count: int, corner: tuple[float, float], depth: float) -> Floats:
    """Points [count, 3] of a wall with bay windows that fills 160 x 160 pixels."""
    pixels = np.array(corner) + rng.uniform(0, 160, (count, 2))
    along = (pixels[:, :1] - corner[0]) / 160
    tilt = 1 + 0.3 * along + 0.2 * np.sin(6 * np.pi * along)
    rays = homogeneous((pixels - CENTRE) / FOCAL)
    return np.asarray(rays * depth * tilt)


def seen(points: Floats, turn: Floats, shift: Floats, rng: np.random.Generator) -> Floats:
    """Matches [n, 2, 2] before and after a rigid motion of the points."""
    after = points @ rotation(turn).T + shift
    views = [FOCAL * p[:, :2] / p[:, 2:] + CENTRE for p in (points, after)]
    matches = np.stack(views, axis=1)
    return np.asarray(matches + rng.normal(0, NOISE, matches.shape))


def scene(
    seed: int,
    *,
    moves: bool,
    counts: tuple[int, ...] = (80, 60, 60),
    places: Places = NEAR,
) -> tuple[Floats, list[Floats]]:
    """Three walls before a camera that moves; the third may move by itself."""
    rng = np.random.default_rng(seed)
    turn, shift = np.array([0.01, -0.02, 0.015]), np.array([0.6, 0.2, 0.15])
    own_turn, own_shift = np.array([-0.03, 0.05, 0.1]), np.array([0.2, -1.0, -0.4])
    parts = []
    for k, (count, (corner, depth)) in enumerate(zip(counts, places, strict=True)):
        points = wall(rng, count, corner, depth)
        apart = moves and k == 2
        parts.append(seen(points, own_turn if apart else turn, own_shift if apart else shift, rng))
    return np.concatenate(parts), parts


def walls(seed: int, own: tuple[float, float, float]) -> tuple[Floats, list[Floats]]:
    """Two exact planes at an angle before a moving camera; the second one translates by ``own``."""
    rng = np.random.default_rng(seed)
    turn, shift = np.array([0.01, -0.02, 0.015]), np.array([0.6, 0.2, 0.15])
    parts = []
    for corner, slant, moved in (((40, 60), 0.6, (0.0, 0.0, 0.0)), ((360, 80), -0.6, own)):
        rays = homogeneous((corner + rng.uniform(0, 220, (70, 2)) - CENTRE) / FOCAL)
        points = rays * 10.0 / (1.0 + slant * rays[:, :1])
        before = FOCAL * points[:, :2] / points[:, 2:] + CENTRE
        after = (points + moved) @ rotation(turn).T + shift
        after = FOCAL * after[:, :2] / after[:, 2:] + CENTRE
        views = np.stack([before, after], axis=1)
        parts.append(views + rng.normal(0, NOISE, views.shape))
    return np.concatenate(parts), parts


def partition(points: Floats, parts: list[Floats]) -> list[list[int]]:
    """The bodies found among the parts, as sorted indices of the parts."""
    ends = np.cumsum([len(part) for part in parts])
    index = np.searchsorted(ends, np.arange(len(points)), side="right")
    members = [np.asarray(index == k) for k in range(len(parts))]
    bodies = rigid_bodies(points, members, NOISE * np.sqrt(2))
    return sorted(sorted(body.members) for body in bodies)


@pytest.mark.parametrize("seed", range(4))
def test_walls_of_a_static_scene_are_one_body(seed: int) -> None:
    assert partition(*scene(seed, moves=False)) == [[0, 1, 2]]


@pytest.mark.parametrize("seed", range(4))
def test_a_wall_that_moves_by_itself_is_another_body(seed: int) -> None:
    assert partition(*scene(seed, moves=True)) == [[0, 1], [2]]


def test_small_groups_and_single_groups_are_bodies_of_their_own() -> None:
    points, parts = scene(0, moves=False, counts=(80, 60, 3))
    assert partition(points, parts) == [[0, 1], [2]]
    assert partition(parts[0], parts[:1]) == [[0]]


def test_planes_at_an_angle_are_often_one_body_and_never_if_one_translates() -> None:
    """Parallel ones say nothing (below): parallax of a translation has its direction everywhere."""
    static = [partition(*walls(seed, (0.0, 0.0, 0.0))) for seed in range(12)]
    moving = [partition(*walls(seed, (0.1, -0.6, 0.2))) for seed in range(12)]
    assert static.count([[0, 1]]) >= 6
    assert moving.count([[0], [1]]) == 12


def test_two_flat_bodies_that_translate_are_not_joined() -> None:
    """Any two translations of flat bodies have an epipolar geometry: it is no evidence."""
    rng = np.random.default_rng(3)
    parts = []
    for corner, shift in (((50, 50), (20, 3)), ((380, 250), (-14, 9))):
        first = np.array(corner) + rng.uniform(0, 150, (60, 2))
        second = first + shift + rng.normal(0, NOISE, (60, 2))
        parts.append(np.stack([first, second], axis=1))
    assert partition(np.concatenate(parts), parts) == [[0], [1]]


def test_units_and_offset_do_not_matter() -> None:
    points, parts = scene(1, moves=True)
    for scale, offset in ((1e-3, 0.0), (10.0, 20_000.0)):
        ends = np.cumsum([len(part) for part in parts])
        index = np.searchsorted(ends, np.arange(len(points)), side="right")
        members = [np.asarray(index == k) for k in range(3)]
        found = rigid_bodies(points * scale + offset, members, NOISE * np.sqrt(2) * scale)
        assert sorted(sorted(body.members) for body in found) == [[0, 1], [2]]


def test_epipolar_geometry_and_compatible_planes_hold() -> None:
    points, parts = scene(2, moves=False)
    unit = (points - points.mean(axis=0)) / 200.0
    first, second = unit[:, 0], unit[:, 1]
    fit = fit_epipolar(first, second, np.ones(len(unit)), NOISE / 200)
    error = sampson(fit.matrix[None], homogeneous(first), homogeneous(second)).error[0]
    assert np.median(np.abs(error)) < 1.5 * NOISE / 200
    own = slice(0, len(parts[0]))
    plane = compatible_plane(fit.matrix, first[own], second[own], NOISE / 200)
    # H is compatible with F if F' H + H' F = 0
    symmetric = fit.matrix.T @ plane
    assert np.abs(symmetric + symmetric.T).max() < 1e-9 * np.abs(symmetric).max()
    residual = np.linalg.norm(mapped_points(plane, first[own])[0] - second[own], axis=1)
    assert np.median(residual) < 8 / 200


def test_the_motions_that_were_joined_are_documented() -> None:
    points, _ = scene(1, moves=True, places=APART)
    rng = np.random.default_rng(0)
    wrong = rng.uniform(0, 480, (20, 2, 2))
    matches = np.concatenate([points, wrong])
    found = mssegment.segment_tracks(matches, {"background.remove": False}, frame_size=(640, 480))
    static, moving = found.motions
    assert len(static.parts) == 2
    assert static.rigid_evidence is not None
    assert static.rigid_evidence > 2
    assert sorted(np.concatenate([part.inliers for part in static.parts])) == sorted(static.inliers)
    assert not moving.parts
    assert moving.rigid_evidence is None
    assert static.rms < 10
    assert any("motion 1 is one rigid body" in note for note in found.segmentation.notes)
    apart = mssegment.segment_tracks(
        matches,
        {"background.remove": False, "segment.granularity": "none"},
        frame_size=(640, 480),
    )
    assert len(apart.motions) == 3
    assert not any(motion.parts for motion in apart.motions)


@pytest.mark.parametrize("noise", [0.4, 1.0])
def test_the_noise_is_what_epipolar_geometry_leaves(noise: float) -> None:
    rng = np.random.default_rng(1)
    pixels = rng.uniform([0, 0], [640, 480], (150, 2))
    cloud = homogeneous((pixels - CENTRE) / FOCAL) * rng.uniform(6, 20, (150, 1))
    after = cloud @ rotation(np.array([0.01, -0.02, 0.015])).T + [0.6, 0.2, 0.15]
    views = [FOCAL * p[:, :2] / p[:, 2:] + CENTRE for p in (cloud, after)]
    points = np.stack(views, axis=1) + rng.normal(0, noise / np.sqrt(2), (150, 2, 2))
    everything = [np.ones(150, dtype=bool)]
    among_neighbours = measured_noise(points)
    assert among_neighbours > 2 * noise
    assert 0.8 * noise < noise_of_groups(points, everything, among_neighbours) < 1.25 * noise
    assert noise_of_groups(points, everything, 0.3 * noise) == 0.3 * noise


@pytest.mark.parametrize("seed", [1, 2])
def test_a_given_number_is_that_of_rigid_bodies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places = (((30, 30), 6.0), ((240, 300), 12.0), ((450, 30), 20.0), ((230, 60), 9.0))
    walls = [wall(rng, 60, corner, depth) for corner, depth in places]
    camera = np.array([0.01, -0.02, 0.015]), np.array([0.6, 0.2, 0.15])
    body = np.array([-0.03, 0.05, 0.1]), np.array([0.2, -0.8, -0.4])
    points = np.concatenate(
        [seen(own, *(body if k == 3 else camera), rng) for k, own in enumerate(walls)]
    )
    settings = {"background.remove": False, "segment.motions": 2, "segment.granularity": "object"}
    found = mssegment.segment_tracks(points, settings, frame_size=(640, 480))
    assert len(found.motions) == 2
    assert (found.labels[:180] == 1).mean() > 0.95
    assert (found.labels[180:] == 2).mean() > 0.95
    more = {**settings, "segment.motions": 4}
    assert len(mssegment.segment_tracks(points, more, frame_size=(640, 480)).motions) == 4


@pytest.mark.parametrize("seed", range(4))
def test_slanted_layers_before_a_camera_that_only_moves_are_one_body(seed: int) -> None:
    """Relative to infinity all move in one direction; relative to each other it says little."""
    rng = np.random.default_rng(seed)
    parts = []
    for corner, shift in (((50, 50), 9.0), ((380, 250), 15.0), ((60, 280), 21.0)):
        place = rng.uniform(0, 150, (60, 2))
        along = shift * (1 + place @ rng.uniform(-0.002, 0.002, 2))
        first = np.array(corner) + place
        second = first + along[:, None] * [1.0, 0.0] + rng.normal(0, NOISE, (60, 2))
        parts.append(np.stack([first, second], axis=1))
    assert partition(np.concatenate(parts), parts) == [[0, 1, 2]]
    parts[2][:, 1] += [0.0, 12.0]
    assert partition(np.concatenate(parts), parts) == [[0, 1], [2]]
