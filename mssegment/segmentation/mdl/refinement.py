"""Joint refitting: labels and motions by turns, for several sets of motions at a time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates, Family, join
from mssegment.segmentation.mdl.description import Description

TURNS = 4
"""Turns of relabelling and refitting."""


def refine(description: Description, sets: Sequence[Candidates]) -> list[Candidates]:
    """Each set of motions, every motion refitted to the tracks it wins against the others.

    All motions of all sets are fitted in one batch; a set rests when its labels stay. A motion
    whose refit is unsound stays as it is.
    """
    refined = list(sets)
    labels: dict[int, Integers] = {}
    moving = [index for index, one in enumerate(refined) if len(one)]
    for _ in range(TURNS):
        before, labels = labels, {i: description.labels(refined[i]) for i in moving}
        moving = [i for i in moving if i not in before or not np.array_equal(labels[i], before[i])]
        if not moving:
            break
        inliers = [labels[i] == np.arange(1, len(refined[i]) + 1)[:, None] for i in moving]
        fitted = refit_once(
            description.families,
            join([refined[i] for i in moving]),
            np.concatenate(inliers).astype(np.float64),
        )
        ends = np.cumsum([0, *(len(refined[i]) for i in moving)])
        for i, (a, b) in zip(moving, pairwise(ends), strict=True):
            refined[i] = fitted.take(np.arange(a, b))
    return refined


def refit_once(families: Sequence[Family], current: Candidates, inliers: Floats) -> Candidates:
    """The motions fitted once to their ``inliers`` [K, P] (0 or 1), in their order."""
    points = list(current.points)
    scales, residuals = current.scales.copy(), current.residuals.copy()
    gains = current.gains.copy()
    for family in families:
        enough = inliers.sum(axis=1) > family.observed_set.model.subset_size
        own = np.flatnonzero(enough & (current.set_indices == family.index))
        if not len(own):
            continue
        weights = inliers[own] * family.noise.weights(residuals[own], scales[own])
        fitted, valid = family.observed_set.fit(weights)
        good = np.flatnonzero(valid)
        new = family.residuals(fitted[good])
        k = own[good]
        scale = family.noise.scales(new, inliers[k], scales[k])
        residuals[k], scales[k] = new, scale
        gains[k] = family.gains(fitted[good], new, scale, inliers[k])
        for place, index in zip(good, k, strict=True):
            points[index] = fitted[place]
    return Candidates(current.set_indices, current.modes, tuple(points), scales, residuals, gains)
