"""The displacements of tracks of one motion predict each other."""

import numpy as np
import pytest

from mssegment.segmentation.mdl.displacement import displacement_gains
from mssegment.segmentation.mdl.likelihood import Noise


@pytest.fixture
def noise():
    longest = float(np.log(100.0))
    return Noise(1, 1, 0.1, 1.0, longest, 2 * longest, np.zeros(40))


def test_an_object_at_one_depth_predicts_its_tracks(noise, rng):
    moved = np.r_[rng.normal(50.0, 0.5, 30), rng.uniform(0.0, 20.0, 10)][None]
    inliers = (np.arange(40) < 30)[None].astype(float)
    gains = displacement_gains(moved, inliers, noise)[0]
    assert gains[:30].min() > 0.2
    assert gains[30:].mean() < gains[:30].mean() - 0.5


def test_a_motion_without_inliers_predicts_little(noise):
    # all bins of the logarithm are equally likely
    moved = np.full((1, 40), 50.0)
    few = displacement_gains(moved, np.zeros((1, 40)), noise)
    many = displacement_gains(moved, np.ones((1, 40)), noise)
    assert (many > few + 0.5).all()


def test_a_track_does_not_predict_itself(noise):
    moved = np.r_[np.full(39, 5.0), 80.0][None]
    alone = displacement_gains(moved, np.ones((1, 40)), noise)[0, 39]
    out = displacement_gains(moved, (np.arange(40) < 39)[None].astype(float), noise)[0, 39]
    assert alone == pytest.approx(out, abs=0.02)


def test_scaling_all_pixels_changes_nothing(noise, rng):
    moved = rng.uniform(0.0, 100.0, (3, 40))
    inliers = (rng.random((3, 40)) < 0.6).astype(float)
    extent = noise.log_free_extent + np.log(2.0)
    doubled = Noise(1, 1, 0.2, 2.0, extent, noise.outlier_cost, np.zeros(40))
    np.testing.assert_allclose(
        displacement_gains(2 * moved, inliers, doubled),
        displacement_gains(moved, inliers, noise),
        atol=1e-9,
    )
