"""Tracks that were rejected before grouping, but move as one of the groups does.

Whether a track moves with others is first tested among its neighbours. Where it has few, or noise
larger than theirs, it is rejected although the geometry of its whole object predicts it. Epipolar
geometry alone predicts many tracks by chance: a track that is not smooth must fit the flat of the
group as well, over all frames, and better than its surrogates do (``walk_test.fit_by_chance``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import OUTLIER, Floats, Integers
from mssegment.segmentation.consensus.epipolar_evidence import EpipolarEvidence
from mssegment.segmentation.consensus.walk_test import USUAL, fit_by_chance

MIN_PAIRS = 2
"""Fewest frame pairs that a track must be seen in: one residual may be small by chance."""


def readmitted(
    points: Floats,
    labels: Integers,
    rejected: Integers,
    pairs: Sequence[tuple[int, int]],
    rng: np.random.Generator,
) -> Integers:
    """Labels of the tracks ``rejected``: that of a group whose geometry predicts them, or 0.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int
        Labels 1, 2, ... of the groups.
    rejected : ndarray of int
        Tracks without a label.
    pairs : sequence of (int, int)
        Pairs of frames for epipolar geometry.
    rng : numpy.random.Generator
        Draws the surrogates.

    Returns
    -------
    ndarray of int
        A label for each of ``rejected``.
    """
    groups = [np.flatnonzero(labels == label) for label in range(1, labels.max(initial=0) + 1)]
    if not groups or not len(rejected):
        return np.full(len(rejected), OUTLIER, dtype=np.int64)
    evidence = EpipolarEvidence(points, pairs)
    evidence.measure_noise(groups)
    visible = evidence.pairs_seen
    per_pair = np.stack([evidence.code_lengths(group) for group in groups])
    per_pair = per_pair / np.maximum(visible, 1)
    limits = np.array(
        [np.quantile(own[group], USUAL) for own, group in zip(per_pair, groups, strict=True)]
    )
    excess = per_pair[:, rejected] - limits[:, None]
    fits = (excess.min(axis=0) <= 0) & (visible[rejected] >= MIN_PAIRS)
    found = np.where(fits, excess.argmin(axis=0) + 1, OUTLIER)
    for label, group in enumerate(groups, start=1):
        own = found == label
        if own.any():
            found[own & fit_by_chance(points[group], points[rejected], rng)] = OUTLIER
    return found
