"""Tracks through a sequence: pyramidal Lucas-Kanade, forwards and back again."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from mssegment.imaging.corners import spread
from mssegment.imaging.pictures import Grey
from mssegment.records import Corners, Floats, Tracks

WINDOW = 15
LEVELS = 3
RETURN_ERROR = 0.5
DISTANCE = 5.0
WHOLE_UP_TO = 8
"""Sequences of at most this many frames are expected to be seen whole."""
SHORTEST = 5


def match(
    pictures: Sequence[Grey],
    corners: Sequence[Corners],
    *,
    window: int = WINDOW,
    levels: int = LEVELS,
    return_error: float = RETURN_ERROR,
    distance: float = DISTANCE,
    renew: bool | None = None,
    min_length: int | None = None,
) -> Tracks:
    """Follow corners from frame to frame by pyramidal Lucas-Kanade.

    A track ends where following it back misses by more than ``return_error`` pixels, where it
    leaves the picture, or where it comes closer than half of ``distance`` to an older one. With
    ``renew`` the corners of later frames start new tracks wherever none is within ``distance``
    pixels. Tracks seen in fewer than ``min_length`` frames are dropped. By default up to 8 frames
    give whole tracks only (from the first frame to the last), longer sequences renew and keep
    what lasts 5 frames.

    Returns tracks [P, F, 2] in pixels, NaN where not seen, in the order in which they begin.
    """
    count = len(pictures)
    whole = count <= WHOLE_UP_TO
    renew = not whole if renew is None else renew
    shortest = min_length if min_length is not None else (count if whole else SHORTEST)
    history = _start(corners[0].points, count, 0)
    before = _eight_bits(pictures[0])
    for frame in range(1, count):
        after = _eight_bits(pictures[frame])
        live = np.flatnonzero(np.isfinite(history[:, frame - 1, 0]))
        ends, kept = _follow(
            before, after, history[live, frame - 1], return_error, (window, levels)
        )
        live, ends = live[kept], ends[kept]
        apart = spread(ends, distance / 2)
        history[live[apart], frame] = ends[apart]
        if renew and frame < count - 1:
            fresh = _far_from(corners[frame].points, ends[apart], distance)
            history = np.concatenate([history, _start(fresh, count, frame)])
        before = after
    seen = np.isfinite(history[..., 0]).sum(axis=1)
    return Tracks(points=history[seen >= max(2, min(shortest, count))])


def _eight_bits(picture: Grey) -> npt.NDArray[np.uint8]:
    """What OpenCV's Lucas-Kanade takes."""
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _start(points: Floats, count: int, frame: int) -> Floats:
    """New tracks [n, count, 2] that are seen in ``frame`` only."""
    tracks = np.full((len(points), count, 2), np.nan)
    tracks[:, frame] = points
    return tracks


def _far_from(points: Floats, others: Floats, distance: float) -> Floats:
    """The points that have none of ``others`` within ``distance``."""
    if not len(points) or not len(others):
        return points
    gap, _ = cKDTree(others).query(points)
    return np.asarray(points[gap >= distance])


def _follow(
    before: npt.NDArray[np.uint8],
    after: npt.NDArray[np.uint8],
    points: Floats,
    return_error: float,
    search: tuple[int, int],
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Where points [n, 2] of one frame are in the next, and which of them came back."""
    if not len(points):
        return points, np.zeros(0, bool)
    start = points.astype(np.float32).reshape(-1, 1, 2)
    there, found = _lucas_kanade(before, after, start, search)
    back, returned = _lucas_kanade(after, before, there, search)
    miss = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    ends = there.reshape(-1, 2).astype(np.float64)
    height, width = after.shape
    inside = ((ends >= 0) & (ends <= (width - 1, height - 1))).all(axis=1)
    return ends, np.asarray(found & returned & (miss < return_error) & inside)


def _lucas_kanade(
    before: npt.NDArray[np.uint8],
    after: npt.NDArray[np.uint8],
    start: npt.NDArray[np.float32],
    search: tuple[int, int],
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    window, levels = search
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, np.empty_like(start), winSize=(window, window), maxLevel=levels
    )
    return np.asarray(ends, np.float32), np.asarray(found).ravel() == 1
