"""Joinedness: rigid motions between many frame pairs, seen in perspective by incomplete tracks."""

from __future__ import annotations

import numpy as np
import pytest
from moving_bodies import rigid_bodies

from mssegment.evaluation import misclassification
from mssegment.geometry.robust_epipolar import affine_epipolar_residuals, fundamental_residuals
from mssegment.geometry.rotations import rotation
from mssegment.records import Floats, Integers
from mssegment.sampling.frame_pairs import draw_for_consensus
from mssegment.segmentation.consensus import cluster_by_consensus
from mssegment.segmentation.consensus.epipolar_evidence import EpipolarEvidence

PAIRS = [(0, 2), (2, 4), (4, 6), (0, 4), (2, 6)]


def moving(
    rng: np.random.Generator, count: int, centre: tuple[float, float, float], frames: int = 8
) -> Floats:
    """Tracks [count, frames, 2] of a body that turns and moves before a pinhole camera."""
    body = rng.uniform(-1, 1, (count, 3)) * (1.5, 1.5, 2.0)
    spin, velocity = 0.02 * rng.normal(size=3), rng.normal(size=3) * (0.15, 0.15, 0.1)
    path = [
        body @ rotation(frame * spin).T + np.array(centre) + frame * velocity
        for frame in range(frames)
    ]
    return np.stack([500 * p[:, :2] / p[:, 2:] + (320, 240) for p in path], axis=1)


