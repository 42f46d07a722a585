"""Joint refinement: alternate between labels and motions, for several sets of motions at a time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates, Family, concatenate
from mssegment.segmentation.mdl.description import Description

JOINT_FIT_ROUNDS = 4
"""Rounds of labelling and refitting."""


def refine(description: Description, sets: Sequence[Candidates]) -> list[Candidates]:
    """Refit the motions of each set to the tracks that they win from each other.

    All motions of all sets are fitted in one batch; a set has converged when its labels no longer
    change. A motion with an invalid fit is not changed.
    """
    refined = list(sets)
    labels: dict[int, Integers] = {}
    active = [index for index, motions in enumerate(refined) if len(motions)]
    for _ in range(JOINT_FIT_ROUNDS):
        before, labels = labels, {i: description.labels(refined[i]) for i in active}
        active = [i for i in active if i not in before or not np.array_equal(labels[i], before[i])]
        if not active:
            break
        inliers = [labels[i] == np.arange(1, len(refined[i]) + 1)[:, None] for i in active]
        fitted = refit_once(
            description.families,
            concatenate([refined[i] for i in active]),
            np.concatenate(inliers).astype(np.float64),
        )
        ends = np.cumsum([0, *(len(refined[i]) for i in active)])
        for i, (first, last) in zip(active, pairwise(ends), strict=True):
            refined[i] = fitted.take(np.arange(first, last))
    return refined


def refit_once(families: Sequence[Family], current: Candidates, inliers: Floats) -> Candidates:
    """The motions fitted once to their ``inliers`` [K, P] (0 or 1), in the same order."""
    points = list(current.points)
    scales, residuals = current.scales.copy(), current.residuals.copy()
    gains = current.gains.copy()
    lengths, shapes = current.lengths.copy(), current.shapes.copy()
    for family in families:
        enough = inliers.sum(axis=1) > family.observed_set.model.subset_size
        rows = np.flatnonzero(enough & (current.set_indices == family.index))
        if not len(rows):
            continue
        weights = inliers[rows] * family.noise.weights(residuals[rows], scales[rows])
        fitted, valid = family.observed_set.fit(weights)
        fitted, rows = fitted[valid], rows[valid]
        new = family.measured(fitted, inliers[rows], scales[rows])
        residuals[rows], scales[rows] = new.residuals, new.scales
        lengths[rows], shapes[rows] = new.lengths, new.shapes
        gains[rows] = family.gains(fitted, new.residuals, new.scales, inliers[rows])
        for row, point in zip(rows, fitted, strict=True):
            points[row] = point
    return Candidates(
        current.set_indices, current.modes, tuple(points), scales, residuals, gains, lengths, shapes
    )
