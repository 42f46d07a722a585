"""Normalised patches around corners: zero mean, unit norm, so that light does not matter."""

from __future__ import annotations

import numpy as np

from mssegment.imaging.matching.views import Singles, View, sample
from mssegment.records import Floats

PATCH_SIDE = 13
PATCH_STEP = 1.3
COMPONENTS = 56
FLAT = 1e-3
"""A norm (grey levels) below which a patch has no texture to normalise."""


def grid(side: int, step: float) -> Singles:
    """Offsets (x, y) [side^2, 2] of a square grid around 0, in pixels."""
    line = (np.arange(side) - (side - 1) / 2) * step
    return np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2).astype(np.float32)


def describe(view: View, angles: Floats | None = None) -> Singles:
    """A patch of 13x13 samples, 1.3 pixels of the corner's level apart, per corner: [n, 169].

    ``angles`` [n] (radians) turn the patches; none leaves them upright.
    """
    centres = ((view.points + 0.5) / view.ratios - 0.5).astype(np.float32)
    offsets = grid(PATCH_SIDE, PATCH_STEP)
    if angles is None:
        x = centres[:, :1] + offsets[:, 0]
        y = centres[:, 1:] + offsets[:, 1]
    else:
        c, s = (f(angles).astype(np.float32)[:, None] for f in (np.cos, np.sin))
        x = centres[:, :1] + c * offsets[:, 0] - s * offsets[:, 1]
        y = centres[:, 1:] + s * offsets[:, 0] + c * offsets[:, 1]
    return normalised(sample(view.pyramid, view.levels, x, y))


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
