"""Homogeneous coordinates, and homographies applied to points."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats

MIN_DEPTH = 1e-12
"""Homogeneous depths of smaller magnitude are replaced by this before division."""


def homogeneous(points: Floats) -> Floats:
    """Append a one to the coordinates of points: [..., d] to [..., d + 1]."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def homogeneous_rows(points: Floats) -> Floats:
    """Points [..., P, 2] as rows x, y and 1, [..., 3, P]: the layout of ``transfer``."""
    return np.swapaxes(homogeneous(points), -1, -2)


def transfer(
    matrices: Floats, rows: Floats, min_depth: float = MIN_DEPTH
) -> tuple[Floats, Floats, Floats]:
    """Apply homographies to points: H x in inhomogeneous coordinates.

    Parameters
    ----------
    matrices : ndarray [B, 3, 3] or [B, 9]
        Homographies.
    rows : ndarray [3, P] or [B, 3, P]
        Homogeneous points as rows: the same for all homographies, or P for each.
    min_depth : float
        Depths of smaller magnitude are replaced by it before division.

    Returns
    -------
    x, y : ndarray [B, P]
        Image coordinates.
    depth : ndarray [B, P]
        Homogeneous depths. Where the depth is not positive, the image is behind the camera.

    Examples
    --------
    >>> import numpy as np
    >>> shift = np.array([[[1.0, 0.0, 5.0], [0.0, 1.0, 2.0], [0.0, 0.0, 1.0]]])
    >>> x, y, depth = transfer(shift, homogeneous_rows(np.array([[1.0, 1.0], [3.0, 0.0]])))
    >>> x.tolist(), y.tolist(), depth.tolist()
    ([[6.0, 8.0]], [[3.0, 2.0]], [[1.0, 1.0]])
    """
    flat = matrices.reshape(-1, 9)
    x, y, depth = (_product(flat[:, i : i + 3], rows) for i in (0, 3, 6))
    inverse = 1.0 / np.where(np.abs(depth) > min_depth, depth, min_depth)
    x *= inverse
    y *= inverse
    return x, y, depth


def in_pixels(matrices: Floats, centres: Floats, scale: float) -> Floats:
    """Homographies between normalized views as homographies between views in pixels.

    Parameters
    ----------
    matrices : ndarray [..., 3, 3]
        Maps from view 1 to view 2 in coordinates (x - centre) / scale.
    centres : ndarray [2, 2]
        The origins of both views in pixels.
    scale : float
        Pixels per unit.

    Returns
    -------
    ndarray [..., 3, 3]
        The same maps in pixels. The last entry is 1, as OpenCV has it, unless it is 0.

    Examples
    --------
    >>> import numpy as np
    >>> in_pixels(np.eye(3), np.array([[100.0, 50.0], [110.0, 54.0]]), 20.0)[:2, 2].tolist()
    [10.0, 4.0]
    """
    into = np.array([[1.0, 0.0, -centres[0, 0]], [0.0, 1.0, -centres[0, 1]], [0.0, 0.0, scale]])
    out = np.array([[scale, 0.0, centres[1, 0]], [0.0, scale, centres[1, 1]], [0.0, 0.0, 1.0]])
    pixels = out @ matrices @ (into / scale)
    last = pixels[..., 2:, 2:]
    return np.asarray(pixels / np.where(last == 0.0, 1.0, last))


def transfer_sq_error(
    matrices: Floats, start: Floats, end: Floats, min_depth: float = 1e-9
) -> Floats:
    """Squared distances [B, P] of the images of ``start`` [3, P] (rows) from ``end`` [P, 2].

    Infinite where a point is mapped behind the camera (depth at most ``min_depth``).
    """
    x, y, depth = transfer(matrices, start)
    x -= end[:, 0]
    y -= end[:, 1]
    x *= x
    y *= y
    x += y
    return np.where(depth > min_depth, x, np.inf)


def _product(row: Floats, rows: Floats) -> Floats:
    """Products [B, P] of matrix rows [B, 3] with points as rows, [3, P] or [B, 3, P]."""
    return np.asarray(row @ rows if rows.ndim == 2 else (row[:, None] @ rows)[:, 0])
