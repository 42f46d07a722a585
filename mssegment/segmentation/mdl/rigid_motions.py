"""Motions that are one rigid body: which they are, and which tracks belong to the body.

Under a moving camera, the static scene is the largest of them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import OUTLIER, Floats, Integers
from mssegment.sampling.neighbourhoods import neighbour_space
from mssegment.segmentation.mdl.candidates import MAX_RESIDUAL, Candidates
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.labelling import Neighbourhood, neighbour_labels
from mssegment.segmentation.rigid_join import (
    LEAST_GROUP,
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
    if options.motions is not None or not used or not may_join(problem):
        return labels, single
    members = [np.asarray(labels == k + 1) for k in used]
    found = rigid_bodies(problem.points, members, problem.noise)
    if len(found) < options.min_motions:
        return labels, single
    bodies = tuple(Body(tuple(used[m] for m in body.members), body.evidence) for body in found)
    deep = _deep(labels, current, bodies)
    if not any(deep):
        return labels, bodies
    return _relabelled(problem, labels, current, bodies, deep, description), bodies


def _deep(labels: Integers, current: Candidates, bodies: Sequence[Body]) -> list[bool]:
    """Which bodies are described by epipolar geometry: of several motions, or with relief."""
    return [
        len(body.members) > 1
        or bool(
            current.shapes[body.members[0], 1] > current.shapes[body.members[0], 0]
            and (labels == body.members[0] + 1).sum() >= LEAST_GROUP
        )
        for body in bodies
    ]


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
    deep: Sequence[bool],
    description: Description,
) -> Integers:
    """The labels when ``deep`` bodies are described by epipolar geometry and depth.

    A track that comes to a body gets the motion of it that it fits best. Tracks that neither were
    in a deep body nor come to one keep their labels, and no body ends.
    """
    outlier_cost = description.families[0].noise.outlier_cost
    neighbourhood = Neighbourhood(neighbour_space(problem.points))
    body_of = np.zeros(len(current) + 1, dtype=np.int64)
    for number, body in enumerate(bodies, start=1):
        body_of[np.array(body.members) + 1] = number
    is_deep = np.array([False, *deep])
    found = body_of[labels]
    near = [current.lengths[list(body.members)].min(axis=0) < MAX_RESIDUAL for body in bodies]
    for _ in range(LABEL_ROUNDS):
        rows = [
            body_gains(problem.points, np.asarray(found == number), problem.noise, outlier_cost)
            if is_deep[number]
            else current.gains[body.members[0]]
            for number, body in enumerate(bodies, start=1)
        ]
        gains = np.where(near, rows, -np.inf)
        # a share of no outliers at all would keep it so
        start = np.where(is_deep[found] & (gains.max(axis=0) < 0), OUTLIER, found)
        updated = neighbour_labels(gains, neighbourhood, start)
        updated = np.where(is_deep[found] | is_deep[updated], updated, found)
        sizes = np.bincount(updated, minlength=len(bodies) + 1)[1:]
        if np.array_equal(found, updated) or sizes.min() < MIN_MATCHES:
            break
        found = updated
    return _motion_of(found, labels, body_of, current.lengths)


def _motion_of(found: Integers, labels: Integers, body_of: Integers, lengths: Floats) -> Integers:
    """The motion of each track, as a label, given its body: as before, or the nearest one."""
    belongs = body_of[1:, None] == found
    nearest = np.where(belongs, lengths, np.inf).argmin(axis=0) + 1
    return np.where(body_of[labels] == found, labels, np.where(found > 0, nearest, 0))
