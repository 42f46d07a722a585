"""The noise of matches is measured: at any level, with mismatches, at any offset and scale."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.neighbours import nearest_others
from mssegment.preprocessing.background import find_background
from mssegment.preprocessing.noise import (
    QUANTILE,
    QUANTILE_OF_NORMAL,
    local_scales,
    measured_noise,
    reference_noise,
)
from mssegment.records import BACKGROUND, Floats


def plane(rng: np.random.Generator, count: int, noise: float, outliers: int = 0) -> Floats:
    """Matches of one affine motion with noise in the second view, and mismatches."""
    first = rng.uniform(0, 400, (count + outliers, 2))
    second = first @ np.array([[1.05, 0.02], [-0.03, 0.97]]) + [9.0, 2.0]
    second += rng.normal(0, noise, second.shape)
    second[count:] = rng.uniform(0, 400, (outliers, 2))
    return np.stack([first, second], axis=1)


@pytest.mark.parametrize("size", QUANTILE_OF_NORMAL)
def test_the_quantile_of_normal_noise_is_as_simulated(size: int) -> None:
    found = []
    for seed in range(8):
        points = plane(np.random.default_rng(seed), 400, 1.0)
        near = nearest_others(points.reshape(-1, 4), size)
        found.append(np.quantile(local_scales(points, near), QUANTILE))
    assert np.mean(found) == pytest.approx(QUANTILE_OF_NORMAL[size], rel=0.12)


@pytest.mark.parametrize("noise", [0.3, 1.0, 3.0])
@pytest.mark.parametrize(("count", "outliers"), [(40, 0), (400, 0), (300, 250)])
def test_the_noise_is_found(noise: float, count: int, outliers: int) -> None:
    found = [
        measured_noise(plane(np.random.default_rng(seed), count, noise, outliers))
        for seed in range(5)
    ]
    assert 0.6 * noise < np.median(found) < 1.7 * noise


def test_the_noise_has_the_unit_of_the_coordinates_and_no_origin() -> None:
    points = plane(np.random.default_rng(0), 200, 0.7, 60)
    noise = measured_noise(points)
    assert measured_noise(points + 20_000.0) == pytest.approx(noise, rel=1e-3)
    assert measured_noise(points / 1000) == pytest.approx(noise / 1000, rel=1e-3)
    assert reference_noise(points / 1000) == pytest.approx(reference_noise(points) / 1000)


def test_exact_matches_have_the_noise_of_the_best_matchers() -> None:
    points = plane(np.random.default_rng(0), 200, 0.0)
    assert measured_noise(points) < 1e-6
    assert 0.1 < reference_noise(points) < 0.3
    assert np.isnan(measured_noise(points[:7]))
    assert 0 < reference_noise(points[:7]) < 0.3


def test_what_stands_still_is_relative_to_the_noise() -> None:
    rng = np.random.default_rng(0)
    for noise in (0.1, 1.5):
        first = rng.uniform(0, [640, 480], (200, 2))
        second = first + rng.normal(0, noise, first.shape)
        second[:40] += [40.0, 15.0]
        found = find_background(np.stack([first, second], axis=1), frame_size=(640, 480))
        assert (found.status[:40] == 0).all()
        assert (found.status[40:] == BACKGROUND).mean() > 0.98


def test_an_offset_of_the_coordinates_makes_no_background() -> None:
    rng = np.random.default_rng(0)
    points = plane(rng, 150, 0.3) + 20_000.0
    found = find_background(points, frame_size=(20_641, 20_481))
    assert (found.status == 0).all()


def test_a_picture_that_stands_still_says_from_which_motion_on() -> None:
    rng = np.random.default_rng(0)
    first = rng.uniform(0, [640, 480], (160, 2))
    second = first + rng.normal(0, 0.03, first.shape)
    second[:60] += [1.2, 0.0]
    points = np.stack([first, second], axis=1)
    (note,) = find_background(points, frame_size=(640, 480)).notes
    assert "less than 2 px (background.min_displacement)" in note
    found = find_background(points, frame_size=(640, 480), min_displacement=0.5)
    assert (found.status == 0).sum() == 60


def test_a_scene_that_moves_by_little_more_than_the_noise_is_no_background() -> None:
    rng = np.random.default_rng(3)
    first = rng.uniform([0, 0], [640, 480], (300, 2))
    # parallax of up to 30 px along the lines, of any depth
    shift = np.outer(rng.uniform(0, 30, 300), [0.96, 0.28])
    points = np.stack([first, first + shift], axis=1) + rng.normal(0, 0.6, (300, 2, 2))
    found = find_background(points, frame_size=(640, 480))
    assert not found.found
    assert "the camera moves" in found.notes[0]
