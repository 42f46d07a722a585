"""Motions that are one rigid body: which they are, and which tracks belong to the body.

Under a moving camera, the static scene is the largest of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import OUTLIER, Floats, Integers
from mssegment.sampling.neighbourhoods import neighbour_space
from mssegment.segmentation.mdl.candidates import Candidates
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.labelling import Neighbourhood, neighbour_labels
from mssegment.segmentation.rigid_join import (
    MIN_MATCHES,
    body_gains,
    rigid_bodies,
)
from mssegment.segmentation.selection import Body, SelectionProblem
from mssegment.special import distinct

LABEL_ROUNDS = 3
"""Rounds of labels and epipolar geometries of the bodies; later ones change few labels."""


def may_join(problem: SelectionProblem) -> bool:
    """Whether several motions may be one rigid body.

    Before a static camera, nothing else is static; motions that all leave parallax free are rigid
    bodies already.
    """
    return (
        problem.options.granularity == "object"
        and not problem.static_camera
        and problem.points.shape[1] == 2
        and not all(each.model.leaves_parallax_free for each in problem.observed_sets)
    )


def joined(
    problem: SelectionProblem, labels: Integers, current: Candidates, description: Description
) -> tuple[Integers, tuple[Body, ...]]:
    """Join motions that are one rigid body, and label the tracks anew where there are such.

    A given number of motions is kept.

    Parameters
    ----------
    problem : SelectionProblem
        The tracks.
    labels : ndarray [P] of int
        Labels of the motions, 0 for outliers.
    current : Candidates
        The motions 1, 2, ...
    description : Description
        The description of the tracks.

    Returns
    -------
    labels : ndarray [P] of int
        The motion of each track, one of those of its body.
    bodies : tuple of Body
        All motions that have tracks, by their labels less one.
    """
    used = [int(label) - 1 for label in distinct(labels[labels > 0])]
    single = tuple(Body((k,)) for k in used)
    options = problem.options
    if options.motions is not None or len(used) < 2 or not may_join(problem):
        return labels, single
    members = [np.asarray(labels == k + 1) for k in used]
    found = rigid_bodies(problem.points, members, problem.noise)
    if len(found) < options.min_motions:
        return labels, single
    bodies = tuple(Body(tuple(used[m] for m in body.members), body.evidence) for body in found)
    if len(bodies) == len(used):
        return labels, bodies
    return _relabelled(problem, labels, current, bodies, description), bodies


def with_numbers(bodies: Sequence[Body], labels: Integers) -> tuple[Body, ...]:
    """The bodies with the indices of their motions among those that have ``labels`` [P]."""
    used = [int(label) - 1 for label in distinct(labels[labels > 0])]
    numbers = {motion: index for index, motion in enumerate(used)}
    kept = [(tuple(numbers[m] for m in b.members if m in numbers), b.evidence) for b in bodies]
    return tuple(Body(members, evidence) for members, evidence in kept if members)


def _relabelled(
    problem: SelectionProblem,
    labels: Integers,
    current: Candidates,
    bodies: Sequence[Body],
    description: Description,
) -> Integers:
    """The labels when bodies of several motions are described by epipolar geometry and depth.

    A track that comes to a body gets the motion of it that it fits best. Tracks that neither were
    in a body of several motions nor come to one keep their labels, and no body ends.
    """
    outlier_cost = description.families[0].noise.outlier_cost
    neighbourhood = Neighbourhood(neighbour_space(problem.points))
    body_of = np.zeros(len(current) + 1, dtype=np.int64)
    for number, body in enumerate(bodies, start=1):
        body_of[np.array(body.members) + 1] = number
    of_several = np.array([False, *(len(body.members) > 1 for body in bodies)])
    found = body_of[labels]
    for _ in range(LABEL_ROUNDS):
        rows = [
            body_gains(problem.points, np.asarray(found == number), problem.noise, outlier_cost)
            if len(body.members) > 1
            else current.gains[body.members[0]]
            for number, body in enumerate(bodies, start=1)
        ]
        gains = np.stack(rows)
        # a share of no outliers at all would keep it so
        start = np.where(of_several[found] & (gains.max(axis=0) < 0), OUTLIER, found)
        updated = neighbour_labels(gains, neighbourhood, start)
        updated = np.where(of_several[found] | of_several[updated], updated, found)
        sizes = np.bincount(updated, minlength=len(bodies) + 1)[1:]
        if np.array_equal(found, updated) or sizes.min() < MIN_MATCHES:
            break
        found = updated
    return _motion_of(found, labels, body_of, current.residuals)


def _motion_of(found: Integers, labels: Integers, body_of: Integers, residuals: Floats) -> Integers:
    """The motion of each track, as a label, given its body: as before, or the nearest one."""
    belongs = body_of[1:, None] == found
    nearest = np.where(belongs, residuals, np.inf).argmin(axis=0) + 1
    return np.where(body_of[labels] == found, labels, np.where(found > 0, nearest, 0))
