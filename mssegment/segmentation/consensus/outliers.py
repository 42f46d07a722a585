"""The second test for outliers: complete tracks against the affine flat of their group."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.flats import extent, leave_one_out_residuals
from mssegment.models import Flags
from mssegment.records import Floats, Integers

PRODUCT_LIMIT, RESIDUAL_OF_MEDIAN, SECOND_MISFIT_OF_MEDIAN = 0.1, 6.0, 4.0
"""Second test, all three: misfit over extent times residual over the median residual of the motion;
residual over the median residual of the motion; and misfit over the median misfit exceed these."""


def second_test(points: Floats, misfit: Floats, labels: Integers, factor: float) -> Flags:
    """Which tracks are outliers although they have a label.

    The test compares the distance of a track from the affine 3-flat (rank 4) that is fitted
    robustly to the other tracks of its group with the median of the group. Only complete tracks are
    tested.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels.
    misfit : ndarray [P]
        Their ``two_frame_misfit``.
    labels : ndarray [P] of int
        Their labels 1, 2, ...
    factor : float
        The ``limit_factor``.

    Returns
    -------
    ndarray [P] of bool
        True for outliers.
    """
    outliers = np.zeros(len(points), dtype=bool)
    complete = np.isfinite(points).all(axis=(1, 2))
    median_misfit = float(np.median(misfit[labels > 0])) if (labels > 0).any() else 0.0
    for label in range(1, labels.max(initial=0) + 1):
        members = np.flatnonzero((labels == label) & complete)
        if len(members) < 6:
            continue
        vectors = points[members].reshape(len(members), -1)
        residual = leave_one_out_residuals(vectors)
        relative = residual / max(float(np.median(residual)), 1e-12)
        product = misfit[members] / extent(points) * relative
        outliers[members] = (
            (product > factor * PRODUCT_LIMIT)
            & (relative > RESIDUAL_OF_MEDIAN)
            & (misfit[members] > SECOND_MISFIT_OF_MEDIAN * median_misfit)
        )
    return outliers
