"""Which motion is that of the static world, as a moving camera sees it.

The static world surrounds the objects: its tracks are spread over most of the picture, in every
frame that shows it, while those of an object are in one place.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import BACKGROUND, Floats, Frame, Integers

MIN_SPREAD = 0.5
"""Standard deviation of the positions of the static world, relative to that of positions all over
the picture; the geometric mean of both directions."""


def find_camera_motion(points: Floats, labels: Integers, frames: Sequence[Frame]) -> int | None:
    """Find the motion of the static world under a moving camera.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        The tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for a motion, ``BACKGROUND`` for static tracks under a static camera.
    frames : sequence of Frame
        The F frames.

    Returns
    -------
    int or None
        Among the motions whose tracks are spread over at least half of the picture
        (``MIN_SPREAD``), that with the most scattered tracks: the largest determinant of their
        scatter matrix. None if there is no such motion, or if the static world is the background.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> points = np.repeat(rng.uniform(0, 100, (50, 1, 2)), 2, axis=1)
    >>> points[:20] = points[:20] / 5 + 40
    >>> labels = np.repeat([1, 2], [20, 30])
    >>> find_camera_motion(points, labels, 2 * [Frame("", 100, 100)])
    2
    """
    if (labels == BACKGROUND).any() or not len(labels):
        return None
    found, best = None, 0.0
    for label in range(1, int(labels.max()) + 1):
        own = points[labels == label]
        spread = mean_spread(own, frames)
        if spread >= MIN_SPREAD and len(own) * spread**2 > best:
            found, best = label, len(own) * spread**2
    return found


def mean_spread(points: Floats, frames: Sequence[Frame]) -> float:
    """How far the tracks of a motion are spread over the picture, on average over the frames.

    Parameters
    ----------
    points : ndarray [n, F, 2]
        The tracks of the motion in pixels, NaN where a point is not visible.
    frames : sequence of Frame
        The F frames.

    Returns
    -------
    float
        1 for tracks all over the picture, 0 for tracks on a line and in frames that show fewer than
        three: the geometric mean, over both principal directions, of the standard deviations of
        their positions, relative to that of a uniform distribution.
    """
    spreads = []
    for frame, positions in zip(frames, points.swapaxes(0, 1), strict=True):
        seen = positions[np.isfinite(positions).all(axis=1)]
        if len(seen) < 3:
            spreads.append(0.0)
            continue
        uniform = np.array([frame.width, frame.height]) / np.sqrt(12.0)
        covariance = np.cov((seen / uniform).T)
        spreads.append(float(max(np.linalg.det(covariance), 0.0) ** 0.25))
    return float(np.mean(spreads))
