"""From hypotheses to motions: ``cluster``, which obeys the strategy of the hypotheses."""

from __future__ import annotations

import numpy as np

from mssegment.errors import DataError, UsageError
from mssegment.records import OUTLIER, ClusterResult, Floats, Hypotheses, Integers
from mssegment.registry import SELECTIONS
from mssegment.segmentation.mode_based import segment_by_modes
from mssegment.segmentation.options import SegmentOptions, check_options
from mssegment.segmentation.selection import Selection

__all__ = ["SELECTIONS", "SegmentOptions", "check_options", "cluster"]

STANDARD = SegmentOptions()


def cluster(
    points: Floats,
    hypotheses: Hypotheses,
    *,
    status: Integers | None = None,
    options: SegmentOptions = STANDARD,
    rng: np.random.Generator,
) -> ClusterResult:
    """Segment tracks by hypotheses, with the strategy that these were drawn for.

    Parameters
    ----------
    points
        Tracks [P, F, 2], pixels, NaN where a point is not visible.
    hypotheses
        Sets of points on manifolds, as ``sampling.strategy.draw`` makes them.
    status
        [P], 0 for tracks to label, else the label that a track keeps (background).
    options
        The settings; see :class:`SegmentOptions`.
    rng
        Source of random numbers.

    Raises
    ------
    DataError
        Where the hypotheses do not fit the tracks.
    UsageError, ConfigurationError
        For an option that is unknown, or that the strategy does not use.
    """
    if options.selection not in SELECTIONS:
        known = " or ".join(SELECTIONS)
        raise UsageError(f"segment.selection: {options.selection!r} is unknown; choose {known}")
    if not hypotheses.sets:
        raise DataError("there are no hypotheses to cluster: run hypothesize")
    check_options(options, hypotheses.strategy)
    status = np.full(len(points), OUTLIER) if status is None else status
    if hypotheses.strategy == "consensus":
        from mssegment.segmentation.consensus import segment_by_consensus

        return segment_by_consensus(points, hypotheses, status=status, options=options, rng=rng)
    select: Selection = SELECTIONS[options.selection]
    if hypotheses.strategy == "mixture":
        from mssegment.segmentation.mixture import mixture as select
    return segment_by_modes(
        points, hypotheses.sets, select=select, status=status, options=options, rng=rng
    )
