"""Descriptors of corners: patches of zero mean and unit norm, unaffected by gain and offset."""

from __future__ import annotations

import numpy as np

from mssegment.imaging.matching.pyramid_corners import PyramidCorners
from mssegment.imaging.matching.resampling import Floats32, sample_windows, window_grid
from mssegment.records import Floats

PATCH_SIDE = 13
"""Samples along a side of a patch."""
PATCH_STEP = 1.3
"""Pixels of the corner's level between samples."""
COMPONENTS = 56
"""Coefficients of the cosine transform in a compressed descriptor."""
PATCHES_PER_BLOCK = 512
"""Patches sampled at a time, which then stay in the cache."""
MIN_PATCH_NORM = 1e-3
"""Grey levels; a patch of smaller norm has no texture to normalise."""


def describe(corners: PyramidCorners, angles: Floats | None = None) -> Floats32:
    """Normalised patches around corners.

    Parameters
    ----------
    corners : PyramidCorners
        The n corners, each sampled on its own level.
    angles : float array [n], optional
        Rotation of each patch in radians; upright by default.

    Returns
    -------
    float32 array [n, 169]
        13 x 13 samples, 1.3 pixels of the corner's level apart; zero mean and unit norm.
    """
    rotation = np.zeros(len(corners.points)) if angles is None else angles
    c, s = np.cos(rotation), np.sin(rotation)
    centres = (corners.points + 0.5) / corners.ratios - 0.5
    maps = np.stack([c, -s, centres[:, 0], s, c, centres[:, 1]], axis=1).reshape(-1, 2, 3)
    offsets = window_grid(PATCH_SIDE, PATCH_STEP)
    patches = np.empty((len(maps), len(offsets)), np.float32)
    for start in range(0, len(maps), PATCHES_PER_BLOCK):
        rows = slice(start, start + PATCHES_PER_BLOCK)
        patches[rows] = normalised(
            sample_windows(corners.pyramid, corners.levels[rows], maps[rows], offsets)
        )
    return patches


def normalised(patches: Floats32) -> Floats32:
    """Rows of ``patches`` [n, K] with zero mean and unit norm; rows without texture become zero."""
    patches = patches - patches.mean(axis=1, keepdims=True)
    norms = np.sqrt(np.einsum("nk,nk->n", patches, patches))
    return np.asarray(
        patches / np.where(norms < MIN_PATCH_NORM, np.inf, norms)[:, None], np.float32
    )


def compressed(patches: Floats32) -> Floats32:
    """The lowest frequencies of normalised patches [n, 169], with unit norm again: [n, 56].

    Neighbouring samples are correlated, and the highest frequencies are noise: the low part of the
    cosine transform keeps the order of distances at a third of the cost of comparing all pairs.
    """
    low = patches @ _low_frequencies()
    norms = np.sqrt(np.einsum("nk,nk->n", low, low))
    return np.asarray(low / np.maximum(norms, 1e-6)[:, None])


def _low_frequencies() -> Floats32:
    """The cosine basis [169, 56] of a patch, lowest frequencies first, without the constant."""
    line = (np.arange(PATCH_SIDE) + 0.5) / PATCH_SIDE
    waves = np.cos(np.pi * np.arange(PATCH_SIDE)[:, None] * line)
    waves /= np.linalg.norm(waves, axis=1, keepdims=True)
    i, j = np.divmod(np.arange(PATCH_SIDE**2), PATCH_SIDE)
    lowest = np.lexsort((i, i * i + j * j))[1 : COMPONENTS + 1]
    basis = waves[i[lowest], :, None] * waves[j[lowest], None, :]
    return np.asarray(basis.reshape(COMPONENTS, -1).T, np.float32)
