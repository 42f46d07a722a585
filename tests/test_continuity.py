"""Faces of one object are merged; objects that meet in the image are not."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.configuration import from_text, resolve
from mssegment.documents import TracksDocument
from mssegment.pipeline import cluster, hypothesize
from mssegment.records import ClusterResult, Floats, Frame, Tracks
from mssegment.segmentation.mdl.continuity import group_motions

EDGE = 320.0


def box(rng: np.random.Generator, jump: float, size: int = 120) -> Floats:
    """Matches on two faces of a box that rotates about its edge; the right one may also jump."""
    first = rng.uniform((EDGE - 120, 100), (EDGE + 120, 380), (size, 2))
    right = first[:, 0] > EDGE
    stretch = np.where(right, 0.25, -0.25)
    second = first + np.array([30.0, 10.0])
    second[:, 0] += stretch * (first[:, 0] - EDGE)
    second[:, 1] += 0.2 * stretch * (first[:, 0] - EDGE)
    second[right] += jump
    return np.stack([first, second], axis=1) + rng.normal(0, 0.2, (size, 2, 2))


def segment(points: Floats, *assignments: str) -> ClusterResult:
    configuration = resolve(from_text([*assignments, "background.remove=no"]))
    frames = [Frame(name, 640, 480) for name in "ab"]
    document = TracksDocument(frames=frames, camera=None, tracks=Tracks(points))
    return cluster(hypothesize(document, configuration), configuration).segmentation


@pytest.mark.parametrize("model", ["affine", "auto"])
@pytest.mark.parametrize("seed", range(3))
def test_faces_are_one_object_and_two_surfaces(model: str, seed: int) -> None:
    points = box(np.random.default_rng(seed), 0.0)
    settings = [f"hypothesize.model={model}", f"seed={seed}"]
    assert len(segment(points, *settings).motions) == 1
    assert len(segment(points, *settings, "segment.granularity=surface").motions) == 2


@pytest.mark.parametrize("seed", range(3))
def test_objects_that_move_apart_at_their_border_are_two(seed: int) -> None:
    points = box(np.random.default_rng(seed), 25.0)
    for model in ("affine", "auto"):
        found = segment(points, f"hypothesize.model={model}", f"seed={seed}")
        assert len(found.motions) == 2


def test_a_given_number_of_motions_is_not_merged() -> None:
    points = box(np.random.default_rng(0), 0.0)
    assert len(segment(points, "segment.motions=2").motions) == 2
    assert len(segment(points, "segment.min_motions=2").motions) == 2


def test_connected_motions_are_one_object() -> None:
    labels = np.array([0, 1, 2, 3, 4])
    assert group_motions(labels, []).tolist() == [0, 1, 2, 3]
    assert group_motions(labels, [(0, 2), (2, 3)]).tolist() == [0, 1, 0, 0]
    assert group_motions(labels, [(2, 3), (0, 2)]).tolist() == [0, 1, 0, 0]
    assert group_motions(np.zeros(5, dtype=np.int64), []).tolist() == []


def test_the_order_of_the_tracks_does_not_matter(rng: np.random.Generator) -> None:
    points = box(rng, 25.0)
    order = rng.permutation(len(points))
    labels = segment(points[order]).labels
    assert (segment(points).labels[order] == labels).mean() > 0.97
