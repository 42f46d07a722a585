"""The affine maps between the frames of a sequence, from the tracks of one motion."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.projective import homogeneous
from mssegment.records import Floats

MIN_TRACKS = 3
"""Tracks that determine an affine map."""
COLLINEAR = 1e-6
"""Singular values whose ratio is smaller belong to points on a line, up to rounding errors."""


def affine_poses(points: Floats) -> Floats:
    """The affine map from the first frame of a motion to each frame, by least squares.

    A frame that shares tracks with the first one is mapped as these move. A track that begins
    later is brought back to the first frame by the maps of the frames before, so that a sequence
    may be longer than any of its tracks.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        The tracks of the motion in pixels, NaN where a point is not visible.

    Returns
    -------
    ndarray [F, 3, 3]
        The map of the first frame that shows three of the tracks is the identity. NaN for the
        frames before it, and for those in which the tracks determine no map.

    Examples
    --------
    >>> import numpy as np
    >>> first = np.array([[0.0, 0.0], [9.0, 0.0], [0.0, 9.0], [9.0, 9.0]])
    >>> pose = affine_poses(np.stack([first, 2 * first + [3, 4]], axis=1))[1]
    >>> np.allclose(pose, [[2, 0, 3], [0, 2, 4], [0, 0, 1]])
    True
    """
    visible = np.asarray(np.isfinite(points).all(axis=-1))
    poses = np.full((points.shape[1], 3, 3), np.nan)
    enough = np.flatnonzero(visible.sum(axis=0) >= MIN_TRACKS)
    if not len(enough):
        return poses
    first = int(enough[0])
    poses[first] = np.eye(3)
    reference = points[:, first].copy()
    begun = visible[:, first].copy()
    for frame in range(first + 1, points.shape[1]):
        seen = visible[:, frame]
        shared = begun & seen
        linear = _least_squares(reference[shared], points[shared, frame])
        if linear is None:
            continue
        poses[frame] = linear
        new = seen & ~begun
        if new.any() and abs(np.linalg.det(linear)) > 0:
            back = np.linalg.inv(linear)
            reference[new] = (homogeneous(points[new, frame]) @ back.T)[:, :2]
            begun |= new
    return poses


def _least_squares(start: Floats, end: Floats) -> Floats | None:
    """The affine map [3, 3] of points [n, 2]; None if they do not determine one."""
    if len(start) < MIN_TRACKS:
        return None
    middle, target = start.mean(axis=0), end.mean(axis=0)
    left, values, right = np.linalg.svd(start - middle, full_matrices=False)
    if values[1] <= COLLINEAR * values[0]:
        return None
    linear = (right.T / values @ left.T @ (end - target)).T
    return np.block([[linear, (target - linear @ middle)[:, None]], [np.zeros((1, 2)), np.ones(1)]])
