"""Labels coded by frequency where motions touch, and the price of a motion by degrees."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from mssegment.neighbours import nearest_others
from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.contact import BORDER, contact_cost, contacts
from mssegment.segmentation.mdl.degrees import degree_cost, squares_by_degree
from mssegment.segmentation.mdl.labelling import frequency_cost, neighbour_cost
from tests.stages import cluster, hypothesize

NEAREST = 8


def squares(rng: np.random.Generator, gap: float, each: int = 100) -> tuple[Floats, Integers]:
    """Points of two unit squares so far from one another, and their labels."""
    places = rng.uniform(0, 1, (2 * each, 2))
    labels = np.repeat([1, 2], each)
    places[:, 0] += np.where(labels == 2, 1 + gap, 0)
    return places, labels


@pytest.mark.parametrize("each", [20, 50, 200])
def test_the_border_of_squares_is_as_long_as_said(each: int) -> None:
    rng = np.random.default_rng(0)
    touching = []
    for _ in range(60):
        places, labels = squares(rng, 0.0, each)
        near = nearest_others(places, NEAREST)
        touching.append((labels[near] != labels[:, None]).any(axis=1).sum() / 2)
    assert np.mean(touching) / math.sqrt(each) == pytest.approx(BORDER, rel=0.08)


def test_squares_side_by_side_touch_and_those_apart_do_not(rng: np.random.Generator) -> None:
    for gap, low, high in ((0.0, 0.8, 1.0), (1.0, 0.0, 0.05)):
        places, labels = squares(rng, gap)
        found = contacts(labels, nearest_others(places, NEAREST), 2)
        assert np.array_equal(found, found.T)
        assert (np.diag(found) == 1).all()
        assert low <= found[0, 1] <= high


def test_labels_cost_by_frequency_only_where_motions_touch(rng: np.random.Generator) -> None:
    none = np.zeros(2)
    places, labels = squares(rng, 1.0)
    near = nearest_others(places, NEAREST)
    assert contact_cost(labels, near, none) < 0.05 * frequency_cost(labels)
    told = 2 * 0.5 * math.log(len(labels))  # the frequencies themselves
    assert contact_cost(labels, near, np.ones(2)) == pytest.approx(frequency_cost(labels) + told)
    assert contact_cost(labels, near, np.array([1.0, 0.0])) < 0.05 * frequency_cost(labels)
    places, labels = squares(rng, 0.0)
    near = nearest_others(places, NEAREST)
    assert contact_cost(labels, near, none) > 0.8 * frequency_cost(labels)
    assert neighbour_cost(labels, near) < 0.3 * frequency_cost(labels)


def test_the_names_of_labels_do_not_matter(rng: np.random.Generator) -> None:
    places = rng.uniform(0, 1, (60, 2))
    labels, smooth = rng.integers(0, 4, 60), np.array([0.2, 0.7, 0.4])
    near = nearest_others(places, NEAREST)
    other = np.array([0, 3, 1, 2])
    renamed = np.zeros(3)
    renamed[other[1:] - 1] = smooth
    cost = contact_cost(labels, near, smooth)
    assert contact_cost(other[labels], near, renamed) == pytest.approx(cost)
    one = np.minimum(labels, 1)
    assert contact_cost(one, near, smooth[:1]) == pytest.approx(
        frequency_cost(one) + 0.5 * math.log(len(one))
    )
    told = 0.5 * math.log(len(labels))
    assert contact_cost(np.ones_like(labels), near, smooth[:1]) == pytest.approx(told)
    assert contact_cost(np.zeros_like(labels), near, smooth[:1]) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("linear", "degrees"),
    [
        ([[0.0, 0.0], [0.0, 0.0]], (False, False)),
        ([[0.1, -0.2], [0.2, 0.1]], (True, False)),
        ([[0.1, 0.2], [0.2, -0.1]], (False, True)),
    ],
)
def test_each_degree_has_its_displacement(
    linear: list[list[float]], degrees: tuple[bool, bool]
) -> None:
    angle = np.linspace(0, 2 * np.pi, 13)[:-1]
    first = 30 * np.column_stack([np.cos(angle), np.sin(angle)]) + [200, 100]
    moved = (first - 50) @ np.array(linear).T + [7, -3]
    none = np.zeros(len(first))
    found = squares_by_degree(first, moved, none, np.ones(len(first)))
    spread = float(((moved - moved.mean(axis=0)) ** 2).sum(axis=1).mean())
    assert found == pytest.approx([spread * degrees[0], spread * degrees[1], 0.0], abs=1e-6)
    bent = moved + 0.01 * (first - 200) ** 2
    assert squares_by_degree(first, bent, none, np.ones(len(first)))[2] > 1


@pytest.mark.parametrize("square", [0.0, 0.01, 0.04, 1.0, 30.0])
def test_a_degree_costs_what_its_evidence_says(square: float) -> None:
    count, scale = 50, 1.0
    precision = scale**2 / count

    def minus_evidence(log_variance: float) -> float:
        total = math.exp(log_variance) + precision
        # two parameters whose squares sum to ``square``, less the likelihood at its maximum
        return math.log(total / precision) + 0.5 * square / total

    least = minimize_scalar(minus_evidence, bounds=(-30, 10), method="bounded").fun
    assert degree_cost(square, count, scale) == pytest.approx(least, abs=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_noisy_bodies_that_are_apart_are_not_one(seed: int) -> None:
    """One homography fits three translations almost as well as three motions do."""
    rng = np.random.default_rng(seed)
    places = np.array([[120, 120], [480, 140], [300, 380]])
    shifts = np.array([[14, 4], [-6, 16], [-12, -10]])
    first = np.concatenate([rng.uniform(-60, 60, (50, 2)) + place for place in places])
    second = first + np.repeat(shifts, 50, axis=0)
    points = np.stack([first, second], axis=1) + rng.normal(0, 1.5, (150, 2, 2))
    sets = hypothesize(points, model="homography", count=300, rng=rng)
    found = cluster(points, sets, rng=rng)
    assert len(found.motions) == 3
