"""Matches of a rigid body lie on its epipolar lines and at its depths."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment.geometry.epipolar import sampson
from mssegment.geometry.epipolar_fit import fit_epipolar
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import rotation
from mssegment.records import Floats
from mssegment.segmentation.mdl.likelihood import uniform_cost
from mssegment.segmentation.mdl.rigid_motions import with_numbers
from mssegment.segmentation.rigid_join import body_gains
from mssegment.segmentation.selection import Body

FOCAL, CENTRE = 700.0, np.array([320.0, 240.0])
NOISE = 0.3


def relief(seed: int, count: int = 200) -> Floats:
    """Matches [count, 2, 2] of a smooth relief that fills the picture, under a moving camera."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform([0, 0], [640, 480], (count, 2))
    depth = 10 + 4 * np.sin(pixels[:, :1] / 90) + 3 * np.cos(pixels[:, 1:] / 70)
    points = homogeneous((pixels - CENTRE) / FOCAL) * depth
    after = points @ rotation(np.array([0.01, -0.02, 0.015])).T + [0.7, 0.2, 0.1]
    views = [FOCAL * p[:, :2] / p[:, 2:] + CENTRE for p in (points, after)]
    return np.stack(views, axis=1) + rng.normal(0, NOISE, (count, 2, 2))


@pytest.mark.parametrize("scale", [1.0, 1e-3, 20.0])
def test_matches_of_the_body_gain_and_others_do_not(scale: float) -> None:
    points = relief(0)
    wrong = points[:60].copy()
    rng = np.random.default_rng(1)
    wrong[:, 1] += rng.choice([-1, 1], (60, 1)) * [8.0, -25.0]  # across the lines
    far = points[60:90].copy()
    far[:, 1] += [190.0, 54.0]  # along the lines, beyond all depths
    everything = np.concatenate([points, wrong, far]) * scale
    members = np.arange(len(everything)) < 200
    noise = NOISE * np.sqrt(2) * scale
    cost = uniform_cost(everything)
    found = body_gains(everything, members, noise, cost)
    assert (found[:200] > 0).mean() > 0.97
    assert (found[200:260] < 0).mean() > 0.9
    assert np.median(found[:200]) - np.median(found[260:]) > 4


def test_a_member_does_not_predict_its_own_depth() -> None:
    points = relief(2)
    points[0, 1] += [60.0, 17.0]
    members = np.ones(200, dtype=bool)
    with_it = body_gains(points, members, NOISE * np.sqrt(2), 10.0)
    members[0] = False
    without_it = body_gains(points, members, NOISE * np.sqrt(2), 10.0)
    assert with_it[0] == pytest.approx(without_it[0], abs=1.5)
    assert with_it[0] < np.median(with_it) - 4


def test_bodies_are_numbered_by_the_motions_that_have_tracks() -> None:
    bodies = (Body((0, 3), 5.0), Body((1,)), Body((4,)))
    labels = np.array([1, 1, 2, 5, 0])
    assert with_numbers(bodies, labels) == (Body((0,), 5.0), Body((1,)), Body((2,)))


@pytest.mark.parametrize("seed", [3, 5, 6])
def test_mismatches_within_the_relief_of_a_motion_are_no_part_of_the_scene(seed: int) -> None:
    """Nor are they a motion, although they are as near to each other as the relief is deep."""
    scene = relief(seed, 260)
    rng = np.random.default_rng(seed + 1)
    wrong = np.repeat(rng.uniform([0, 0], [640, 480], (60, 1, 2)), 2, axis=1)
    middle = np.median(scene[:, 1] - scene[:, 0], axis=0)
    wrong[:, 1] += middle + rng.uniform(-25, 25, (60, 2))
    matches = np.concatenate([scene, wrong])
    found = mssegment.segment_tracks(matches, {"background.remove": False}, frame_size=(640, 480))
    assert len(found.motions) == 1
    assert (found.labels[:260] == 1).mean() > 0.95
    unit = (matches - matches.mean(axis=0)) / 200.0
    fit = fit_epipolar(unit[:260, 0], unit[:260, 1], np.ones(260), NOISE / 200)
    error = sampson(fit.matrix[None], homogeneous(unit[260:, 0]), homogeneous(unit[260:, 1])).error
    off_their_lines = np.abs(error[0]) > 20 * NOISE / 200
    assert off_their_lines.sum() > 20
    assert (found.labels[260:][off_their_lines] == 0).mean() > 0.9
