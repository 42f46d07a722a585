"""Linear subspaces of R^n: least-squares fits and distances."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats

CANCELLATION = 1e-9
"""Where |w|^2 - |x'w|^2 is less than this share of |w|^2, rounding errors would dominate."""


def leading_directions(vectors: Floats, weights: Floats, rank: int) -> tuple[Floats, Floats]:
    """The leading principal directions of weighted vectors, without subtracting a mean.

    Parameters
    ----------
    vectors : ndarray [P, n] or [B, P, n]
        The vectors: the same for all fits, or those of each.
    weights : ndarray [B, P]
        Their weights in each of the B fits.
    rank : int
        The number of directions.

    Returns
    -------
    directions : ndarray [B, n, rank]
        Orthonormal, the strongest first.
    values : ndarray [B, rank]
        The weighted sums of squares along them.
    """
    if vectors.ndim == 3 and rank <= vectors.shape[1] < vectors.shape[2]:
        used = np.sqrt(weights)[..., None] * vectors
        values, axes = np.linalg.eigh(used @ np.swapaxes(used, 1, 2))
        leading = np.swapaxes(used, 1, 2) @ axes[:, :, : -rank - 1 : -1]
        directions = np.linalg.qr(leading).Q
    else:
        across = np.swapaxes(vectors, -1, -2) * weights[:, None]
        values, axes = np.linalg.eigh(across @ vectors)
        directions = axes[:, :, : -rank - 1 : -1]
    return directions, values[:, : -rank - 1 : -1]


def rejections(vectors: Floats, bases: Floats) -> Floats:
    """Squared distances [B, P] of vectors [P, n] or [B, P, n] from subspaces [B, n, k]."""
    along = vectors @ bases
    whole = (vectors**2).sum(axis=-1)
    squared = whole - (along**2).sum(axis=2)
    # where the difference cancels, compute the orthogonal component itself
    row, column = np.nonzero(squared < CANCELLATION * whole)
    rejected = vectors[column] if vectors.ndim == 2 else vectors[row, column]
    rejected = rejected - (bases[row] @ along[row, column, :, None])[..., 0]
    squared[row, column] = (rejected**2).sum(axis=1)
    return np.asarray(squared)
