"""Normalised spectral clustering of tracks by their agreement."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.records import Floats, Integers

STARTS = 4
"""Starts of k-means: the first centre is drawn, the others are the farthest by angle."""
MAX_ITERATIONS = 30
"""Largest number of rounds of k-means."""
DENSE = 800
"""The number of tracks up to which the dense eigenvalue problem is solved."""
KRYLOV_VECTORS, MAX_RESTARTS = 4, 30
"""Lanczos vectors per eigenvector, and restarts after which the dense solver takes over."""
TOLERANCE, CHECK_TOLERANCE = 1e-5, 1e-3
"""Relative accuracies of an eigenvalue, and of the check that none was missed. With 1e-2 for the
check, 7 of 336 affinities of Hopkins155 and KT3DMoSeg lost an eigenvalue, with 1e-3 none."""
MARGIN = 1e-5
"""An eigenvalue that exceeds the smallest one found by this much was missed."""
FLOOR = 1e-9
"""Added to the affinity: two tracks that never agree are in one graph, too."""


def sharpen(agreement: npt.NDArray[np.floating], power: int) -> Floats:
    """The affinity [P, P] of tracks: their agreement, divided by its maximum, to a power.

    The higher the power, the less small agreements count.
    """
    largest = max(float(agreement.max(initial=0.0)), 1e-30)
    return np.asarray((agreement / largest) ** power, dtype=np.float64) + FLOOR


def embedding(affinity: Floats, dimensions: int) -> Floats:
    """Leading eigenvectors of the normalised affinity D^-1/2 W D^-1/2.

    Parameters
    ----------
    affinity
        A symmetric matrix W of positive numbers [P, P].
    dimensions
        The number of eigenvectors; at most P are returned.

    Returns
    -------
    array
        Orthonormal eigenvectors [P, dimensions], that of the largest eigenvalue first.

    References
    ----------
    A. Ng, M. Jordan and Y. Weiss, "On spectral clustering: analysis and an algorithm", NIPS 2001.

    Examples
    --------
    >>> import numpy as np
    >>> blocks = np.kron(np.eye(2), np.ones((3, 3))) + FLOOR
    >>> vectors = embedding(blocks, 2)
    >>> labels = partition(vectors, 2, np.random.default_rng(0))
    >>> bool(labels[0] == labels[2] != labels[3] == labels[5])
    True
    """
    size = len(affinity)
    root = 1.0 / np.sqrt(affinity.sum(axis=1))
    count = min(dimensions, size)
    normalised = affinity * root[:, None] * root
    if size > DENSE:
        vectors = _lanczos(normalised.astype(np.float32), count)
        if vectors is not None:
            return vectors
    import scipy.linalg  # takes 0.12 s to load, and two views do not need it

    _, vectors = scipy.linalg.eigh(
        normalised,
        subset_by_index=[size - count, size - 1],
        check_finite=False,
        overwrite_a=True,
    )
    return np.asarray(vectors[:, ::-1])


def _lanczos(matrix: npt.NDArray[np.float32], count: int) -> Floats | None:
    """Leading eigenvectors [P, count] of a symmetric matrix, None where Lanczos does not converge.

    From one start vector Lanczos finds one vector of a multiple eigenvalue, such as the eigenvalue
    1 of several groups without any agreement between them. So what remains of the matrix without
    the vectors found is searched, from another start, for eigenvalues that were missed.
    """
    import inspect

    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh  # 0.14 s to load

    rng = np.random.default_rng(0)
    options: dict[str, Any] = {"which": "LA", "maxiter": MAX_RESTARTS}
    if "rng" in inspect.signature(eigsh).parameters:  # since SciPy 1.17; unseeded by default
        options["rng"] = rng

    def start() -> npt.NDArray[np.float32]:
        return rng.standard_normal(len(matrix), dtype=np.float32)

    def across(x: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        # not by BLAS: OpenBLAS reads past a few columns and reports an invalid value now and then
        along = np.einsum("pk,p->k", vectors, x)
        return np.asarray(x - np.einsum("pk,k->p", vectors, along))

    def remainder(x: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return across(matrix @ across(x))

    krylov = min(max(KRYLOV_VECTORS * count, 20), len(matrix))
    try:
        values, vectors = eigsh(matrix, count, v0=start(), tol=TOLERANCE, ncv=krylov, **options)
        deflated = LinearOperator(matrix.shape, matvec=remainder, dtype=matrix.dtype)
        for _ in range(count):
            missed, vector = eigsh(deflated, 1, v0=start(), tol=CHECK_TOLERANCE, **options)
            if missed[0] <= values.min() + MARGIN:
                break
            missed, vector = eigsh(deflated, 1, v0=vector[:, 0], tol=TOLERANCE, **options)
            values, vectors = np.append(values, missed), np.hstack([vectors, vector])
    except ArpackNoConvergence:
        return None
    return np.asarray(vectors[:, np.argsort(-values)[:count]], dtype=np.float64)


def partition(vectors: Floats, groups: int, rng: np.random.Generator) -> Integers:
    """Labels by k-means of the rows of the first eigenvectors, divided by their norms.

    Parameters
    ----------
    vectors
        Eigenvectors [P, at least groups], as ``embedding`` returns them.
    groups
        The number of groups.
    rng
        Draws the first centre of each start.

    Returns
    -------
    array
        Labels from 0 to ``groups`` - 1 [P]. A group is empty where there are fewer distinct rows.
    """
    if groups <= 1:
        return np.zeros(len(vectors), dtype=np.int64)
    rows = vectors[:, :groups]
    rows = rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-12)
    best, labels = np.inf, np.zeros(len(rows), dtype=np.int64)
    for _ in range(STARTS):
        cost, found = _k_means(rows, groups, int(rng.integers(len(rows))))
        if cost < best:
            best, labels = cost, found
    return labels


def _k_means(rows: Floats, groups: int, first: int) -> tuple[float, Integers]:
    """The sum of squared distances and the labels [P], with row ``first`` as the first centre."""
    chosen, nearness = [first], np.abs(rows @ rows[first])
    for _ in range(groups - 1):
        chosen.append(int(nearness.argmin()))
        nearness = np.maximum(nearness, np.abs(rows @ rows[chosen[-1]]))
    centres = rows[chosen]
    labels = np.full(len(rows), -1)
    for _ in range(MAX_ITERATIONS):
        found = ((centres**2).sum(axis=1) - 2 * rows @ centres.T).argmin(axis=1)
        if (found == labels).all():
            break
        labels = found
        for group in range(groups):
            if (labels == group).any():
                centres[group] = rows[labels == group].mean(axis=0)
    return float(((rows - centres[labels]) ** 2).sum()), labels
