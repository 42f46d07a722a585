"""Matches at the border of two motions, which follow neither, are no motion of their own."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment.records import Floats, Integers

OBJECT = np.array([9.0, -4.0])
SETTINGS = {"hypothesize.model": "affine"}


def scene(
    rng: np.random.Generator, moves: bool, share: Floats, across: float
) -> tuple[Floats, Integers]:
    """A rectangle before a wall, and matches about its border; labels 1, 2 and 3.

    Border matches move by a ``share`` [n] of the way from the wall's motion, if it ``moves``, to
    that of the object.
    """
    wall = rng.uniform((0, 0), (640, 480), (400, 2))
    wall = wall[(np.abs(wall - (320, 240)) > (110, 90)).any(axis=1)]
    inner = rng.uniform((225, 165), (415, 315), (150, 2))
    sides = rng.uniform(-1.0, 1.0, len(share))
    right = np.array([(420.0, 240.0 + 80.0 * t) for t in sides])
    below = np.array([(320.0 + 100.0 * t, 320.0) for t in sides])
    border = np.where(np.arange(len(share))[:, None] % 2, right, below)
    start = np.concatenate([wall, inner, border])
    labels = np.repeat([1, 2, 3], [len(wall), len(inner), len(border)])
    world = moves * ((start - (320, 240)) @ [[0.02, 0.03], [-0.03, 0.02]] + [5.0, 2.0])
    path = np.concatenate([np.zeros(len(wall)), np.ones(len(inner)), share])[:, None]
    noise = np.where(labels == 3, across, 0.1)[:, None] * rng.standard_normal((len(labels), 2))
    return np.stack([start, start + world + path * (OBJECT - world) + noise], axis=1), labels


@pytest.mark.parametrize("moves", [True, False])
def test_blends_are_outliers(moves: bool) -> None:
    right = 0
    for seed in range(4):
        rng = np.random.default_rng(seed)
        points, labels = scene(rng, moves, rng.uniform(0.35, 0.65, 24), 0.3)
        found = mssegment.segment_tracks(points, SETTINGS, frame_size=(640, 480))
        right += len(found.motions) == 1 + moves and bool((found.labels[labels == 3] <= 0).all())
    assert right >= 3  # as motions of their own they are one more in each


@pytest.mark.parametrize("seed", range(4))
def test_a_third_body_that_moves_half_as_far_stays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, _ = scene(rng, True, np.full(24, 0.5), 0.1)
    found = mssegment.segment_tracks(points, SETTINGS, frame_size=(640, 480))
    assert len(found.motions) == 3
