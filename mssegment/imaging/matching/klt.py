"""Tracks through a sequence: pyramidal Lucas-Kanade, forwards and back again."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.imaging.corners import FEW_FRAMES, spread
from mssegment.imaging.matching.photometric import Light, first_light, flash, light_between
from mssegment.imaging.pictures import Grey
from mssegment.neighbours import nearest
from mssegment.records import Corners, Floats, Record, Tracks

Bytes = npt.NDArray[np.uint8]

WINDOW = 15
LEVELS = 3
RETURN_ERROR = 0.5
DISTANCE = 5.0
SHORTEST = 3
"""What crosses the picture in a few frames is lost among longer tracks only; two frames say nothing
that a third confirms."""


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

    A gain and an offset of the light from frame to frame are found and undone. A track ends where
    following it back misses by more than ``return_error`` pixels, where it leaves the picture, or
    where it comes closer than half of ``distance`` to an older one. With ``renew`` the corners of
    later frames start new tracks wherever none is within ``distance`` pixels. Tracks seen in fewer
    than ``min_length`` frames are dropped. By default up to 8 frames give whole tracks only (from
    the first frame to the last), longer sequences renew and keep what lasts 3 frames.

    Returns tracks [P, F, 2] in pixels, NaN where not seen, in the order in which they begin.
    """
    count = len(pictures)
    whole = count <= FEW_FRAMES
    renew = not whole if renew is None else renew
    shortest = min_length if min_length is not None else (count if whole else SHORTEST)
    history = _start(corners[0].points, count, 0)
    search = _Search(window, levels, return_error)
    light = first_light(pictures[0])
    before = light.undone(pictures[0])
    for frame in range(1, count):
        picture = pictures[frame]
        live = np.flatnonzero(np.isfinite(history[:, frame - 1, 0]))
        starts = history[live, frame - 1]
        ends, kept, light = _follow_in_any_light(before, picture, starts, light, search)
        live, ends = live[kept], ends[kept]
        apart = spread(ends, distance / 2)
        history[live[apart], frame] = ends[apart]
        if renew and frame < count - 1:
            fresh = _far_from(corners[frame].points, ends[apart], distance)
            history = np.concatenate([history, _start(fresh, count, frame)])
        before = light.undone(picture)
    seen = np.isfinite(history[..., 0]).sum(axis=1)
    return Tracks(points=history[seen >= max(2, min(shortest, count))])


def _eight_bits(picture: Grey) -> Bytes:
    """What OpenCV's Lucas-Kanade takes."""
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def _start(points: Floats, count: int, frame: int) -> Floats:
    """New tracks [n, count, 2] that are seen in ``frame`` only."""
    tracks = np.full((len(points), count, 2), np.nan)
    tracks[:, frame] = points
    return tracks


def _far_from(points: Floats, others: Floats, distance: float) -> Floats:
    """The points that have none of ``others`` within ``distance``."""
    if not len(points) or not len(others):
        return points
    gap, _ = nearest(others, points)
    return np.asarray(points[gap[:, 0] >= distance])


class _Search(Record, frozen=True):
    """How Lucas-Kanade looks: side of the window, pyramid levels, allowed miss on the way back."""

    window: int
    levels: int
    return_error: float


def _follow_in_any_light(
    before: Grey, picture: Grey, starts: Floats, light: Light, search: _Search
) -> tuple[Floats, npt.NDArray[np.bool_], Light]:
    """Follow points, and once more if what they show is that the light has changed.

    ``before`` is in the first frame's light, ``light`` is the change up to it.
    """
    light = light.then(flash(before, light.undone(picture)))
    after = light.undone(picture)
    ends, kept = _follow(before, after, starts, search)
    if kept.any():
        change = light_between(before, after, starts[kept], ends[kept])
        if change.is_clear:
            light = light.then(change)
            ends, kept = _follow(before, light.undone(picture), starts, search)
    return ends, kept, light


def _follow(
    before: Grey, after: Grey, points: Floats, search: _Search
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Where points [n, 2] of one frame are in the next, and which of them came back."""
    if not len(points):
        return points, np.zeros(0, bool)
    one, two = _eight_bits(before), _eight_bits(after)
    start = points.astype(np.float32).reshape(-1, 1, 2)
    there, found = _lucas_kanade(one, two, start, search)
    back, returned = _lucas_kanade(two, one, there, search)
    miss = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    ends = there.reshape(-1, 2).astype(np.float64)
    height, width = after.shape
    inside = ((ends >= 0) & (ends <= (width - 1, height - 1))).all(axis=1)
    return ends, np.asarray(found & returned & (miss < search.return_error) & inside)


def _lucas_kanade(
    before: Bytes,
    after: Bytes,
    start: npt.NDArray[np.float32],
    search: _Search,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    side = (search.window, search.window)
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, np.empty_like(start), winSize=side, maxLevel=search.levels
    )
    return np.asarray(ends, np.float32), np.asarray(found).ravel() == 1
