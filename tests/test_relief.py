"""The relief of bodies that are not flat lies along the lines to their epipoles."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mssegment
from mssegment.records import Floats
from mssegment.segmentation.mdl.likelihood import Noise
from mssegment.segmentation.mdl.relief import Misfits, Relief, misfit_across, relief_cost

EPIPOLE = (500.0, 900.0)
ONE = np.ones((1, 400))


def noise(parallax: float = 0.0, tracks: int = 400) -> Noise:
    return Noise(2, 1, 0.3, 3.0, 0.0, 12.0, np.full(tracks, parallax))


def body(
    rng: np.random.Generator,
    relief: float,
    error: float = 0.5,
    epipole: tuple[float, float] = EPIPOLE,
) -> Misfits:
    """Misfits of 400 matches of a body, along the lines to ``epipole``, and errors."""
    places = rng.uniform(100, 500, (400, 2))
    lines = np.array(epipole) - places
    lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    misfits = relief * rng.normal(size=(400, 1)) * lines + rng.normal(0, error, (400, 2))
    return Misfits(*(each[None] for each in (*misfits.T, *places.T)))


@pytest.mark.parametrize("seed", range(3))
def test_an_epipole_in_the_picture_is_found(seed: int) -> None:
    found = Relief.of(body(np.random.default_rng(seed), 12.0, epipole=(260.0, 330.0)), ONE, noise())
    assert 0.3 < found.across[0] < 0.6


def test_misfits_of_equal_scales_are_their_lengths() -> None:
    misfits = body(np.random.default_rng(0), 0.0, error=0.1)
    found = Relief.of(misfits, ONE, noise())
    assert found.along[0] == found.across[0] == 0.3
    np.testing.assert_allclose(found.residuals, misfits.lengths, rtol=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_misfit_across_the_lines_is_noise(seed: int) -> None:
    found = Relief.of(body(np.random.default_rng(seed), 12.0), ONE, noise())
    # a Student t distribution of 2.5 degrees of freedom is narrower than the normal one it fits
    assert 0.3 < found.across[0] < 0.6
    assert 8.0 < found.along[0] < 14.0


@pytest.mark.parametrize("seed", range(3))
def test_noise_has_no_relief(seed: int) -> None:
    misfits = body(np.random.default_rng(seed), 0.0, error=1.0)
    found = Relief.of(misfits, ONE, noise())
    assert found.along[0] < 1.3 * found.across[0]
    flat = found.where_it_pays(misfits.lengths, ONE, noise())
    assert flat.along[0] == flat.across[0]
    np.testing.assert_array_equal(flat.residuals, misfits.lengths)


def test_relief_that_is_seen_pays() -> None:
    misfits = body(np.random.default_rng(0), 6.0)
    found = Relief.of(misfits, ONE, noise())
    np.testing.assert_array_equal(
        found.where_it_pays(misfits.lengths, ONE, noise()).residuals, found.residuals
    )


def test_two_bodies_misfit_in_both_directions() -> None:
    rng = np.random.default_rng(0)
    first, second = body(rng, 6.0), body(rng, 6.0)
    # the other body misfits across: its lines are turned by a quarter
    both = Misfits(
        *(
            np.concatenate(pair, axis=1)
            for pair in (
                (first.right, -second.down),
                (first.down, second.right),
                (first.x, second.x),
                (first.y, second.y),
            )
        )
    )
    alone = Relief.of(first, ONE, noise())
    mixed = Relief.of(both, np.ones((1, 800)), noise(tracks=800))
    assert mixed.across[0] > 3 * alone.across[0]


def test_the_density_is_that_of_both_directions() -> None:
    misfits = body(np.random.default_rng(0), 6.0)
    model = noise()
    found = Relief.of(misfits, ONE, model)
    nu, square = model.degrees_of_freedom, (found.residuals / found.scales[:, None]) ** 2
    density = nu / (2 * math.pi * nu * found.across * found.along)
    expected = model.outlier_cost + np.log(density) - (nu + 2) / 2 * np.log1p(square / nu)
    np.testing.assert_allclose(model.gains(found.residuals, found.scales), expected, rtol=1e-9)


def test_parallax_is_noise_along_the_lines_only() -> None:
    found = Relief.of(body(np.random.default_rng(0), 1.0), ONE, noise(parallax=5.0))
    assert found.along[0] == 5.0
    assert found.across[0] < 0.6


def test_relief_within_the_parallax_states_no_scale() -> None:
    within = relief_cost(np.array([0.5, 5.0, 1.0, 5.0, 0.0]), 100, noise())
    beyond = relief_cost(np.array([0.5, 5.0, 5.0, 1.0, 0.0]), 100, noise())
    assert 0 < within < beyond


def test_the_misfit_across_is_that_of_the_lines() -> None:
    misfits = body(np.random.default_rng(0), 12.0)
    found = Relief.of(misfits, ONE, noise())
    across = misfit_across(found.shapes[0], found.residuals[0], misfits.lengths[0])
    toward = np.array(EPIPOLE) - np.stack([misfits.x[0], misfits.y[0]], axis=1)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    expected = np.abs(misfits.right[0] * toward[:, 1] - misfits.down[0] * toward[:, 0])
    assert np.median(np.abs(across - expected)) < 0.1


def test_the_epipole_costs_what_the_misfits_say_of_it() -> None:
    rng = np.random.default_rng
    flat, shallow, deep = (Relief.of(body(rng(0), d), ONE, noise()) for d in (0.0, 3.0, 12.0))
    assert flat.told[0] < shallow.told[0] < deep.told[0]
    # both coordinates are known four times as precisely
    assert deep.told[0] - shallow.told[0] == pytest.approx(2 * math.log(4.0), abs=0.7)


def cloud_and_body(rng: np.random.Generator) -> Floats:
    """200 static points at random depths before a camera that moves, and a body of 50."""
    first = rng.uniform([0.0, 0.0], [640.0, 480.0], (200, 2))
    inverse = rng.uniform(0.3, 1.0, (200, 1))
    static = np.stack([first, first + inverse * [30.0, 6.0]], axis=1)
    own = rng.uniform(-50, 50, (50, 2))
    moved = own @ np.array([[1.05, 0.08], [-0.03, 0.97]]) + [-10.0, 25.0]
    moving = np.stack([own, moved], axis=1) + np.array([300.0, 200.0])
    points = np.concatenate([static, moving])
    return np.asarray(points + rng.normal(0, 0.3, points.shape))


@pytest.mark.parametrize("seed", range(3))
def test_a_cloud_of_depth_is_one_motion(seed: int) -> None:
    points = cloud_and_body(np.random.default_rng(seed))
    settings = {"segment.granularity": "object", "seed": 0}
    labels = mssegment.segment_tracks(points, settings).labels
    truth = np.repeat([1, 2], [200, 50])
    assert len(np.unique(labels[labels > 0])) == 2
    assert (labels == truth).mean() > 0.95
