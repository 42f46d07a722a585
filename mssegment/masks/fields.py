"""Dense fields of the motions between two frames, from their tracks."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.geometry.projective import homogeneous
from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.neighbours import nearest
from mssegment.records import Floats

Field = npt.NDArray[np.float32]
"""[height, width, 2]: where each pixel of one frame lies in another."""

MIN_TRACKS = 3
"""Tracks that determine a field."""
GRID_STEP = 8
"""Pixels between the nodes at which a field is computed; between them it is bilinear."""
NEIGHBOURS = 8
"""Tracks that contribute to a node."""
ROUNDS = 5
"""Rounds of the robust affine fit."""


def motion_field(start: Floats, end: Floats, width: int, height: int) -> Field | None:
    """Extend the tracks of one motion to all pixels.

    The field is a robust affine map, plus what it leaves over at the nearest tracks, with weights
    that fall with their distance: it follows depth and deformation where there are tracks.

    Parameters
    ----------
    start, end : ndarray [n, 2]
        The positions of the tracks in both frames, in pixels.
    width, height : int
        Size of the first frame.

    Returns
    -------
    ndarray [height, width, 2] of float32, or None
        None for fewer than three tracks, or tracks on a line.
    """
    affine = _robust_affine(start, end)
    if affine is None:
        return None
    columns, rows = (np.arange(0, side + GRID_STEP, GRID_STEP) for side in (width, height))
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(np.float64)
    left_over = end - homogeneous(start) @ affine
    count = min(NEIGHBOURS, len(start))
    distance, index = nearest(start, nodes, count)
    reach = np.maximum(distance[:, count // 2 : count // 2 + 1], 1.0)
    weights = np.exp(-0.5 * (distance / reach) ** 2)
    weights /= weights.sum(axis=1, keepdims=True)
    placed = homogeneous(nodes) @ affine + np.einsum("nk,nkd->nd", weights, left_over[index])
    coarse = placed.reshape(len(rows), len(columns), 2).astype(np.float32)
    x, y = (np.arange(side, dtype=np.float32) / GRID_STEP for side in (width, height))
    return np.asarray(cv2.remap(coarse, *np.meshgrid(x, y), cv2.INTER_LINEAR), dtype=np.float32)


def _robust_affine(start: Floats, end: Floats) -> Floats | None:
    """The affine map [3, 2] of homogeneous rows; None if the tracks determine none."""
    if len(start) < MIN_TRACKS or np.linalg.matrix_rank(start - start.mean(axis=0), 1e-3) < 2:
        return None
    rows, weights = homogeneous(start), np.ones(len(start))
    affine: Floats = np.zeros((3, 2))
    for _ in range(ROUNDS):
        root = np.sqrt(weights)[:, None]
        affine = np.asarray(np.linalg.lstsq(root * rows, root * end, rcond=None)[0])
        squares = ((rows @ affine - end) ** 2).sum(axis=1)
        weights = geman_mcclure_weights(squares, 4.0 * float(np.median(squares)) + 1e-12)
    return affine
