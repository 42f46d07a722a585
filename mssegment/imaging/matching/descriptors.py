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


def compressed(first: Singles, second: Singles, keep: int = COMPONENTS) -> tuple[Singles, Singles]:
    """Both sets on the principal components that they share, unit norm again.

    Neighbouring samples of a patch say much the same; a third of the numbers keeps the order of
    the nearest and makes the comparison of all with all three times as fast.
    """
    both = np.concatenate([first, second])
    _, vectors = np.linalg.eigh((both.T @ both).astype(np.float64))
    basis = vectors[:, -keep:].astype(np.float32)
    one, two = (rows @ basis for rows in (first, second))
    one, two = (
        rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-6) for rows in (one, two)
    )
    return one, two
