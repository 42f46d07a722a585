"""The second test for outliers: complete tracks against the affine flat of their group."""

from __future__ import annotations

import numpy as np

from mssegment.geometry.flats import extent, leave_one_out_residuals
from mssegment.models import Flags
from mssegment.records import Floats, Integers

SECOND_OF_EXTENT, RESIDUALS_OF_MEDIAN, SECOND_OF_MEDIAN = 0.1, 6.0, 4.0
"""Second test: (misfit over extent) x (residual over the motion's median residual) above the
first, the residual above so many medians, and the misfit above so many median misfits."""


def second_test(points: Floats, misfit: Floats, labels: Integers, sparing: float) -> Flags:
    """Which of the tracks [P, F, 2] belong nowhere although they have a label (1, 2, ...).

    Only complete tracks are judged: the distance from the affine 3-flat (rank 4) that is fitted
    robustly to the other tracks of the group, against the group's median. ``sparing`` is what
    ``limit_factor`` gives.
    """
    outside = np.zeros(len(points), dtype=bool)
    complete = np.isfinite(points).all(axis=(1, 2))
    usual = float(np.median(misfit[labels > 0])) if (labels > 0).any() else 0.0
    for label in range(1, labels.max(initial=0) + 1):
        members = np.flatnonzero((labels == label) & complete)
        if len(members) < 6:
            continue
        vectors = points[members].reshape(len(members), -1)
        residual = leave_one_out_residuals(vectors)
        relative = residual / max(float(np.median(residual)), 1e-12)
        product = misfit[members] / extent(points) * relative
        outside[members] = (
            (product > sparing * SECOND_OF_EXTENT)
            & (relative > RESIDUALS_OF_MEDIAN)
            & (misfit[members] > SECOND_OF_MEDIAN * usual)
        )
    return outside
