"""Exact data: noise-free, constant, repeated. No division by zero, and documents that are valid."""

from __future__ import annotations

import numpy as np
import pytest

import mssegment
from mssegment import documents
from mssegment.errors import DataError
from mssegment.manifolds import from_name
from mssegment.meanshift import MeanShift
from mssegment.meanshift.bandwidth import nearest_neighbour_bandwidth
from mssegment.records import Floats

FIRST = np.random.default_rng(0).uniform(50, 450, (80, 1, 2))
GRID = np.stack(np.meshgrid(np.arange(9.0) * 40, np.arange(9.0) * 40), -1).reshape(-1, 1, 2)


def moved(points: Floats, frames: int, by: tuple[float, float]) -> Floats:
    return points + np.arange(frames)[:, None] * np.array(by)


def scene(name: str, frames: int) -> Floats:
    """Tracks without any noise, [P, F, 2]."""
    time = np.arange(frames)
    if name == "translation":
        return moved(FIRST, frames, (3, 1))
    if name == "grid":
        return moved(GRID, frames, (7, 0))
    if name == "two":
        return np.concatenate(
            [moved(FIRST[:40], frames, (3, 1)), moved(FIRST[40:], frames, (-4, 2))]
        )
    if name == "static and one":
        return np.concatenate(
            [moved(FIRST[:40], frames, (0, 0)), moved(FIRST[40:], frames, (-4, 2))]
        )
    if name == "static":
        return moved(FIRST, frames, (0, 0))
    if name == "zoom":
        return 250 + (FIRST - 250) * (1 + 0.05 * time)[:, None]
    if name == "line":
        return moved(np.linspace(0, 400, 60)[:, None, None] * [1, 1], frames, (3, 1))
    if name == "one place":
        return moved(np.full((50, 1, 2), 100.0), frames, (3, 1))
    return np.zeros((30, frames, 2))


SCENES = (
    "translation",
    "grid",
    "two",
    "static and one",
    "static",
    "zoom",
    "line",
    "one place",
    "0",
)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("frames", [2, 3, 6, 9])
@pytest.mark.parametrize("name", SCENES)
def test_exact_tracks_end_in_valid_documents(name: str, frames: int) -> None:
    try:
        found = mssegment.segment_tracks(scene(name, frames), frame_size=(500, 500))
    except DataError:
        assert name in ("line", "one place", "0"), "only what determines no motion is refused"
        return
    for document in (found.tracks, found.hypotheses, found.segmentation):
        documents.decode(documents.encode(document), type(document))
    if name in ("translation", "grid", "zoom", "static and one"):
        assert len(found.motions) == 1
    if name == "static":
        assert not found.motions


@pytest.mark.parametrize("offset", [0, 1e4, 5e4, 5e5])
def test_a_common_offset_of_the_coordinates_changes_no_statement(offset: float) -> None:
    found = mssegment.segment_tracks(moved(FIRST, 2, (7, 3)) + offset)
    assert [len(motion.inliers) for motion in found.motions] == [80]
    assert not any("static," in note for note in found.hypotheses.history[-1].notes)


@pytest.mark.parametrize("name", ["special_linear(3)", "affine(2)", "grassmann(12,3)", "se2"])
def test_points_that_differ_by_rounding_are_one(name: str, rng: np.random.Generator) -> None:
    manifold = from_name(name)
    point = manifold.random_point(rng, 1)[0]
    points = manifold.project(point * (1 + 1e-15 * rng.normal(size=(60, *point.shape))))
    assert nearest_neighbour_bandwidth(manifold, points, rng) == 1.0


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("bandwidth", [1e3, 1e6, 1e12])
@pytest.mark.parametrize("name", ["affine(2)", "special_linear(3)", "euclidean(2)"])
def test_a_bandwidth_far_wider_than_the_data_gives_one_mode_among_them(
    name: str, bandwidth: float, rng: np.random.Generator
) -> None:
    manifold = from_name(name)
    one = manifold.random_point(rng, 1)
    points = manifold.exp(
        np.repeat(one, 50, axis=0), 0.3 * manifold.random_tangent(np.repeat(one, 50, axis=0), rng)
    )
    found = MeanShift(name, bandwidth=bandwidth).fit(points)
    assert len(found.cluster_centers_) == 1
    distances = manifold.dist(points, np.broadcast_to(found.cluster_centers_, points.shape))
    assert distances.max() < 1.0
