"""Matches at the border of two motions that follow neither, but something between both.

A window about a corner on the border of an object sees the object and what is behind it, and a
matcher finds a displacement between the two. There are many such corners where textures are
smooth, and a wide motion of their own may describe them more shortly than as outliers. Here they
have a code of their own: a *blend* lies on the segment between the places to which both motions
send it, anywhere with the same probability, up to noise across the segment. A motion whose tracks
cost no more as blends of others is none.
"""

from __future__ import annotations

import math
from itertools import combinations

import numpy as np
import numpy.typing as npt

from mssegment.neighbours import nearest
from mssegment.records import OUTLIER, Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates
from mssegment.segmentation.mdl.continuity import mapped_points
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.granularity import maps_the_plane
from mssegment.segmentation.mdl.labelling import LABEL_NEIGHBOURS, STORED_FACTOR
from mssegment.segmentation.mdl.likelihood import DEGREES_OF_FREEDOM, MEDIANS_OF_COORDINATE
from mssegment.segmentation.selection import SelectionProblem
from mssegment.special import distinct, median


def without_blends(
    problem: SelectionProblem, labels: Integers, current: Candidates, description: Description
) -> Integers:
    """The labels [P], where the tracks of motions that are blends of others are outliers.

    Only of two pictures, of models that map points, and where the number of motions is not given.

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
    """
    options = problem.options
    if problem.points.shape[1] != 2 or options.motions is not None or options.min_motions:
        return labels
    if not all(maps_the_plane(family.observed_set.model) for family in description.families):
        return labels
    labels = labels.copy()
    while True:
        used = [int(label) for label in distinct(labels[labels > 0])]
        saved = {k: _saved_as_blends(problem, labels, current, description, k) for k in used}
        best = max(saved, key=lambda k: saved[k], default=0)
        if not best or saved[best] <= 0:
            return labels
        labels[labels == best] = OUTLIER


def _saved_as_blends(
    problem: SelectionProblem,
    labels: Integers,
    current: Candidates,
    description: Description,
    label: int,
) -> float:
    """Nats that the tracks of a motion save as blends of others, over what the motion saves."""
    own = labels == label
    rest = np.where(own, OUTLIER, labels)
    as_blends = _gains(problem, rest, current, description, np.flatnonzero(own))
    saved = float(np.maximum(current.gains[label - 1][own], 0.0).sum())
    parameters = description.parameter_cost(current, labels)
    parameters -= description.parameter_cost(current, rest)
    scale = 0.5 * math.log(max(int(own.sum()), 1))  # known to so many nats
    return float(np.maximum(as_blends, 0.0).sum()) - scale - (saved - parameters)


def _gains(
    problem: SelectionProblem,
    labels: Integers,
    current: Candidates,
    description: Description,
    tracks: Integers,
) -> Floats:
    """Nats that ``tracks`` [n] save as blends of two of the motions of ``labels`` [P], [n].

    Of the pairs of motions about a track, that whose segment is nearest. Before a static camera,
    the background is one of the motions, and everywhere.
    """
    start, end = problem.points[tracks, 0], problem.points[tracks, 1]
    used = [int(k) for k in distinct(labels[labels > 0])]
    places = [mapped_points(problem, current, k - 1, start) for k in used]
    about = list(_about(problem, labels, tracks, used))
    if problem.static_camera:
        places.append(start)
        about.append(np.ones(len(tracks), dtype=bool))
    across = np.full(len(tracks), np.inf)
    length = np.ones(len(tracks))
    for a, b in combinations(range(len(places)), 2):
        distance, extent = _from_segment(end, places[a], places[b])
        nearer = about[a] & about[b] & (distance < across)
        across[nearer], length[nearer] = distance[nearer], extent[nearer]
    blends = np.isfinite(across)
    if not blends.any():
        return np.zeros(len(tracks))
    noise = problem.noise if np.isfinite(problem.noise) else 0.0
    scale = max(noise, median(across[blends]) / MEDIANS_OF_COORDINATE[0], np.finfo(np.float64).tiny)
    nu = DEGREES_OF_FREEDOM
    normalizer = math.lgamma(nu / 2) - math.lgamma((nu + 1) / 2) + 0.5 * math.log(nu * math.pi)
    cost = (nu + 1) / 2 * np.log1p((across[blends] / scale) ** 2 / nu)
    cost += np.log(scale) + normalizer + np.log(np.maximum(length[blends], scale))
    gains = np.zeros(len(tracks))
    gains[blends] = description.families[0].noise.outlier_cost - cost
    return gains


def _about(
    problem: SelectionProblem, labels: Integers, tracks: Integers, used: list[int]
) -> npt.NDArray[np.bool_]:
    """Which of the motions ``used`` are among the nearest labelled neighbours of ``tracks``."""
    labelled = np.flatnonzero(labels > 0)
    if not len(labelled):
        return np.zeros((0, len(tracks)), dtype=bool)
    positions = problem.points[:, 0]
    count = min(STORED_FACTOR * LABEL_NEIGHBOURS, len(labelled))
    near = labels[labelled][nearest(positions[labelled], positions[tracks], count)[1]]
    return np.asarray((near[None] == np.array(used)[:, None, None]).any(axis=2))


def _from_segment(points: Floats, first: Floats, last: Floats) -> tuple[Floats, Floats]:
    """Distances [n] of points [n, 2] from the segments between two others, and their lengths."""
    along = last - first
    squared = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)
    share = np.clip(((points - first) * along).sum(axis=1) / squared, 0.0, 1.0)
    gap = points - first - share[:, None] * along
    return np.linalg.norm(gap, axis=1), np.sqrt(squared)
