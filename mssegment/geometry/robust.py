"""Robust weights, and the Student t distribution of groups of vectors with its EM.

References
----------
Geman and McClure, Statistical methods for tomographic image reconstruction, 1987.
Lange, Little and Taylor, Robust statistical modeling using the t distribution, 1989.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.records import Floats, Integers, Record

REWEIGHTINGS = 3
"""Rounds of iteratively reweighted moments in ``fit_student_t``."""


def geman_mcclure_weights(squared: Floats, squared_scale: Floats | float) -> Floats:
    """Weights 1 / (1 + r^2 / s^2)^2 from squared residuals r^2 and the squared scale s^2."""
    return np.asarray((1 + squared / squared_scale) ** -2.0)


def student_t_weights(squared: Floats, freedom: float, dimension: int) -> Floats:
    """Weights (nu + d) / (nu + q) from squared Mahalanobis distances q of d-vectors.

    ``freedom`` is nu, the degrees of freedom; these weights maximize the likelihood of a
    multivariate Student t distribution.
    """
    return np.asarray((freedom + dimension) / (freedom + squared))


class StudentT(Record, frozen=True):
    """Student t distributions of G groups, evaluated at all P vectors.

    ``squared`` [G, P] are squared Mahalanobis distances, ``log_det`` [G] the logarithm of the
    determinant of each scatter matrix, ``weights`` [G, P] those of the last reweighting (0 for
    vectors of other groups).
    """

    squared: Floats
    log_det: Floats
    weights: Floats


class StudentTFit:
    """Fits Student t distributions to groups of the same vectors, many groups at a time."""

    def __init__(self, vectors: Floats, freedom: float, least_spread: float) -> None:
        """For vectors [P, D]; ``least_spread`` is the standard deviation added to each axis."""
        self._vectors, self._freedom, self._least_spread = vectors, freedom, least_spread
        self._upper = np.triu_indices(vectors.shape[1])
        self._products = vectors[:, self._upper[0]] * vectors[:, self._upper[1]]

    def __call__(self, members: Floats) -> StudentT:
        """Fit one distribution to each group; ``members`` [G, P] are 0 or 1."""
        dimensions = self._vectors.shape[1]
        sizes = members.sum(axis=1)[:, None, None]
        weights = members
        for _ in range(REWEIGHTINGS):
            used = weights
            total = used.sum(axis=1)
            middle = used @ self._vectors / total[:, None]
            scatter = np.empty((len(members), dimensions, dimensions))
            moments = used @ self._products
            scatter[:, self._upper[0], self._upper[1]] = moments
            scatter[:, self._upper[1], self._upper[0]] = moments
            scatter -= total[:, None, None] * middle[:, :, None] * middle[:, None, :]
            lower = np.linalg.cholesky(scatter / sizes + self._least_spread**2 * np.eye(dimensions))
            away = np.linalg.inv(lower) @ (self._vectors.T - middle[:, :, None])
            squared = (away**2).sum(axis=1)
            weights = members * student_t_weights(squared, self._freedom, dimensions)
        log_det = 2 * np.log(np.diagonal(lower, axis1=1, axis2=2)).sum(axis=1)
        return StudentT(squared, log_det, used)


def hard_em(
    labels: Integers, costs: Callable[[Floats], Floats], rounds: int, fewest: int
) -> Integers:
    """Hard expectation maximization: each vector joins the group in which it costs least.

    Parameters
    ----------
    labels
        Start, [P].
    costs
        Costs [G, P] of all vectors in the groups given by ``members`` [G, P] (0 or 1).
    rounds
        Bound on the number of rounds.
    fewest
        Groups of fewer vectors dissolve.

    Returns
    -------
    labels
        0, 1, ... without gaps, [P]; all zero where every group dissolved.
    """
    for _ in range(rounds):
        names, sizes = np.unique(labels, return_counts=True)
        names = names[sizes >= fewest]
        if not len(names):
            return np.zeros(len(labels), dtype=np.int64)
        found = names[costs((labels == names[:, None]).astype(np.float64)).argmin(axis=0)]
        if np.array_equal(found, labels):
            break
        labels = found
    return relabelled(labels)


def relabelled(labels: Integers) -> Integers:
    """The same groups, numbered 0, 1, ... without gaps."""
    return np.asarray(np.unique(labels, return_inverse=True)[1].ravel())
