"""Homogeneous coordinates, and points mapped by homographies."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats

LEAST_DEPTH = 1e-12
"""Homogeneous depths nearer to zero than this are replaced by it before a division."""


def homogeneous(points: Floats) -> Floats:
    """Points [..., d] with a one behind their coordinates, [..., d + 1]."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def homogeneous_rows(points: Floats) -> Floats:
    """Points [..., P, 2] as rows x, y and 1, [..., 3, P]: the layout of ``transfer``."""
    return np.swapaxes(homogeneous(points), -1, -2)


def transfer(
    matrices: Floats, rows: Floats, least_depth: float = LEAST_DEPTH
) -> tuple[Floats, Floats, Floats]:
    """Images of points under homographies: H x in inhomogeneous coordinates.

    Parameters
    ----------
    matrices
        Homographies, [B, 3, 3] or flattened [B, 9].
    rows
        Homogeneous points as rows, [3, P], or [B, 3, P] where every homography has its own.
    least_depth
        Depths of a smaller magnitude are replaced by it before the division.

    Returns
    -------
    x, y, depth
        Image coordinates and homogeneous depth, [B, P] each. A depth that is not positive means
        that the point is mapped behind the camera.
    """
    flat = matrices.reshape(-1, 9)
    x, y, depth = (_product(flat[:, i : i + 3], rows) for i in (0, 3, 6))
    inverse = 1.0 / np.where(np.abs(depth) > least_depth, depth, least_depth)
    x *= inverse
    y *= inverse
    return x, y, depth


def transfer_sq_error(
    matrices: Floats, start: Floats, end: Floats, least_depth: float = 1e-9
) -> Floats:
    """Squared distances [B, P] of the images of ``start`` [3, P] (rows) from ``end`` [P, 2].

    Infinite where a point is mapped behind the camera (depth up to ``least_depth``).
    """
    x, y, depth = transfer(matrices, start)
    x -= end[:, 0]
    y -= end[:, 1]
    x *= x
    y *= y
    x += y
    return np.where(depth > least_depth, x, np.inf)


def _product(row: Floats, rows: Floats) -> Floats:
    return np.asarray(row @ rows if rows.ndim == 2 else (row[:, None] @ rows)[:, 0])
