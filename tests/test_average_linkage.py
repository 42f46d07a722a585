"""Objects before a static camera, their background, and the rank of subspaces."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from moving_bodies import rigid_bodies
from scipy.cluster.hierarchy import linkage
from scipy.spatial.distance import squareform

from mssegment import pipeline
from mssegment.configuration import from_text, resolve
from mssegment.evaluation import misclassification
from mssegment.preprocessing.background import find_background
from mssegment.records import BACKGROUND, NOT_JUDGED
from mssegment.sampling.frame_pairs import draw_for_consensus
from mssegment.segmentation.consensus import cluster_by_consensus
from mssegment.segmentation.consensus.average_linkage import average_linkage
from tests.stages import cluster


def test_merges_are_those_of_scipy(rng: np.random.Generator) -> None:
    places = rng.normal(size=(40, 3))
    agreement = np.exp(-np.linalg.norm(places[:, None] - places, axis=-1))
    found = average_linkage(agreement, np.ones((40, 40)))
    heights = linkage(squareform(1 - agreement, checks=False), "average")[:, 2]
    np.testing.assert_allclose([similarity for *_, similarity in found], 1 - heights, atol=1e-12)


def parallel_cars(rng: np.random.Generator, frames: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """Three cars on a road before a static camera, two approach, one recedes; partial tracks."""
    tracks, labels = [], []
    time = np.arange(frames)[:, None, None]
    cars = (((-2.0, -0.2, 30.0), 0.15), ((-2.0, -0.2, 17.0), 0.2), ((1.5, -0.2, 12.0), -0.1))
    for label, (corner, speed) in enumerate(cars, start=1):
        world = np.array(corner) + rng.uniform((0, 0, 0), (1.8, 1.4, 0.5), (60, 3))
        world = world - time * np.array([0, 0, speed])
        tracks.append(600 * np.swapaxes(world[..., :2] / world[..., 2:], 0, 1))
        labels += [label] * 60
    points = np.concatenate(tracks) + rng.normal(0, 0.15, (180, frames, 2))
    for track in points:
        start, length = rng.integers(0, frames // 2), rng.integers(frames // 3, frames)
        track[:start] = track[start + length :] = np.nan
    return points, np.array(labels)


@pytest.mark.parametrize("seed", range(3))
def test_cars_in_parallel_are_objects_before_a_static_camera(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points, labels = parallel_cars(rng)
    sets = draw_for_consensus(points, rng, static=True)
    assert sets.partition == "average_linkage"
    assert {entry.model for entry in sets.sets} == {"affine"}
    for motions in (None, 3):
        found = cluster_by_consensus(points, sets, rng, motions=motions)
        assert found.labels.max() == 3
        judged = found.labels != NOT_JUDGED
        assert judged.mean() > 0.95
        assert misclassification(found.labels[judged], labels[judged]) <= 0.05
    whole = cluster(points, sets, rng=rng)
    assert misclassification(whole.labels[judged], labels[judged]) <= 0.05
    assert [motion.model for motion in whole.motions] == ["affine"] * 3


@pytest.mark.data
def test_cars_before_a_static_camera_from_pixels(data_folder: Path) -> None:
    """The near car, at (380..540, 170..280) in frame 20, is a motion of its own, and no rail is."""
    video = data_folder / "video" / "car_traffic_small.mp4"
    settings = ["input.start=20", "input.stop=60", "hypothesize.model=factorization"]
    found = pipeline.run(resolve(from_text([f"input.images={video}", *settings]))).segmentation
    points, labels = found.tracks.points, found.labels
    x, y = points[:, 0].T
    near = (x > 300) & (x < 420) & (y > 180) & (y < 280) & (labels > 0)
    stream = (x > 200) & (x < 320) & (y > 70) & (y < 160) & (labels > 0)
    assert near.sum() > 50
    assert stream.sum() > 50
    car, cars = np.bincount(labels[near]).argmax(), np.bincount(labels[stream]).argmax()
    assert car != cars
    assert (labels[near] == car).mean() > 0.95
    assert (labels[stream] == cars).mean() > 0.9
    assert (labels == BACKGROUND).mean() > 0.5


def test_drifting_tracks_among_static_ones_are_background(rng: np.random.Generator) -> None:
    still = np.repeat(rng.uniform(10, (630, 470), (300, 1, 2)), 30, axis=1)
    still += rng.normal(0, 0.5, still.shape)
    drifting, slow = still[:20], still[20:60]
    drifting += np.linspace(0, 1, 30)[:, None] * (2.5, 0)
    slow[:] = rng.uniform((300, 200), (340, 240), (40, 1, 2)) + rng.normal(0, 0.5, slow.shape)
    slow += np.linspace(0, 1, 30)[:, None] * (0, 6)
    status = find_background(still, frame_size=(640, 480)).status
    assert (status[:20] == -1).mean() > 0.9
    assert (status[20:60] == 0).all()
    assert (status[60:] == -1).all()


def ranks(points: np.ndarray, rank: int | str) -> tuple[list[int], np.ndarray]:
    """Ranks of the motions that are found, and the labels."""
    rng = np.random.default_rng(0)
    sets = draw_for_consensus(points, rng, rank=rank)
    found = cluster(points, sets, motions=2, rng=rng)
    return [motion.parameters.shape[-1] for motion in found.motions], found.labels


def test_the_rank_of_a_motion_is_found_or_given(rng: np.random.Generator) -> None:
    points, labels = rigid_bodies(np.random.default_rng(5), sizes=(90, 60), frames=20)
    plane = rng.uniform(-60, 60, (60, 2))
    turn = 0.02 * np.arange(20)
    row = np.stack([np.cos(turn), 0.5 * np.sin(turn)]), np.stack([-np.sin(turn), np.cos(2 * turn)])
    planar = np.array((300, 100)) + np.stack([plane @ row[0], plane @ row[1]], axis=-1)
    planar[..., 0] += 2 * np.arange(20)
    points[labels == 2] = planar + rng.normal(0, 0.1, planar.shape)
    found, grouped = ranks(points, "auto")
    assert misclassification(grouped, labels) <= 0.02
    assert found == [4, 3]
    for rank in (3, 4):
        found, grouped = ranks(points, rank)
        assert found == [rank, rank]
        assert misclassification(grouped, labels) <= 0.05
