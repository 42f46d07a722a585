"""Motions in pixels are what OpenCV's own estimators return from the inliers."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import mssegment
from mssegment import models
from mssegment.geometry.affine_poses import affine_poses
from mssegment.geometry.projective import homogeneous
from mssegment.models import EXAMPLE_CAMERA
from mssegment.records import replace

SAMPLES = Path(__file__).parents[1] / "sample_data"
PAIR = [SAMPLES / "affine" / "frame-1.png", SAMPLES / "affine" / "frame-2.png"]


def mapped(matrix, points):
    return cv2.perspectiveTransform(np.ascontiguousarray(points)[None], matrix)[0]


def affine2d(start, end, partial=False):
    estimate = cv2.estimateAffinePartial2D if partial else cv2.estimateAffine2D
    # without outliers: OpenCV has no plain least squares
    start, end = np.ascontiguousarray(start), np.ascontiguousarray(end)
    found, _ = estimate(start, end, ransacReprojThreshold=1e9, refineIters=50)
    return np.vstack([found, [0, 0, 1]])


ESTIMATORS = {
    "affine": affine2d,
    "similarity": lambda start, end: affine2d(start, end, partial=True),
    "homography": lambda start, end: cv2.findHomography(start.copy(), end.copy(), 0)[0],
}


@pytest.mark.parametrize("model", ["auto", *ESTIMATORS])
def test_matrix_is_that_of_opencv_on_the_inliers(model):
    found = mssegment.segment_pictures(PAIR, {"hypothesize.model": model})
    assert found.motions
    for motion in found.motions:
        start, end = np.moveaxis(found.points[motion.inliers], 1, 0)
        expected = ESTIMATORS[motion.model](start, end)
        assert np.abs(mapped(motion.matrix, start) - mapped(expected, start)).max() < 0.1


@pytest.mark.parametrize("name", models.of_pictures())
def test_every_model_states_exact_motions_in_pixels(name, rng):
    """A model gives a matrix, or a subspace, or a direction; each predicts its example tracks."""
    kind = models.class_named(name)
    model = models.make(name, frames=2 if kind.max_frames == 2 else 4)
    points = model.example_tracks(rng, 30)
    normalization = model.normalization(points, EXAMPLE_CAMERA)
    fitted, _ = model.fit(model.observe(points, normalization), np.ones((1, 30)))
    found = model.in_pixels(fitted[0], normalization)
    if "matrix" in found:
        assert np.abs(mapped(found["matrix"], points[:, 0]) - points[:, 1]).max() < 1e-6
        assert found["matrix"][2, 2] == pytest.approx(1.0)
    elif "basis" in found:
        basis = found["basis"].reshape(-1, found["basis"].shape[-1])
        tracks = (points - found["origin"]).reshape(30, -1).T
        assert np.abs(basis @ np.linalg.lstsq(basis, tracks, rcond=None)[0] - tracks).max() < 1e-6
    elif "rotation" not in found:
        # what approaches, with a negative z, moves away from the epipole
        outwards = points[:, 0] - found["epipole"]
        along = points[:, 1] - points[:, 0]
        cross = outwards[:, 0] * along[:, 1] - outwards[:, 1] * along[:, 0]
        assert np.abs(cross / np.linalg.norm(outwards, axis=1)).max() < 1e-6
        assert np.sign((outwards * along).sum(axis=1)).tolist() == 30 * [
            -np.sign(found["direction"][2])
        ]


def test_an_epipole_at_infinity_is_not_a_number():
    model = models.make("translation")
    normalization = model.normalization(np.zeros((1, 2, 2)), EXAMPLE_CAMERA)
    found = model.in_pixels(np.array([[1.0], [0.0], [0.0]]), normalization)
    assert np.isnan(found["epipole"]).all()
    assert found["direction"].tolist() == [-1.0, 0.0, 0.0]


def test_the_direction_of_a_translation_is_that_of_the_object(rng):
    """X2 = X1 + s t in the coordinates of the first camera: x right, y down, z forward."""
    model = models.make("translation")
    focal = np.array([EXAMPLE_CAMERA.fx, EXAMPLE_CAMERA.fy])
    middle = np.array([EXAMPLE_CAMERA.cx, EXAMPLE_CAMERA.cy])
    space = rng.uniform([-1.0, -1.0, 4.0], [1.0, 1.0, 6.0], (30, 3))
    for shift in rng.normal(0.0, 0.2, (8, 3)):
        both = np.stack([space, space + shift], axis=1)
        points = both[..., :2] / both[..., 2:] * focal + middle
        normalization = model.normalization(points, EXAMPLE_CAMERA)
        fitted, _ = model.fit(model.observe(points, normalization), np.ones((1, 30)))
        found = model.in_pixels(fitted[0], normalization)["direction"]
        assert np.allclose(found, shift / np.linalg.norm(shift), atol=1e-6)


def rigid_sequence(rng, frames=12, count=60):
    """Tracks of a plane, and its exact poses from the first frame."""
    poses = np.tile(np.eye(3), (frames, 1, 1))
    poses[1:, :2] += np.cumsum(rng.normal(0, [0.01, 0.01, 3.0], (frames - 1, 2, 3)), axis=0)
    first = rng.uniform(0, 300, (count, 2))
    return np.einsum("fij,pj->pfi", poses[:, :2], homogeneous(first)), poses


def test_poses_of_a_sequence(rng):
    tracks, poses = rigid_sequence(rng)
    assert np.allclose(affine_poses(tracks), poses, atol=1e-9)
    noisy = tracks + rng.normal(0, 0.5, tracks.shape)
    last = affine_poses(noisy)[-1]
    expected = affine2d(noisy[:, 0], noisy[:, -1])
    assert np.abs(mapped(last, noisy[:, 0]) - mapped(expected, noisy[:, 0])).max() < 0.1


def test_poses_reach_further_than_any_track(rng):
    tracks, poses = rigid_sequence(rng)
    start = rng.integers(0, 8, len(tracks))
    start[:12] = 0
    frame = np.arange(tracks.shape[1])
    tracks[(frame < start[:, None]) | (frame >= start[:, None] + 5)] = np.nan
    assert np.allclose(affine_poses(tracks), poses, atol=1e-6)


def test_frames_without_the_motion_have_no_pose(rng):
    tracks, poses = rigid_sequence(rng)
    tracks[:, [0, 1, 5]] = np.nan
    found = affine_poses(tracks)
    assert np.isnan(found[[0, 1, 5]]).all()
    assert np.allclose(found[2], np.eye(3))
    assert np.allclose(found[7], poses[7] @ np.linalg.inv(poses[2]), atol=1e-9)
    on_a_line = np.stack([np.arange(9.0)[:, None] * [1, 2], np.arange(9.0)[:, None] * [3, 1]], 1)
    assert np.isnan(affine_poses(on_a_line)[1]).all()


def test_sequences_have_a_matrix_per_frame_and_the_document_keeps_it(rng):
    one, _ = rigid_sequence(rng, frames=6)
    other, _ = rigid_sequence(rng, frames=6)
    tracks = np.concatenate([one, other + 400.0]) + rng.normal(0, 0.05, (120, 6, 2))
    found = mssegment.segment_tracks(tracks)
    assert len(found.motions) == 2
    for motion in found.motions:
        assert motion.matrix.shape == (6, 3, 3)
        assert motion.basis.shape[:2] == motion.origin.shape == (6, 2)
        start, end = found.points[motion.inliers][:, [0, 5]].swapaxes(0, 1)
        assert np.abs(mapped(motion.matrix[5], start) - end).max() < 1.0


def test_ids_of_the_user_must_be_one_per_track():
    from mssegment.documents import TracksDocument
    from mssegment.records import Frame, Tracks

    tracks = Tracks(np.zeros((2, 2, 2)), ids=("a", "b"))
    frames = [Frame("1.png", 9, 9), Frame("2.png", 9, 9)]
    assert TracksDocument(frames=frames, tracks=tracks).tracks.ids == ("a", "b")
    with pytest.raises(ValueError, match=r"tracks\.ids has 1 entries; expected 2"):
        TracksDocument(frames=frames, tracks=replace(tracks, ids=("a",)))
