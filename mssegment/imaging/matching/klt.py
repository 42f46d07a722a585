"""Matcher ``flow``: tracks through a sequence by pyramidal Lucas-Kanade with a backward check."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import ConfigurationError
from mssegment.imaging.corners import FEW_FRAMES, select_apart
from mssegment.imaging.matching.photometric import (
    PhotometricChange,
    abrupt_change,
    change_along_tracks,
    stretched_contrast,
)
from mssegment.imaging.pictures import GreyPicture
from mssegment.neighbours import nearest
from mssegment.progress import track
from mssegment.records import Corners, Floats, Record, Tracks

Bytes = npt.NDArray[np.uint8]

SEARCH_WINDOW = 15
"""Side in pixels of the Lucas-Kanade window."""
PYRAMID_LEVELS = 3
RETURN_ERROR = 0.5
"""Pixels by which a track followed back may miss its start."""
TRACK_DISTANCE = 5.0
"""Pixels around a track within which no corner starts a new one."""
MIN_TRACK_LENGTH = 3
"""Frames. Objects that cross the view quickly have no longer tracks, but a displacement between
two frames that no third frame confirms is no evidence."""


def match(
    pictures: Sequence[GreyPicture],
    corners: Sequence[Corners],
    *,
    window: int = SEARCH_WINDOW,
    levels: int = PYRAMID_LEVELS,
    return_error: float = RETURN_ERROR,
    distance: float = TRACK_DISTANCE,
    renew: bool | None = None,
    min_length: int | None = None,
) -> Tracks:
    """Track corners from frame to frame by pyramidal Lucas-Kanade (Bouguet 2000).

    A gain and an offset of the brightness from frame to frame are estimated and undone. A track
    ends where following it back misses by more than ``return_error``, where it leaves the picture,
    or where it comes closer than half of ``distance`` to an older one.

    Parameters
    ----------
    pictures : sequence of float32 array [height, width]
        Two or more grey frames, 0 to 255.
    corners : sequence of Corners
        The corners of each frame.
    window : int
        Side of the search window, pixels.
    levels : int
        Pyramid levels above the picture itself.
    return_error : float
        Largest forward-backward error, pixels.
    distance : float
        Least distance of a new track from existing ones, pixels.
    renew : bool, optional
        Whether corners of later frames start new tracks. By default for more than 8 frames.
    min_length : int, optional
        Drop tracks visible in fewer frames. By default 3 for more than 8 frames, else the number
        of frames: every track is complete.

    Returns
    -------
    Tracks
        Positions [P, F, 2] in pixels, NaN where not visible, in order of their first frame.

    Raises
    ------
    ConfigurationError
        If two views differ in size.
    """
    count = len(pictures)
    if count == 2 and pictures[0].shape != pictures[1].shape:
        raise ConfigurationError(
            "match.method is flow, which follows points between frames of one size, but these two "
            "views differ in size; set it to affine"
        )
    short_sequence = count <= FEW_FRAMES
    renew = not short_sequence if renew is None else renew
    if min_length is None:
        min_length = count if short_sequence else MIN_TRACK_LENGTH
    tracks = _start(corners[0].points, count, 0)
    search = _Search(window, levels, return_error)
    change = stretched_contrast(pictures[0])
    before = change.undo(pictures[0])
    for frame in track(range(1, count), "frames"):
        picture = pictures[frame]
        live = np.flatnonzero(np.isfinite(tracks[:, frame - 1, 0]))
        starts = tracks[live, frame - 1]
        ends, kept, change = _follow_under_change(before, picture, starts, change, search)
        live, ends = live[kept], ends[kept]
        apart = select_apart(ends, distance / 2)
        tracks[live[apart], frame] = ends[apart]
        if renew and frame < count - 1:
            fresh = far_from(corners[frame].points, ends[apart], distance)
            tracks = np.concatenate([tracks, _start(fresh, count, frame)])
        before = change.undo(picture)
    length = np.isfinite(tracks[..., 0]).sum(axis=1)
    return Tracks(points=tracks[length >= max(2, min(min_length, count))])


def _eight_bits(picture: GreyPicture) -> Bytes:
    """The picture in the depth that OpenCV's Lucas-Kanade takes."""
    return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)


def _start(points: Floats, count: int, frame: int) -> Floats:
    """New tracks [n, count, 2], visible in ``frame`` only."""
    tracks = np.full((len(points), count, 2), np.nan)
    tracks[:, frame] = points
    return tracks


def far_from(points: Floats, others: Floats, distance: float) -> Floats:
    """The points that have none of ``others`` within ``distance``."""
    if not len(points) or not len(others):
        return points
    gap, _ = nearest(others, points)
    return np.asarray(points[gap[:, 0] >= distance])


class _Search(Record, frozen=True):
    """Parameters of Lucas-Kanade: side of the window, pyramid levels, forward-backward error."""

    window: int
    levels: int
    return_error: float


def _follow_under_change(
    before: GreyPicture,
    picture: GreyPicture,
    starts: Floats,
    change: PhotometricChange,
    search: _Search,
) -> tuple[Floats, npt.NDArray[np.bool_], PhotometricChange]:
    """Follow points, and a second time if the first shows that the brightness has changed.

    ``before`` has the brightness of frame 1; ``change`` is the change up to it.
    """
    change = change.then(abrupt_change(before, change.undo(picture)))
    after = change.undo(picture)
    ends, kept = _follow(before, after, starts, search)
    if kept.any():
        further = change_along_tracks(before, after, starts[kept], ends[kept])
        if further.is_noticeable:
            change = change.then(further)
            ends, kept = _follow(before, change.undo(picture), starts, search)
    return ends, kept, change


def _follow(
    before: GreyPicture, after: GreyPicture, points: Floats, search: _Search
) -> tuple[Floats, npt.NDArray[np.bool_]]:
    """Positions of points [n, 2] in the next frame, and which pass the backward check."""
    if not len(points):
        return points, np.zeros(0, bool)
    one, two = _eight_bits(before), _eight_bits(after)
    start = points.astype(np.float32).reshape(-1, 1, 2)
    end, found = _lucas_kanade(one, two, start, search)
    back, returned = _lucas_kanade(two, one, end, search)
    error = np.linalg.norm((back - start).reshape(-1, 2), axis=1)
    ends = end.reshape(-1, 2).astype(np.float64)
    height, width = after.shape
    inside = ((ends >= 0) & (ends <= (width - 1, height - 1))).all(axis=1)
    return ends, np.asarray(found & returned & (error < search.return_error) & inside)


def _lucas_kanade(
    before: Bytes,
    after: Bytes,
    start: npt.NDArray[np.float32],
    search: _Search,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """End points [n, 1, 2], and which of them OpenCV found."""
    side = (search.window, search.window)
    ends, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, start, np.empty_like(start), winSize=side, maxLevel=search.levels
    )
    return np.asarray(ends, np.float32), np.asarray(found).ravel() == 1
