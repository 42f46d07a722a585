"""Normalised patches around corners: zero mean, unit norm, so that light does not matter."""

from __future__ import annotations

import numpy as np

from mssegment.imaging.matching.views import Singles, View, grid, seen
from mssegment.records import Floats

PATCH_SIDE = 13
PATCH_STEP = 1.3
COMPONENTS = 56
BLOCK = 512
"""Corners at a time, so that what is looked at stays in the cache."""
FLAT = 1e-3
"""A norm (grey levels) below which a patch has no texture to normalise."""


def describe(view: View, angles: Floats | None = None) -> Singles:
    """A patch of 13x13 samples, 1.3 pixels of the corner's level apart, per corner: [n, 169].

    ``angles`` [n] (radians) turn the patches; none leaves them upright.
    """
    turned = np.zeros(len(view.points)) if angles is None else angles
    c, s = np.cos(turned), np.sin(turned)
    centres = (view.points + 0.5) / view.ratios - 0.5
    maps = np.stack([c, -s, centres[:, 0], s, c, centres[:, 1]], axis=1).reshape(-1, 2, 3)
    offsets = grid(PATCH_SIDE, PATCH_STEP)
    patches = np.empty((len(maps), len(offsets)), np.float32)
    for start in range(0, len(maps), BLOCK):
        rows = slice(start, start + BLOCK)
        patches[rows] = normalised(seen(view.pyramid, view.levels[rows], maps[rows], offsets))
    return patches


def normalised(patches: Singles) -> Singles:
    """Each row with its mean taken off and divided by its norm; flat rows become zero."""
    patches = patches - patches.mean(axis=1, keepdims=True)
    norms = np.sqrt(np.einsum("nk,nk->n", patches, patches))
    return np.asarray(patches / np.where(norms < FLAT, np.inf, norms)[:, None], np.float32)


def compressed(patches: Singles) -> Singles:
    """The low frequencies of normalised patches, unit norm again: [n, 56].

    Neighbouring samples say much the same, and the highest frequencies are noise; the lowest of
    the cosine transform keep who is near whom, at a third of the cost of comparing all with all.
    """
    low = patches @ _low_frequencies()
    norms = np.sqrt(np.einsum("nk,nk->n", low, low))
    return np.asarray(low / np.maximum(norms, 1e-6)[:, None])


def _low_frequencies() -> Singles:
    """The cosine basis [169, 56] of a patch, lowest frequencies first, without the constant."""
    line = (np.arange(PATCH_SIDE) + 0.5) / PATCH_SIDE
    waves = np.cos(np.pi * np.arange(PATCH_SIDE)[:, None] * line)
    waves /= np.linalg.norm(waves, axis=1, keepdims=True)
    i, j = np.divmod(np.arange(PATCH_SIDE**2), PATCH_SIDE)
    lowest = np.lexsort((i, i * i + j * j))[1 : COMPONENTS + 1]
    basis = waves[i[lowest], :, None] * waves[j[lowest], None, :]
    return np.asarray(basis.reshape(COMPONENTS, -1).T, np.float32)
