"""Normalised spectral partition of a co-membership matrix."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers

TRIES = 4
"""Starts of k-means: the first centre is drawn, the others are the farthest by angle."""
ROUNDS = 30
DENSE = 800
"""Up to so many tracks all eigenvectors are computed; more tracks: only the leading ones."""
SPARE_VECTORS, DEGREE, PASSES = 2.5, 8, 40
"""The leading eigenvectors are sought in a space so many times as large, by passes of Chebyshev
polynomials of so high a degree."""
CONVERGED = 1e-4
"""Largest |W v - w v| of the leading eigenvectors v of the normalised affinity W."""
FLOOR = 1e-9
"""Two tracks that never agree are still in one graph."""


def sharpen(agreement: npt.NDArray[np.floating], power: int) -> Floats:
    """The agreement [P, P], its largest value 1, to a power: small agreements count less."""
    largest = max(float(agreement.max(initial=0.0)), 1e-30)
    return np.asarray((agreement / largest) ** power, dtype=np.float64) + FLOOR


def embedding(affinity: Floats, dimensions: int) -> Floats:
    """Leading eigenvectors [P, dimensions] of the normalised affinity, the largest first."""
    size = len(affinity)
    root = 1.0 / np.sqrt(affinity.sum(axis=1))
    count = min(dimensions, size)
    normalised = affinity * root[:, None] * root
    if size > DENSE:
        vectors = _leading(normalised.astype(np.float32), count)
        if vectors is not None:
            return vectors
    import scipy.linalg  # slow to load, and two views need none of it

    _, vectors = scipy.linalg.eigh(
        normalised,
        subset_by_index=[size - count, size - 1],
        check_finite=False,
        overwrite_a=True,
    )
    return np.asarray(vectors[:, ::-1])


def _leading(matrix: npt.NDArray[np.float32], count: int) -> Floats | None:
    """Leading eigenvectors [P, count] of a matrix with eigenvalues in [0, 1], or None.

    Subspace iteration: a whole block at once misses no multiple eigenvalue, and Chebyshev
    polynomials damp everything below the block (Zhou, Saad, Tiago, Chelikowsky, J. Comput. Phys.
    219, 2006).
    """
    rng = np.random.default_rng(0)
    block = rng.normal(size=(len(matrix), int(SPARE_VECTORS * count) + 1)).astype(np.float32)
    for _ in range(PASSES):
        block, _ = np.linalg.qr(matrix @ block)
        image = matrix @ block
        values, turn = np.linalg.eigh((block.T @ image).astype(np.float64))
        block, image = block @ turn.astype(np.float32), image @ turn.astype(np.float32)
        apart = image[:, -count:] - block[:, -count:] * values[-count:].astype(np.float32)
        if np.linalg.norm(apart, axis=0).max() < CONVERGED:
            return np.asarray(block[:, : -count - 1 : -1], dtype=np.float64)
        middle = np.float32(max(values[0], 1e-3) / 2)
        before, block = block, image / middle - block
        for _ in range(DEGREE - 1):
            before, block = block, 2 * (matrix @ block / middle - block) - before
    return None


def partition(vectors: Floats, groups: int, rng: np.random.Generator) -> Integers:
    """Labels 0..groups-1 [P] from the first ``groups`` eigenvectors, rows of unit length.

    A group may stay empty where there are not so many different rows.
    """
    if groups <= 1:
        return np.zeros(len(vectors), dtype=np.int64)
    rows = vectors[:, :groups]
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
    best, labels = np.inf, np.zeros(len(rows), dtype=np.int64)
    for _ in range(TRIES):
        spread, found = _k_means(rows, groups, int(rng.integers(len(rows))))
        if spread < best:
            best, labels = spread, found
    return labels


def _k_means(rows: Floats, groups: int, first: int) -> tuple[float, Integers]:
    chosen, nearness = [first], np.abs(rows @ rows[first])
    for _ in range(groups - 1):
        chosen.append(int(nearness.argmin()))
        nearness = np.maximum(nearness, np.abs(rows @ rows[chosen[-1]]))
    centres = rows[chosen]
    labels = np.full(len(rows), -1)
    for _ in range(ROUNDS):
        found = ((centres**2).sum(axis=1) - 2 * rows @ centres.T).argmin(axis=1)
        if (found == labels).all():
            break
        labels = found
        for group in range(groups):
            if (labels == group).any():
                centres[group] = rows[labels == group].mean(axis=0)
    return float(((rows - centres[labels]) ** 2).sum()), labels
