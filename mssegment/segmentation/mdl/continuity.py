"""Faces of one object: motions that agree where their tracks meet.

Two faces of a box are two planes, each with its own homography, but along their common edge both
map points alike. Two objects that meet in the image move apart there. If a motion is that of an
object, motions with neighbouring tracks are merged if, on the line from a track of one to a track
of the other, there is a point that both map to the same position, up to noise and the parallax that
an object may have.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from mssegment.geometry.projective import homogeneous_rows, transfer
from mssegment.models import Flags
from mssegment.neighbours import nearest_others
from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates, concatenate
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.granularity import maps_the_plane
from mssegment.segmentation.rigid_join import MIN_MATCHES, pair_evidence
from mssegment.segmentation.selection import SelectionProblem
from mssegment.special import distinct, median

FACE_NEIGHBOURS = 6
"""Nearest labelled neighbours of a track; those of another motion are across a border."""
MIN_BORDER_TRACKS = 3
"""Smallest number of tracks on either side of a border."""
POINTS_BETWEEN = 5
"""Number of points compared between two tracks."""
CONTRARY_EVIDENCE = 40.0
"""Evidence, in nats, against one rigid body that outweighs agreement at the border. Of pairs of
frames of Hopkins155 and KT3DMoSeg, it is 63 and more against six of eight pairs of bodies, and at
most 28 against all but one pair of faces."""
NOISE_DEVIATIONS = 2.5
"""Largest difference, in standard deviations of the noise of both motions."""


def merge_faces(
    problem: SelectionProblem, labels: Integers, current: Candidates, description: Description
) -> tuple[Integers, Candidates]:
    """Merge motions that are faces of one object.

    The motion of the object is the one that saves most on its tracks, among those of its faces and
    those fitted to all of its tracks. Models that leave parallax free have no faces.

    Parameters
    ----------
    problem : SelectionProblem
        The tracks and the modes.
    labels : ndarray [P] of int
        Labels of the motions, 0 for outliers.
    current : Candidates
        The motions 1, 2, ...
    description : Description
        The description of the tracks.

    Returns
    -------
    labels : ndarray [P] of int
    current : Candidates
    """
    if len(current) < 2 or not all(
        maps_the_plane(family.observed_set.model) for family in description.families
    ):
        return labels, current
    object_of = group_motions(labels, continuous_pairs(problem, labels, current, description))
    count = int(object_of.max()) + 1
    if count == len(current) or count < problem.options.min_motions:
        return labels, current
    merged = np.where(labels > 0, object_of[labels - 1] + 1, 0)
    motions = []
    for k in range(count):
        faces = np.flatnonzero(object_of == k)
        inliers = (merged == k + 1).astype(np.float64)
        candidates = [current.take(faces)]
        if len(faces) > 1:
            for family in description.families:
                candidates += family.fitted(inliers[None], current.modes[faces[:1]])
        motions.append(_saving_most(concatenate(candidates), inliers))
    return merged, concatenate(motions)


def continuous_pairs(
    problem: SelectionProblem, labels: Integers, current: Candidates, description: Description
) -> list[tuple[int, int]]:
    """The pairs of motions, as indices into ``current``, that agree at their border."""
    tracks = np.flatnonzero(labels > 0)
    positions = problem.points[tracks, 0]
    near = nearest_others(positions, FACE_NEIGHBOURS)
    parallax = description.families[0].noise.parallax[tracks]
    found = []
    for a, b in combinations(range(len(current)), 2):
        one, other = _border(labels[tracks], near, a + 1, b + 1)
        if min(len(distinct(one)), len(distinct(other))) < MIN_BORDER_TRACKS:
            continue
        between = np.linspace(positions[one], positions[other], POINTS_BETWEEN)
        images = [mapped_points(problem, current, k, between) for k in (a, b)]
        least = np.linalg.norm(images[0] - images[1], axis=-1).min(axis=0)
        noise = NOISE_DEVIATIONS * np.hypot(current.scales[a], current.scales[b])
        if median(least / np.hypot(noise, parallax[one])) < 1 and not _not_rigid(
            problem, labels == a + 1, labels == b + 1
        ):
            found.append((a, b))
    return found


def _not_rigid(problem: SelectionProblem, one: Flags, other: Flags) -> bool:
    """Whether no epipolar geometry holds two faces together.

    Two motions that differ agree along some line; it may pass between two bodies by chance.
    """
    if problem.points.shape[1] != 2 or min(one.sum(), other.sum()) < MIN_MATCHES:
        return False
    return pair_evidence(problem.points, one, other, problem.noise) < -CONTRARY_EVIDENCE


def group_motions(labels: Integers, pairs: list[tuple[int, int]]) -> Integers:
    """Index of the object of each motion if the motions of each pair belong to one object.

    Examples
    --------
    Motions 1 and 3 of four are faces of one object:

    >>> import numpy as np
    >>> group_motions(np.array([1, 2, 3, 4]), [(0, 2)]).tolist()
    [0, 1, 0, 2]
    """
    object_of = np.arange(labels.max(initial=0))
    for a, b in pairs:
        object_of[object_of == object_of[b]] = object_of[a]
    return np.asarray(np.unique(object_of, return_inverse=True)[1], dtype=np.int64)


def _border(labels: Integers, near: Integers, a: int, b: int) -> tuple[Integers, Integers]:
    """Pairs of neighbours across the border: tracks of motion ``a``, and those of ``b``."""
    neighbour_labels = labels[near]
    a_track, b_index = np.nonzero((labels[:, None] == a) & (neighbour_labels == b))
    b_track, a_index = np.nonzero((labels[:, None] == b) & (neighbour_labels == a))
    return (
        np.concatenate([a_track, near[b_track, a_index]]),
        np.concatenate([near[a_track, b_index], b_track]),
    )


def mapped_points(problem: SelectionProblem, current: Candidates, k: int, points: Floats) -> Floats:
    """Map ``points`` [..., 2] of the first frame, in pixels, by motion ``k``, a 3 x 3 matrix."""
    normalization = problem.observed_sets[int(current.set_indices[k])].hypotheses.normalization
    scale, shape = normalization.scale, points.shape
    rows = homogeneous_rows(((points - normalization.centres[0]) / scale).reshape(-1, 2))
    x, y, _ = transfer(current.points[k][None], rows)
    image = scale * np.stack([x[0], y[0]], axis=1).reshape(shape)
    return np.asarray(image + normalization.centres[1])


def _saving_most(candidates: Candidates, tracks: Floats) -> Candidates:
    """The candidate that saves most on the ``tracks`` [P] (0 or 1)."""
    saved = np.maximum(candidates.gains, 0.0) @ tracks
    return candidates.take([int(saved.argmax())])
