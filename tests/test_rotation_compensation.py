"""The rotation of a camera that translates: estimated if there is one, and only then."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.projective import homogeneous
from mssegment.geometry.rotations import degrees, rotation
from mssegment.models import EXAMPLE_CAMERA as CAMERA
from mssegment.preprocessing.rotation_compensation import find_rotation

FOCAL, CENTRE = np.array([CAMERA.fx, CAMERA.fy]), np.array([CAMERA.cx, CAMERA.cy])


def rotated_view(rng, degrees):
    """Matches of a camera that translates and rotates, most static, some of a moving object."""
    x = rng.uniform([0.0, 0.0], [640.0, 480.0], (200, 2))
    space = homogeneous((x - CENTRE) / FOCAL)
    space *= rng.uniform(4.0, 20.0, (200, 1))
    angle = np.deg2rad(degrees)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    moved = space + np.array([0.1, 0.02, 0.5])
    moved[:40] += [0.4, 0.0, 0.0]
    moved = moved @ turn.T
    y = moved[:, :2] / moved[:, 2:] * FOCAL + CENTRE
    return np.stack([x, y], axis=1) + rng.normal(0.0, 0.1, (200, 2, 2)), turn


def test_the_rotation_of_the_camera_is_found(rng):
    points, turn = rotated_view(rng, 0.5)
    found = find_rotation(points, CAMERA, rng)
    assert found is not None
    # it maps the second view to the orientation of the first
    np.testing.assert_allclose(found.rotation @ turn, np.eye(3), atol=1e-3)
    assert found.share > 0.7


def test_a_camera_that_only_translates_has_no_rotation(rng):
    points, _ = rotated_view(rng, 0.0)
    found = find_rotation(points, CAMERA, rng)
    assert found is None or found.degrees < 0.05


def test_mismatches_have_no_rotation(rng):
    assert find_rotation(rng.uniform(0.0, 480.0, (60, 2, 2)), CAMERA, rng) is None
    assert find_rotation(rng.uniform(0.0, 480.0, (4, 2, 2)), CAMERA, rng) is None


def test_the_rotation_is_found_despite_a_large_moving_object(rng):
    # 45 % of the matches are on an object with its own translation
    space = rng.uniform([-4.0, -2.0, 1.0], [4.0, 2.0, 1.0], (220, 3)) * rng.uniform(4, 20, (220, 1))
    space[:100] = rng.uniform([1.0, -0.5, 7.0], [3.0, 0.5, 8.0], (100, 3))
    turn = rotation(np.radians([0.1, 0.5, -0.1]))
    moved = space + np.array([0.02, 0.01, 0.6])
    moved[:100] += [-0.35, 0.02, -0.2]
    both = [s[:, :2] / s[:, 2:] * FOCAL + CENTRE for s in (space, moved @ turn.T)]
    points = np.stack(both, axis=1) + rng.normal(0.0, 0.1, (220, 2, 2))
    found = find_rotation(points, CAMERA, rng)
    assert found is not None
    assert degrees(found.rotation @ turn) < 0.03
