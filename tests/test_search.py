"""The search for the shortest description: its moves, and what they find."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.paper import run_scene
from benchmarks.scenes import SETUPS
from mssegment.segmentation.search import cut


def test_two_halves_lie_apart(rng: np.random.Generator) -> None:
    side = rng.random(60) < 0.4
    places = rng.normal(0.0, 20.0, (60, 2)) + np.where(side[:, None], [300.0, 80.0], 0.0)
    chosen = rng.random(60) < 0.8
    halves = cut(chosen, places)
    assert (halves.sum(axis=0) == chosen).all()
    truth = (chosen & side, chosen & ~side)
    assert any((halves[k] == truth[0]).all() and (halves[1 - k] == truth[1]).all() for k in (0, 1))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_tracks_and_tracks_in_one_place_are_cut_without_harm(count: int) -> None:
    tracks = np.arange(6) < count
    assert (cut(tracks, np.ones((6, 2))).sum(axis=0) == tracks).all()


@pytest.mark.parametrize("seed", [10, 140, 193])
def test_a_motion_that_fits_two_bodies_does_not_hide_them(seed: int) -> None:
    # scenes in which one translation fits two bodies, and the candidates of both fit them worse
    outcome = run_scene(SETUPS["fig2"], seed, "mdl", "surface")
    assert outcome.count_right
    assert outcome.unknown <= 0.05
