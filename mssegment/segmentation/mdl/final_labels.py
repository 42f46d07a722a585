"""The final labels, at the scale of the residuals of each motion instead of that of parallax."""

from __future__ import annotations

import numpy as np

from mssegment.records import OUTLIER, Integers
from mssegment.sampling.neighbourhoods import neighbour_space
from mssegment.segmentation.mdl.candidates import Candidates
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.labelling import Neighbourhood, neighbour_labels
from mssegment.segmentation.mdl.refinement import refit_once
from mssegment.segmentation.selection import SelectionProblem
from mssegment.special import median

EXCLUDED = 1e-3
"""Share of the true inliers that are too far away to be labelled."""
FINAL_ROUNDS = 5
"""Rounds of neighbour labels and refits at the end."""


def final_labels(
    problem: SelectionProblem,
    current: Candidates,
    description: Description,
    use_neighbours: bool,
) -> tuple[Integers, Candidates]:
    """The final labels [P], each coded given its neighbours, and the motions refitted to them.

    The scale up to which a misfit is noise, including parallax, determines what the motions are.
    Which tracks belong to them is decided at the scale of the residuals of each motion.
    """
    if not use_neighbours:
        return description.labels(current), current
    families = [family.without_parallax() for family in description.families]
    neighbourhood = Neighbourhood(neighbour_space(problem.points))
    labels = neighbour_labels(current.gains, neighbourhood, description.labels(current))
    for _ in range(FINAL_ROUNDS):
        inliers = labels == np.arange(1, len(current) + 1)[:, None]
        current = refit_once(families, current, inliers.astype(np.float64))
        before, labels = labels, neighbour_labels(current.gains, neighbourhood, labels)
        if np.array_equal(labels, before):
            break
    if problem.points.shape[1] == 2:
        labels = within_limits(labels, current, description, problem.noise)
    return labels, current


def within_limits(
    labels: Integers, current: Candidates, description: Description, noise: float
) -> Integers:
    """The labels, without tracks whose residual no noise explains.

    The limit is the residual that one track in ``1 / EXCLUDED`` exceeds, given the median of the
    residuals of its motion, or that of the ``noise`` if it is larger.
    """
    labels = labels.copy()
    for k in range(len(current)):
        own = labels == k + 1
        if own.any():
            model = description.families[int(current.set_indices[k])].noise
            middle = max(median(current.residuals[k][own]) / model.quantile(0.5), noise)
            limit = model.quantile(EXCLUDED) * middle
            labels[own & (current.residuals[k] > limit)] = OUTLIER
    return labels
