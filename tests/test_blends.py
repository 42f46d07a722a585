"""Matches at the border of two motions, which follow neither, are no motion of their own."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment.records import Floats, Integers

WORLD, OBJECT = np.array([3.0, 1.0]), np.array([9.0, -4.0])


def scene(
    rng: np.random.Generator, world: Floats, share: Floats, across: float
) -> tuple[Floats, Integers]:
    """A rectangle before a wall, and matches about its border; labels 1, 2 and 3.

    Border matches move by a ``share`` [n] of the way from the wall's motion to that of the object.
    """
    wall = rng.uniform((0, 0), (640, 480), (400, 2))
    wall = wall[(np.abs(wall - (320, 240)) > (110, 90)).any(axis=1)]
    inner = rng.uniform((225, 165), (415, 315), (150, 2))
    sides = rng.uniform(-1.0, 1.0, len(share))
    right = np.array([(420.0, 240.0 + 80.0 * t) for t in sides])
    below = np.array([(320.0 + 100.0 * t, 320.0) for t in sides])
    border = np.where(np.arange(len(share))[:, None] % 2, right, below)
    start = np.concatenate([wall, inner, border])
    moves = [np.tile(world, (len(wall), 1)), np.tile(OBJECT, (len(inner), 1))]
    moves.append(world + share[:, None] * (OBJECT - world))
    labels = np.repeat([1, 2, 3], [len(wall), len(inner), len(border)])
    noise = np.where(labels == 3, across, 0.1)[:, None] * rng.standard_normal((len(labels), 2))
    return np.stack([start, start + np.concatenate(moves) + noise], axis=1), labels


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("world", [WORLD, np.zeros(2)])
def test_blends_are_outliers(seed: int, world: Floats) -> None:
    rng = np.random.default_rng(seed)
    points, labels = scene(rng, world, rng.uniform(0.35, 0.65, 24), 0.3)
    found = mssegment.segment_tracks(points, {"hypothesize.model": "affine"}, frame_size=(640, 480))
    assert len(found.motions) == (2 if world.any() else 1)
    assert (found.labels[labels == 3] <= 0).mean() > 0.7


@pytest.mark.parametrize("seed", range(4))
def test_a_third_body_that_moves_half_as_far_stays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, labels = scene(rng, WORLD, np.full(24, 0.5), 0.1)
    found = mssegment.segment_tracks(points, {"hypothesize.model": "affine"}, frame_size=(640, 480))
    assert len(found.motions) == 3
    assert len(set(found.labels[labels == 3])) == 1
