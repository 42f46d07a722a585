"""The affine 3-flat of tracks that are not visible in all frames."""

from __future__ import annotations

import numpy as np
import pytest
from test_joinedness import cut

from mssegment.geometry.incomplete_flats import incomplete_flat
from mssegment.records import Floats


def body(rng: np.random.Generator, *, tracks: int = 60, frames: int = 12) -> Floats:
    """Exact tracks of a rigid body before affine cameras that turn and move."""
    shape = np.column_stack([rng.uniform(-100, 100, (tracks, 2)), rng.normal(0, 30, tracks)])
    shape = np.column_stack([shape, np.ones(tracks)])
    steps = rng.normal(0, 0.03, (frames, 2, 4)) * [1, 1, 1, 100]
    maps = np.eye(2, 4) + np.cumsum(steps, axis=0)
    return np.asarray(np.einsum("fck,nk->nfc", maps, shape) + 300)


@pytest.mark.parametrize("seed", range(5))
def test_exact_tracks_leave_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = cut(body(rng), rng)
    flat = incomplete_flat(points)
    moved = np.nanstd(points - np.nanmean(points, axis=1, keepdims=True))
    assert np.nanmedian(flat.own_residuals(points)) < 0.01 * moved


@pytest.mark.parametrize("missing", [False, True])
def test_own_residuals_are_the_noise(missing, rng: np.random.Generator) -> None:
    points = body(rng, tracks=150) + rng.normal(0, 0.5, (150, 12, 2))
    points = cut(points, rng) if missing else points
    own = incomplete_flat(points).own_residuals(points)
    assert np.sqrt(np.median(own**2)) == pytest.approx(0.5, rel=0.15)


def test_tracks_of_other_motions_are_far(rng: np.random.Generator) -> None:
    points = body(rng, tracks=100) + rng.normal(0, 0.3, (100, 12, 2))
    other = points[:30, :1] + rng.normal(0, 5.0, (30, 12, 2)).cumsum(axis=1)
    both = cut(np.concatenate([points, other]), rng)
    flat = incomplete_flat(both)
    residuals = flat.own_residuals(both)
    assert np.quantile(residuals[:100], 0.9) < 0.2 * np.median(residuals[100:])
    assert flat.weights[100:].mean() < 0.2 * flat.weights[:100].mean()
    # those that were not fitted are as far
    fitted = incomplete_flat(both[:100])
    assert np.median(fitted.residuals(both[100:])) > 5 * np.median(fitted.residuals(both[:100]))


def test_the_unit_and_the_place_do_not_matter(rng: np.random.Generator) -> None:
    points = cut(body(rng) + rng.normal(0, 0.3, (60, 12, 2)), rng)
    own = incomplete_flat(points).own_residuals(points)
    moved = 1e3 * points + [500.0, -9e4]
    np.testing.assert_allclose(incomplete_flat(moved).own_residuals(moved), 1e3 * own, rtol=1e-4)


def test_one_frame_says_nothing(rng: np.random.Generator) -> None:
    points = body(rng)
    single = points[:1].copy()
    single[:, 1:] = np.nan
    assert np.isnan(incomplete_flat(points).residuals(single)).all()
