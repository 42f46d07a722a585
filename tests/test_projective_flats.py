"""Rigid objects under perspective lie on an affine 3-flat once the perspective is taken out."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import perspective_tracks, rigid_bodies

from mssegment.geometry.projective_flats import bent_flat


def off_flat(points: np.ndarray) -> float:
    """The root mean square distance of tracks from their best affine 3-flat, pixels."""
    vectors = points.reshape(len(points), -1)
    values = np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False)
    return float(np.sqrt((values[3:] ** 2).sum() / len(vectors)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("frames", [4, 10, 25])
def test_perspective_is_taken_out(seed: int, frames: int) -> None:
    points = perspective_tracks(np.random.default_rng(seed), tracks=80, frames=frames)
    before = off_flat(points)
    assert before > 1.0
    assert off_flat(bent_flat(points, 0.1).level) < 0.05 * before


def test_an_affine_view_stays(rng: np.random.Generator) -> None:
    shape = np.column_stack([rng.uniform(-100, 100, (60, 2)), rng.normal(0, 20, 60), np.ones(60)])
    maps = np.concatenate([np.eye(2), np.zeros((2, 2))], axis=1) + rng.normal(0, 0.05, (8, 2, 4))
    points = np.einsum("fck,nk->nfc", maps, shape)
    np.testing.assert_allclose(bent_flat(points, 0.1).level, points, atol=0.5)


def test_the_unit_the_order_and_the_place_do_not_matter() -> None:
    points = perspective_tracks(np.random.default_rng(3), tracks=50, frames=8)
    level = bent_flat(points, 0.1).level
    np.testing.assert_allclose(bent_flat(1e3 * points, 100.0).level, 1e3 * level, rtol=1e-6)
    order = np.random.default_rng(0).permutation(50)
    np.testing.assert_allclose(bent_flat(points[order], 0.1).level, level[order], atol=1e-6)
    np.testing.assert_allclose(bent_flat(points + 5e3, 0.1).level, level + 5e3, atol=1e-3)


def test_outliers_do_not_spoil_the_others(rng: np.random.Generator) -> None:
    points = perspective_tracks(np.random.default_rng(4), tracks=80, frames=10)
    spoiled = points.copy()
    spoiled[:12] += rng.normal(0, 20, (12, 10, 2))
    assert off_flat(bent_flat(spoiled, 0.1).level[12:]) < 0.1 * off_flat(points[12:])


def test_two_objects_stay_two() -> None:
    points, _ = rigid_bodies(np.random.default_rng(4), sizes=(70, 70), frames=10, noise=0.0)
    level = bent_flat(points, 0.1).level
    assert off_flat(level) > 0.3 * off_flat(points)


@pytest.mark.parametrize("noise", [0.1, 1.0])
def test_residuals_of_a_bent_flat_are_those_of_the_noise(noise: float) -> None:
    exact = perspective_tracks(np.random.default_rng(6), tracks=120, frames=12)
    points = exact + np.random.default_rng(0).normal(0, noise, exact.shape)
    flat = bent_flat(points[:80], 0.0)
    others = flat.residuals(points[80:])
    # eight rounds leave a little of a strong perspective
    assert 0.9 * noise < np.median(others) < 1.4 * noise
    assert 0.9 * noise < np.median(flat.own_residuals(points[:80])) < 1.4 * noise
    # a track that does not move with the object
    assert flat.residuals(points[80:, ::-1]).min() > 3 * noise


def test_a_flat_without_perspective_has_no_forms() -> None:
    points = perspective_tracks(np.random.default_rng(6), tracks=40, frames=6)
    assert not bent_flat(points, 0.1, perspective=False).forms.any()
    np.testing.assert_allclose(bent_flat(points, 0.1, perspective=False).level, points)
