"""Displacement along the epipolar lines is depth, and depths tell bodies apart."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.geometry.epipolar_fit import fit_epipolar
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import rotation
from mssegment.records import Floats
from mssegment.segmentation.rigid_join import rigid_bodies
from mssegment.segmentation.rigid_join.depths import (
    DepthEvidence,
    EpipolarCoordinates,
    middle_and_relief,
)
from mssegment.segmentation.rigid_join.epipoles import EpipoleTable, Parallax

FOCAL, CENTRE = 700.0, np.array([320.0, 240.0])
NOISE = 0.3


def view(points: Floats) -> Floats:
    return np.asarray(FOCAL * points[:, :2] / points[:, 2:] + CENTRE)


def cloud(
    rng: np.random.Generator, count: int, corner: tuple[float, float], depths: tuple[float, float]
) -> Floats:
    """Points [count, 3] that fill 200 x 200 pixels at a range of depths."""
    pixels = np.array(corner) + rng.uniform(0, 200, (count, 2))
    return np.asarray(homogeneous((pixels - CENTRE) / FOCAL) * rng.uniform(*depths, (count, 1)))


def two_views(points: Floats, turn: Floats, shift: Floats, rng: np.random.Generator) -> Floats:
    matches = np.stack([view(points), view(points @ rotation(turn).T + shift)], axis=1)
    return np.asarray(matches + rng.normal(0, NOISE, matches.shape))


@pytest.mark.parametrize("roll", [0.0, 1.0, np.pi])
def test_displacement_along_the_lines_is_inverse_depth(roll: float) -> None:
    rng = np.random.default_rng(0)
    points = cloud(rng, 80, (150, 150), (8.0, 16.0))
    turn = rotation(np.array([0.0, 0.0, roll])) @ rotation(np.array([0.01, -0.02, 0.0]))
    after = points @ turn.T + [0.6, 0.2, 0.05]
    matches = (np.stack([view(points), view(after)], axis=1) - CENTRE) / 200.0
    first, second = matches[:, 0], matches[:, 1]
    fit = fit_epipolar(first, second, np.ones(80), 1e-5)
    coordinates = EpipolarCoordinates.of(fit, first, second, 1e-5)
    found = coordinates.inverse_depth(first, second)
    inverse = 1 / after[:, 2]
    rows = np.column_stack([inverse, first, np.ones(80)])
    misfit = found.values - rows @ np.linalg.lstsq(rows, found.values, rcond=None)[0]
    assert misfit.std() < 0.02 * found.values.std()
    assert abs(np.corrcoef(inverse, found.values)[0, 1]) > 0.95


def test_a_tilted_plane_has_relief_and_mismatches_add_little() -> None:
    rng = np.random.default_rng(1)
    first = rng.uniform(-1, 1, (60, 2))
    depth = 0.3 * first[:, 0] + rng.normal(0, 0.01, 60)
    fit = fit_epipolar(first, first + np.stack([depth, 0 * depth], axis=1), np.ones(60), 0.01)
    coordinates = EpipolarCoordinates(np.eye(3), fit.epipole, 1.0)
    shifts = np.stack([depth, np.zeros(60)], axis=1)
    clean = middle_and_relief(first, coordinates.inverse_depth(first, first + shifts), 0.01)
    shifts[:5, 0] = 8.0
    disturbed = middle_and_relief(first, coordinates.inverse_depth(first, first + shifts), 0.01)
    assert 0.13 < clean[1] < 0.2
    assert disturbed == pytest.approx(clean, abs=0.05)


def test_depths_within_the_range_are_evidence_for_one_scene_and_depths_beyond_against_it() -> None:
    reliefs = np.array([0.1, 0.1, 0.05])
    near = DepthEvidence(np.array([0.0, 0.1, 0.1]), reliefs, 0.003)
    far = DepthEvidence(np.array([0.0, 0.1, 2.0]), reliefs, 0.003)
    assert near.gain(2, [0, 1]) > 1
    assert far.gain(2, [0, 1]) < -2
    assert near.total([0, 1, 2]) > far.total([0, 1, 2]) + 3


def test_depths_of_two_flat_layers_say_nothing() -> None:
    for distance in (0.02, 0.2, 2.0):
        layers = DepthEvidence(np.array([0.0, distance]), np.array([0.003, 0.003]), 0.003)
        assert abs(layers.total([0, 1])) < 1


def test_the_origin_of_depth_does_not_matter() -> None:
    middles, reliefs = np.array([0.0, 0.3, -0.2, 0.7]), np.array([0.1, 0.02, 0.2, 0.05])
    one = DepthEvidence(middles, reliefs, 0.01)
    other = DepthEvidence(middles + 5.0, reliefs, 0.01)
    assert other.total([0, 1, 2, 3]) == pytest.approx(one.total([0, 1, 2, 3]))
    assert other.gain(3, [0, 2]) == pytest.approx(one.gain(3, [0, 2]))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("moves", [False, True])
def test_what_moves_along_the_epipolar_lines_beyond_all_depths_is_another_body(
    seed: int, *, moves: bool
) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = np.array([0.01, -0.02, 0.015]), np.array([0.6, 0.25, 0.1])
    places = (((20, 20), (8.0, 10.0)), ((230, 210), (10.0, 13.0)), ((430, 40), (8.0, 11.0)))
    parts = [
        two_views(
            cloud(rng, 70, corner, depths), turn, shift * (-4 if moves and k == 2 else 1), rng
        )
        for k, (corner, depths) in enumerate(places)
    ]
    index = np.repeat([0, 1, 2], 70)
    members = [np.asarray(index == k) for k in range(3)]
    bodies = rigid_bodies(np.concatenate(parts), members, NOISE * np.sqrt(2))
    expected = [[0, 1], [2]] if moves else [[0, 1, 2]]
    assert sorted(sorted(body.members) for body in bodies) == expected


@pytest.mark.parametrize("deviations", [(0.01, 0.01), (0.017, 0.006), (0.006, 0.017)])
def test_noise_of_a_flat_group_prefers_no_epipole(deviations: tuple[float, float]) -> None:
    """Also where it differs in x and y, and where a few matches have much more of it."""
    rng = np.random.default_rng(7)
    places, shifts = rng.uniform(-1, 1, (50, 2)), rng.normal(0, deviations, (50, 2))
    shifts[:4] *= 3
    epipoles = rng.normal(size=(200, 3)) * [1.0, 1.0, 0.1]
    same, weights = np.zeros(50, dtype=np.int64), np.ones(1)
    spread = [
        Parallax(places, shifts, same, weights, 0.0116, misfits).log_likelihood(epipoles).std()
        for misfits in (np.zeros((50, 2)), shifts)
    ]
    assert spread[0] > 1
    assert spread[1] < 1e-9


def test_a_group_that_prefers_no_epipole_has_a_small_table() -> None:
    """The likelihood is the same everywhere, so that no cell is worth more than another."""
    places = np.random.default_rng(3).uniform(-1, 1, (30, 2))
    none, same = np.zeros((30, 2)), np.zeros(30, dtype=np.int64)
    parallax = Parallax(places, none, same, np.ones(1), 0.01, none)
    table = EpipoleTable.of(parallax, np.array([1.0, 0.0, 0.0]))
    assert len(table.values) < 2000
    assert abs(table.log_mean([0])) < 1e-9
