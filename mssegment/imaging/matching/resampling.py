"""Resampling of windows on the levels of image pyramids."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.imaging.pyramid import Level
from mssegment.records import Floats

Floats32 = npt.NDArray[np.float32]
Indices = npt.NDArray[np.intp]

MAX_REMAP_ROWS = 16384
"""Rows of one call: ``cv2.remap`` takes fewer than 32768."""


def runs_of_level(levels: Indices, max_rows: int = MAX_REMAP_ROWS) -> Iterator[tuple[slice, int]]:
    """Yield slices of equal ``levels`` [n], at most ``max_rows`` long, each with its level.

    Windows of one level should be adjacent: every change of level starts a new slice.
    """
    ends = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
    for begin, end in pairwise(ends):
        for start in range(begin, end, max_rows):
            yield slice(start, min(start + max_rows, end)), int(levels[begin])


def window_grid(side: int, step: float) -> Floats32:
    """Offsets (x, y) [side**2, 2] of a square grid of samples around 0, ``step`` pixels apart."""
    line = (np.arange(side) - (side - 1) / 2) * step
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2).astype(np.float32)


def sample_windows(
    pyramid: list[Level], levels: Indices, maps: Floats, offsets: Floats32
) -> Floats32:
    """Sample windows bilinearly, each on its own pyramid level.

    Parameters
    ----------
    pyramid : list of Level
        The levels of one picture.
    levels : int array [n]
        Level of each window; windows of one level should be adjacent.
    maps : float array [n, 2, 3]
        Affine maps from offsets (u, v, 1) in a window to pixels of its level.
    offsets : float32 array [K, 2]
        Offsets (u, v) of the samples.

    Returns
    -------
    float32 array [n, K]
        Grey values; outside the picture its border is repeated.
    """
    homogeneous = np.column_stack([offsets, np.ones_like(offsets[:, 0])]).T
    single = maps.astype(np.float32)
    x, y = single[:, 0] @ homogeneous, single[:, 1] @ homogeneous
    samples = np.empty(x.shape, np.float32)
    for rows, level in runs_of_level(levels):
        samples[rows] = cv2.remap(
            pyramid[level].grey, x[rows], y[rows], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
    return samples
