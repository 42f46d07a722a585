"""Faces of one body: motions that go over into each other where their tracks meet.

Two faces of a box are two planes, and each moves by its own homography; but along their edge both
say the same. Two bodies that meet in the picture move apart there. So where the user means objects,
motions whose tracks are neighbours are joined when, on the way from a track of one to a track of
the other, there is a place that both send to the same point, to within the noise and the parallax
that an object may have.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from mssegment.geometry.projective import homogeneous_rows, transfer
from mssegment.neighbours import nearest_others
from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates, join
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.selection import SelectionProblem
from mssegment.special import distinct, median

NEIGHBOURS = 6
"""Nearest labelled tracks of a track; those of another motion lie across a border."""
BORDER = 3
"""Tracks on either side that make a border: fewer may be strays."""
STEPS = 5
"""Places looked at on the way between two tracks."""
TOLERANCE = 2.5
"""Standard deviations of the noise of both motions together."""


def join_faces(
    problem: SelectionProblem, labels: Integers, chosen: Candidates, description: Description
) -> tuple[Integers, Candidates]:
    """The labels [P] and motions when the motions that are faces of one body are one.

    The body's motion is the one that saves most on its tracks, of its faces' and of those fitted to
    all of it. Models that leave parallax free have no faces.
    """
    if len(chosen) < 2 or any(
        family.observed_set.model.leaves_parallax_free for family in description.families
    ):
        return labels, chosen
    body = bodies(labels, continuous(problem, labels, chosen, description))
    count = int(body.max()) + 1
    if count == len(chosen) or count < problem.options.min_motions:
        return labels, chosen
    joined = np.where(labels > 0, body[labels - 1] + 1, 0)
    motions = []
    for k in range(count):
        faces = np.flatnonzero(body == k)
        own = (joined == k + 1).astype(np.float64)
        tried = [chosen.take(faces)]
        if len(faces) > 1:
            for family in description.families:
                tried += family.fitted(own[None], chosen.modes[faces[:1]])
        motions.append(_saving_most(join(tried), own))
    return joined, join(motions)


def continuous(
    problem: SelectionProblem, labels: Integers, chosen: Candidates, description: Description
) -> list[tuple[int, int]]:
    """The pairs of motions, indices into ``chosen``, that go over into each other."""
    kept = np.flatnonzero(labels > 0)
    places = problem.points[kept, 0]
    near = nearest_others(places, NEIGHBOURS)
    parallax = description.families[0].noise.parallax[kept]
    found = []
    for a, b in combinations(range(len(chosen)), 2):
        one, other = _across(labels[kept], near, a + 1, b + 1)
        if min(len(distinct(one)), len(distinct(other))) < BORDER:
            continue
        way = np.linspace(places[one], places[other], STEPS)
        gap = _transferred(problem, chosen, a, way) - _transferred(problem, chosen, b, way)
        least = np.sqrt((gap**2).sum(axis=-1)).min(axis=0)
        noise = TOLERANCE * np.hypot(chosen.scales[a], chosen.scales[b])
        if median(least / np.hypot(noise, parallax[one])) < 1:
            found.append((a, b))
    return found


def bodies(labels: Integers, pairs: list[tuple[int, int]]) -> Integers:
    """The body of each motion 1..m of ``labels`` when the ``pairs`` (from 0) share one, from 0."""
    body = np.arange(labels.max(initial=0))
    for a, b in pairs:
        body[body == body[b]] = body[a]
    return np.asarray(np.unique(body, return_inverse=True)[1], dtype=np.int64)


def _across(labels: Integers, near: Integers, a: int, b: int) -> tuple[Integers, Integers]:
    """Neighbours across the border of ``a`` and ``b``: a track of ``a`` each, and one of ``b``."""
    around = labels[near]
    row, place = np.nonzero((labels[:, None] == a) & (around == b))
    back, other = np.nonzero((labels[:, None] == b) & (around == a))
    return np.concatenate([row, near[back, other]]), np.concatenate([near[row, place], back])


def _transferred(problem: SelectionProblem, chosen: Candidates, k: int, places: Floats) -> Floats:
    """Where motion ``k``, a 3 x 3 matrix, sends ``places`` [..., 2] of the first frame, pixels."""
    normalization = problem.observed_sets[int(chosen.set_indices[k])].hypotheses.normalization
    scale, shape = normalization.scale, places.shape
    rows = homogeneous_rows(((places - normalization.centres[0]) / scale).reshape(-1, 2))
    x, y, _ = transfer(chosen.points[k][None], rows)
    image = scale * np.stack([x[0], y[0]], axis=1).reshape(shape)
    return np.asarray(image + normalization.centres[1])


def _saving_most(tried: Candidates, tracks: Floats) -> Candidates:
    saved = np.maximum(tried.gains, 0.0) @ tracks
    return tried.take([int(saved.argmax())])