def cut(points: Floats, rng: np.random.Generator) -> Floats:
    """The tracks, each visible in a random contiguous half or more of the frames."""
    points = points.copy()
    frames = points.shape[1]
    for track in points:
        length = int(rng.integers(frames // 2, frames))
        start = int(rng.integers(0, frames - length + 1))
        track[:start] = track[start + length :] = np.nan
    return points


def two_bodies(rng: np.random.Generator, noise: float = 0.3) -> tuple[Floats, Integers]:
    points = np.concatenate([moving(rng, 70, (-2.0, 0.0, 7.0)), moving(rng, 60, (2.0, 0.5, 8.0))])
    return points + rng.normal(0, noise, points.shape), np.repeat([1, 2], [70, 60])


def matches_of(points: Floats) -> Floats:
    """Matches [pairs, 4, P] between the first frame and each other one."""
    others = range(1, points.shape[1])
    return np.stack([points[:, [0, frame]].reshape(len(points), 4).T for frame in others])


def test_exact_matches_have_no_residual(rng: np.random.Generator) -> None:
    matches = matches_of(moving(rng, 40, (0.0, 0.0, 6.0)))
    used, noise = np.ones((len(matches), 40), dtype=bool), np.full(len(matches), 1e-6)
    assert np.abs(fundamental_residuals(matches, used, noise)).max() < 1e-5
    assert np.abs(affine_epipolar_residuals(matches, used, noise)).max() > 0.1
    affine, _ = rigid_bodies(rng, sizes=(40,), frames=8, noise=0.0)
    matches = matches_of(affine)
    assert np.abs(affine_epipolar_residuals(matches, used, noise)).max() < 1e-6


@pytest.mark.parametrize("residuals_of", [affine_epipolar_residuals, fundamental_residuals])
def test_residuals_are_those_of_a_match_that_was_left_out(residuals_of, rng) -> None:
    points, _ = rigid_bodies(rng, sizes=(40,), frames=6, noise=0.3)
    matches = matches_of(points)
    noise = np.full(len(matches), 0.3)
    every = np.ones((len(matches), 40), dtype=bool)
    left_out = np.empty(every.shape)
    for match in range(40):
        used = every.copy()
        used[:, match] = False
        left_out[:, match] = residuals_of(matches, used, noise)[:, match]
    found = residuals_of(matches, every, noise)
    assert np.corrcoef(np.abs(found).ravel(), np.abs(left_out).ravel())[0, 1] > 0.95
    assert np.abs(found).mean() == pytest.approx(np.abs(left_out).mean(), rel=0.1)


@pytest.mark.parametrize("residuals_of", [affine_epipolar_residuals, fundamental_residuals])
def test_outliers_change_the_geometry_little(residuals_of, rng: np.random.Generator) -> None:
    """A Student t distribution gives an outlier the pull of about its scale, however far it is."""
    points, _ = rigid_bodies(rng, sizes=(60,), frames=4, noise=0.2)
    noise, used = np.full(3, 0.2), np.ones((3, 60), dtype=bool)
    clean = np.abs(residuals_of(matches_of(points), used, noise))
    points[:6, 1:] += rng.uniform(-60, 60, (6, 3, 2))
    found = np.abs(residuals_of(matches_of(points), used, noise))
    assert np.median(found[:, 6:]) < 3 * np.median(clean[:, 6:])
    assert np.median(found[:, :6]) > 10 * np.median(clean)


@pytest.mark.parametrize("residuals_of", [affine_epipolar_residuals, fundamental_residuals])
def test_residuals_are_lengths_in_the_picture(residuals_of, rng: np.random.Generator) -> None:
    """They scale with the picture, and do not change with its origin or the order of the views."""
    matches = matches_of(moving(rng, 50, (0.0, 0.0, 6.0))) + rng.normal(0, 0.3, (7, 4, 50))
    used, noise = rng.random((7, 50)) < 0.8, np.full(7, 0.3)
    found = np.abs(residuals_of(matches, used, noise))
    scaled = np.abs(residuals_of(3 * matches + 100.0, used, 3 * noise))
    swapped = np.abs(residuals_of(matches[:, [2, 3, 0, 1]], used, noise))
    np.testing.assert_allclose(scaled, 3 * found, rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(swapped, found, rtol=1e-4, atol=1e-6)


def test_halves_of_a_body_predict_each_other_and_two_bodies_do_not(rng) -> None:
    points, labels = two_bodies(rng)
    points = cut(points, rng)
    groups = [np.flatnonzero(labels == label) for label in (1, 2)]
    evidence = EpipolarEvidence(points, PAIRS)
    evidence.measure_noise(groups)
    assert evidence.growth(*groups) > 1.0
    assert evidence.growth(*groups) == evidence.growth(*groups[::-1])
    for group in groups:
        left = np.nanmean(points[group, :, 0], axis=1) < np.nanmean(points[group, :, 0])
        assert evidence.growth(group[left], group[~left]) < 0.3
    assert evidence.cost(groups) < evidence.cost([np.arange(len(points))])


@pytest.mark.parametrize("noise", [0.1, 0.5])
def test_the_noise_is_measured(noise: float, rng: np.random.Generator) -> None:
    """Along the normal of its epipolar line a match has the noise of one coordinate."""
    points, labels = two_bodies(rng, noise)
    evidence = EpipolarEvidence(points, PAIRS)
    evidence.measure_noise([np.flatnonzero(labels == label) for label in (1, 2)])
    np.testing.assert_allclose(evidence.noise, noise, rtol=0.25)


@pytest.mark.parametrize("seed", range(3))
def test_bodies_in_perspective_are_found_and_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, labels = two_bodies(rng)
    points = cut(points, rng)
    for motions, kept in ((None, labels > 0), (2, labels > 0), (None, labels == 1)):
        drawn = draw_for_consensus(points[kept], np.random.default_rng(0))
        found = cluster_by_consensus(points[kept], drawn, np.random.default_rng(1), motions=motions)
        assert found.labels.max() == len(np.unique(labels[kept]))
        assert misclassification(found.labels, labels[kept]) <= 0.1


def test_more_motions_than_usual_may_be_asked_for(rng: np.random.Generator) -> None:
    points, _ = rigid_bodies(rng, sizes=(30,) * 11, frames=12)
    points = cut(points, rng)
    drawn = draw_for_consensus(points, np.random.default_rng(0))
    found = cluster_by_consensus(points, drawn, np.random.default_rng(1), motions=11)
    assert found.labels.max() == 11
