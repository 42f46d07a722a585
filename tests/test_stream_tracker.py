"""Tracks through a stream of frames."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.imaging.corners import detect
from mssegment.imaging.tracking import StreamTracker, dense_tracks


def drawn(path: npt.NDArray[np.float64]) -> list[npt.NDArray[np.uint8]]:
    """A textured square of 60 pixels before a textured wall, its left side at ``path`` [F]."""
    rng = np.random.default_rng(0)
    wall, body = (
        cv2.GaussianBlur(rng.uniform(0, 255, (160, 320)).astype(np.float32), (0, 0), 2)
        for _ in range(2)
    )
    pictures = []
    for left in path:
        shift = np.array([[1.0, 0, left], [0, 1, 50]])
        moved = cv2.warpAffine(body[:60, :60], shift, (320, 160))
        mask = cv2.warpAffine(np.ones((60, 60), np.float32), shift, (320, 160))
        grey = (wall * (1 - mask) + moved * mask - 128) * 4 + 128
        pictures.append(np.clip(grey + rng.normal(0, 2, grey.shape), 0, 255).astype(np.uint8))
    return pictures


def tracked(pictures: list[npt.NDArray[np.uint8]]) -> npt.NDArray[np.float64]:
    """Tracks of their corners [P, F, 2]."""

    def corners(grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
        found = detect(grey.astype(np.float32), levels=1, limit=500, distance=8.0, quality=0.01)
        return np.asarray(found.points)

    tracker = StreamTracker(pictures[0], corners(pictures[0]))
    frames = [tracker.state.live, *(tracker.step(grey, corners(grey)) for grey in pictures[1:])]
    return dense_tracks(frames)[1]


class TestTakenAlong:
    """What passes does not take along the tracks of what stands still."""

    def test_what_passes_takes_no_track_along(self) -> None:
        points = tracked(drawn(3.0 * np.arange(70) - 20))
        at_rest = np.linalg.norm(points[:, 5:] - points[:, :-5], axis=2) < 1
        rested = np.maximum.accumulate(at_rest, axis=1)
        leaves = rested[:, :-5] & (np.linalg.norm(points[:, 10:] - points[:, 5:-5], axis=2) > 10)
        assert at_rest.any(axis=1).sum() > 100
        assert leaves.any(axis=1).sum() <= 3

    def test_what_starts_and_stops_keeps_its_tracks(self) -> None:
        path = 60 + 3.0 * np.clip(np.arange(60) - 15, 0, 30)
        points = tracked(drawn(path))
        inside = (np.abs(points[:, 0] - [90, 80]) < 27).all(axis=1)
        assert inside.sum() > 8
        kept = points[inside, -1, 0] - points[inside, 0, 0]
        assert np.mean(np.abs(kept - 90) < 2) > 0.8
