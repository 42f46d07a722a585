"""Pieces of a motion that are apart, and pieces that touch."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment.records import Floats
from mssegment.segmentation.mdl.pieces import _touching

SETTINGS = {"segment.granularity": "object", "background.remove": False, "seed": 0}


def two_squares(rng: np.random.Generator, gap: float, turn: float) -> Floats:
    """Two squares of 40 matches, ``gap`` pixels between them, that turn by plus and minus ``turn``.

    Both move by (60, 20).
    """
    square = rng.uniform(-50, 50, (2, 40, 2))
    middle = np.array([[[50.0, 50.0]], [[150.0 + gap, 50.0]]])
    turned = square + turn * np.array([[[1.0]], [[-1.0]]]) * square[..., ::-1] * [1.0, -1.0]
    points = np.stack([square + middle, turned + middle + [60.0, 20.0]], axis=2)
    return points.reshape(80, 2, 2) + rng.normal(0, 0.2, (80, 2, 2))


@pytest.mark.parametrize("seed", range(3))
def test_bodies_that_are_apart_are_two_although_they_move_almost_alike(seed: int) -> None:
    points = two_squares(np.random.default_rng(seed), 200.0, 0.04)
    labels = mssegment.segment_tracks(points, SETTINGS).labels
    assert len(np.unique(labels[:40])) == len(np.unique(labels[40:])) == 1
    assert labels[0] != labels[-1]


def roof(rng: np.random.Generator) -> Floats:
    """Two squares that meet, the faces of a roof: parallax is along one direction, 2 px at most.

    That is 3 % of the displacement, as for any object.
    """
    first = rng.uniform([0.0, 0.0], [200.0, 100.0], (80, 2))
    height = 1.0 - np.abs(first[:, :1] - 100.0) / 100.0
    points = np.stack([first, first + [60.0, 20.0] + 2.0 * height * [0.8, 0.6]], axis=1)
    return np.asarray(points + rng.normal(0, 0.2, points.shape))


@pytest.mark.parametrize("seed", range(3))
def test_parts_that_touch_are_one_object_within_its_parallax(seed: int) -> None:
    labels = mssegment.segment_tracks(roof(np.random.default_rng(seed)), SETTINGS).labels
    assert len(np.unique(labels[labels > 0])) == 1


@pytest.mark.parametrize("seed", range(3))
def test_parts_that_turn_against_each_other_are_two_although_they_touch(seed: int) -> None:
    points = two_squares(np.random.default_rng(seed), 0.0, 0.04)
    labels = mssegment.segment_tracks(points, SETTINGS).labels
    truth = np.repeat([1, 2], 40)
    assert max((labels == truth).mean(), (labels == 3 - truth).mean()) > 0.9


def test_a_chain_of_touching_pieces_is_one_group() -> None:
    x = np.arange(90.0)
    points = np.stack([np.stack([x, 0.1 * (x % 3)], axis=1)] * 2, axis=1)
    labels = np.repeat([1, 2, 3], 30)
    assert [sorted(group) for group in _touching([0, 2, 1], labels, points)] == [[0, 1, 2]]
    apart = np.where(labels == 2, 0, labels)
    assert sorted(_touching([0, 2], apart, points)) == [[0], [2]]
