"""From hypotheses to motions: ``cluster`` follows the strategy of the hypotheses."""

from __future__ import annotations

import numpy as np

from mssegment.errors import DataError, UsageError
from mssegment.models import Flags
from mssegment.records import OUTLIER, ClusterResult, Floats, Hypotheses, Integers
from mssegment.registry import SELECTIONS
from mssegment.segmentation.in_pixels import with_pixels
from mssegment.segmentation.mode_based import segment_by_modes
from mssegment.segmentation.options import SegmentOptions, check_options
from mssegment.segmentation.selection import Selection

__all__ = ["SELECTIONS", "SegmentOptions", "check_options", "cluster"]

DEFAULTS = SegmentOptions()


def cluster(
    points: Floats,
    hypotheses: Hypotheses,
    *,
    status: Integers | None = None,
    options: SegmentOptions = DEFAULTS,
    rng: np.random.Generator,
    with_modes: bool = True,
    moved_before: Flags | None = None,
) -> ClusterResult:
    """Segment tracks by hypotheses, with the strategy that these were drawn for.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    hypotheses : Hypotheses
        Sets of points on manifolds, as ``sampling.strategy.draw`` returns them.
    status : ndarray [P] of int, optional
        ``OUTLIER`` (0) for tracks to label, otherwise the label that a track keeps, for instance
        ``BACKGROUND``. By default all tracks are labelled.
    options : SegmentOptions
        The settings.
    rng : numpy.random.Generator
        Source of random numbers.
    with_modes : bool
        Whether consensus looks for the mode of each motion, on which its labels do not depend.
    moved_before : ndarray [P] of bool, optional
        Tracks that moved with a motion in the frames before, where this is a window of a sequence:
        consensus does not test whether a motion that goes on is one.

    Returns
    -------
    ClusterResult

    Raises
    ------
    DataError
        If the hypotheses do not fit the tracks.
    UsageError, ConfigurationError
        If an option is unknown, or not used by the strategy.

    Examples
    --------
    Two groups of matches, translated by (60, 10) and by (-40, 30) pixels, with noise:

    >>> import numpy as np
    >>> from mssegment.records import Hypotheses
    >>> from mssegment.sampling.elemental_subsets import hypothesize
    >>> rng = np.random.default_rng(0)
    >>> first = rng.uniform(0, 100, (80, 2)) + np.repeat([[0.0], [200.0]], 40, axis=0)
    >>> second = first + np.repeat([[60.0, 10.0], [-40.0, 30.0]], 40, axis=0)
    >>> points = np.stack([first, second], axis=1) + rng.normal(0, 0.3, (80, 2, 2))
    >>> sets = hypothesize(points, rng=rng)
    >>> found = cluster(points, Hypotheses("modes", tuple(sets)), rng=rng)
    >>> len(found.motions), len(set(found.labels[:40])), len(set(found.labels[40:]))
    (2, 1, 1)
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

        found = segment_by_consensus(
            points,
            hypotheses,
            status=status,
            options=options,
            rng=rng,
            with_modes=with_modes,
            moved_before=moved_before,
        )
        return with_pixels(found, hypotheses.sets, points)
    select: Selection = SELECTIONS[options.selection]
    if hypotheses.strategy == "mixture":
        from mssegment.segmentation.mixture import mixture as select
    found = segment_by_modes(
        points, hypotheses.sets, select=select, status=status, options=options, rng=rng
    )
    return with_pixels(found, hypotheses.sets, points)
