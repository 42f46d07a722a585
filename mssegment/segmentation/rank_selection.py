"""The rank of the subspace of a motion: 3 if it is planar, 4 in general."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

PLANAR_RESIDUAL_RATIO = 1.25
"""A motion is planar if its residual of rank 3 is at most this times that of rank 4."""


def lowest_adequate_rank(residuals: Sequence[float], ranks: Sequence[int]) -> int:
    """Index of the fit of lowest rank whose residual is nearly the smallest.

    Parameters
    ----------
    residuals : sequence of float
        Root mean square residual of each fit.
    ranks : sequence of int
        Rank of each fit.

    Examples
    --------
    >>> lowest_adequate_rank([0.3, 0.28], [3, 4]), lowest_adequate_rank([0.9, 0.28], [3, 4])
    (0, 1)
    """
    limit = PLANAR_RESIDUAL_RATIO * min(residuals)
    adequate = np.flatnonzero(np.asarray(residuals) <= limit).tolist()
    return int(min(adequate, key=lambda i: ranks[i]))
