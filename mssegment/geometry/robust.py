"""Robust weights, and EM for groups of vectors with Student t distributions.

References
----------
Geman and McClure, Statistical methods for tomographic image reconstruction, 1987.
Lange, Little and Taylor, Robust statistical modeling using the t distribution, 1989.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.records import Floats, Integers, Record

STUDENT_T_ROUNDS = 3
"""Rounds of reweighting in ``StudentTFit``."""


def geman_mcclure_weights(squared: Floats, squared_scale: Floats | float) -> Floats:
    """Weights 1 / (1 + r^2 / s^2)^2 from squared residuals r^2 and the squared scale s^2."""
    return np.asarray((1 + squared / squared_scale) ** -2.0)


def student_t_weights(squared: Floats, freedom: float, dimension: int) -> Floats:
    """Weights (nu + d) / (nu + q) of d-dimensional vectors in a Student t distribution.

    ``squared`` are squared Mahalanobis distances q and ``freedom`` is nu, the degrees of freedom.
    Reweighting with these weights maximizes the likelihood.
    """
    return np.asarray((freedom + dimension) / (freedom + squared))


class StudentT(Record, frozen=True):
    """Student t distributions of G groups, evaluated at all P vectors.

    Attributes
    ----------
    squared : ndarray [G, P]
        Squared Mahalanobis distances.
    log_det : ndarray [G]
        Logarithm of the determinant of each scatter matrix.
    weights : ndarray [G, P]
        Weights of the last reweighting; zero for vectors of other groups.
    scatter : ndarray [G, D, D]
        Scatter matrices, with the minimum spread.
    """

    squared: Floats
    log_det: Floats
    weights: Floats
    scatter: Floats


class StudentTFit:
    """Fit Student t distributions to groups of vectors, many groups at a time.

    Parameters
    ----------
    vectors : ndarray [P, D]
        All vectors.
    freedom : float
        Degrees of freedom of the distributions.
    min_spread : float
        Standard deviation that is added along each axis, which keeps scatter matrices regular.

    Examples
    --------
    A distant vector does not influence the distribution of the others:

    >>> import numpy as np
    >>> vectors = np.array([[0.0], [1.0], [2.0], [3.0], [1000.0]])
    >>> fitted = StudentTFit(vectors, freedom=1.0, min_spread=0.1)(np.ones((1, 5)))
    >>> fitted.weights.shape, bool(fitted.weights[0, 4] < 0.5 * fitted.weights[0, 2])
    ((1, 5), True)
    """

    def __init__(self, vectors: Floats, freedom: float, min_spread: float) -> None:
        self._vectors, self._freedom, self._min_spread = vectors, freedom, min_spread
        self._upper = np.triu_indices(vectors.shape[1])
        self._products = vectors[:, self._upper[0]] * vectors[:, self._upper[1]]

    def __call__(self, members: Floats) -> StudentT:
        """Fit one distribution to each group; ``members`` [G, P] are 0 or 1."""
        dimensions = self._vectors.shape[1]
        sizes = members.sum(axis=1)[:, None, None]
        weights = members
        for _ in range(STUDENT_T_ROUNDS):
            last_weights = weights
            total = weights.sum(axis=1)
            mean = weights @ self._vectors / total[:, None]
            scatter = np.empty((len(members), dimensions, dimensions))
            moments = weights @ self._products
            scatter[:, self._upper[0], self._upper[1]] = moments
            scatter[:, self._upper[1], self._upper[0]] = moments
            scatter -= total[:, None, None] * mean[:, :, None] * mean[:, None, :]
            scatter = scatter / sizes + self._min_spread**2 * np.eye(dimensions)
            lower = np.linalg.cholesky(scatter)
            whitened = np.linalg.inv(lower) @ (self._vectors.T - mean[:, :, None])
            squared = (whitened**2).sum(axis=1)
            weights = members * student_t_weights(squared, self._freedom, dimensions)
        log_det = 2 * np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
        return StudentT(squared, log_det, last_weights, scatter)


def hard_em(
    labels: Integers, costs: Callable[[Floats], Floats], rounds: int, min_size: int
) -> Integers:
    """Cluster by hard expectation maximization: each vector joins the group of least cost.

    Parameters
    ----------
    labels : ndarray [P] of int
        Initial labels.
    costs : callable
        Maps groups ``members`` [G, P] (0 or 1) to the costs [G, P] of all vectors in them.
    rounds : int
        Maximum number of rounds.
    min_size : int
        Groups of fewer vectors are dissolved.

    Returns
    -------
    ndarray [P] of int
        Labels 0, 1, ... without gaps; all zero if every group was dissolved.

    Examples
    --------
    With squared distances from the mean as costs this is k-means:

    >>> import numpy as np
    >>> x = np.array([0.0, 1.0, 0.5, 9.0, 10.0])
    >>> def costs(members):
    ...     means = members @ x / members.sum(axis=1)
    ...     return (x - means[:, None]) ** 2
    >>> hard_em(np.array([0, 0, 1, 1, 1]), costs, rounds=10, min_size=2).tolist()
    [0, 0, 0, 1, 1]
    """
    for _ in range(rounds):
        names, sizes = np.unique(labels, return_counts=True)
        names = names[sizes >= min_size]
        if not len(names):
            return np.zeros(len(labels), dtype=np.int64)
        found = names[costs((labels == names[:, None]).astype(np.float64)).argmin(axis=0)]
        if np.array_equal(found, labels):
            break
        labels = found
    return relabelled(labels)


def relabelled(labels: Integers) -> Integers:
    """The same groups with labels 0, 1, ... without gaps."""
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel())
