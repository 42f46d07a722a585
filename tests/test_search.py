"""The search for the shortest description: its moves and their results."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from benchmarks.paper import run_scene
from benchmarks.scenes import SETUPS
from mssegment.segmentation.mdl.candidates import FittedSets
from mssegment.segmentation.mdl.search import split_tracks


def test_two_halves_are_apart(rng: np.random.Generator) -> None:
    side = rng.random(60) < 0.4
    places = rng.normal(0.0, 20.0, (60, 2)) + np.where(side[:, None], [300.0, 80.0], 0.0)
    chosen = rng.random(60) < 0.8
    halves = split_tracks(chosen, places)
    assert (halves.sum(axis=0) == chosen).all()
    truth = (chosen & side, chosen & ~side)
    assert any((halves[k] == truth[0]).all() and (halves[1 - k] == truth[1]).all() for k in (0, 1))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_few_or_coincident_tracks_are_split_without_errors(count: int) -> None:
    tracks = np.arange(6) < count
    assert (split_tracks(tracks, np.ones((6, 2))).sum(axis=0) == tracks).all()


@pytest.mark.parametrize("seed", [10, 140, 193])
def test_a_motion_that_fits_two_objects_does_not_hide_them(seed: int) -> None:
    # scenes in which one translation fits two objects better than the candidates of both do
    outcome = run_scene(SETUPS["fig2"], seed, "mdl", "surface")
    assert outcome.count_right
    assert outcome.unknown <= 0.05


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_affine_motions_are_not_described_as_homographies(seed: int) -> None:
    rng = np.random.default_rng(seed)
    objects = []
    for centre, turn, shift in (((200, 200), 0.05, (6, 2)), ((500, 300), -0.1, (-9, 3))):
        places = rng.normal(centre, 60.0, (800, 2))
        c, s = np.cos(turn), np.sin(turn)
        moved = (places - centre) @ np.array([[c, -s], [s, c]]).T + centre + shift
        objects.append(np.stack([places, moved], axis=1))
    points = np.concatenate([*objects, rng.uniform(0, 640, (400, 2, 2))])
    points += rng.normal(0.0, 0.3, points.shape)
    found = mssegment.segment_tracks(points, {"seed": seed}, frame_size=(640, 640))
    assert [motion.model for motion in found.motions] == ["affine", "affine"]


def test_similar_sets_of_inliers_are_fitted_once() -> None:
    """A difference of one track in 50 is the same set, one of four is not; the first is kept."""
    rows = np.zeros((5, 100))
    rows[0, :50] = rows[1, :51] = rows[2, :54] = rows[3, 50:] = rows[4, 49:] = 1.0
    fitted = FittedSets(100)
    assert fitted.add_new(rows[:1]) == [0]
    assert fitted.add_new(rows) == [2, 3]
    assert fitted.add_new(rows) == []
    assert fitted.add_new(rows[:0]) == []
