"""Pieces of a motion that are bodies of their own.

What counts as parallax within an object also hides that two bodies move almost alike. Where the
misfit of both is noise, a cut between them is no cut through an object with parallax, and their
labels cost little: the search goes on with a description of that kind. But flat pieces of one
object fit their own planes as well, so that pieces that touch are one.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from mssegment.records import Floats, Integers, replace
from mssegment.sampling.neighbourhoods import nearest_neighbours
from mssegment.segmentation.mdl.candidates import Candidates, concatenate
from mssegment.segmentation.mdl.contact import contacts
from mssegment.segmentation.mdl.description import Description, least_tracks
from mssegment.segmentation.mdl.labelling import LABEL_NEIGHBOURS
from mssegment.segmentation.mdl.search import improve


def with_pieces(
    points: Floats, noise: float, found: Candidates, pool: Candidates, description: Description
) -> Candidates:
    """Divide motions of two views into pieces that are apart, and add what outliers hold.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.
    noise : float
        Their noise in pixels (``preprocessing.noise``).
    found : Candidates
        The motions with the shortest ``description``.
    pool : Candidates
        All candidates.
    description : Description
        The description, for which all misfit up to the parallax of an object is parallax.

    Returns
    -------
    Candidates
        The motions found; instead of those that consist of pieces, the pieces.
    """
    before = description.labels(found)
    least = min(least_tracks(family.observed_set.model) for family in description.families)
    if not any(_parts(points[before == k + 1], least) > 1 for k in range(len(found))):
        return found
    exact = replace(description, noise=noise)
    pieces = improve(found, pool, exact)
    labels = exact.labels(pieces)
    parts: list[Candidates] = []
    divided = []
    for motion in range(len(found) + 1):
        members = [k for k in range(len(pieces)) if _most(before[labels == k + 1]) == motion]
        groups = _touching(members, labels, points)
        # what was an outlier before is new
        if motion == 0 or len(groups) > 1:
            divided.append(motion - 1)
            parts += [_whole(group, pieces, labels, exact) for group in groups]
    return concatenate([found.without(*divided), *parts])


def _parts(points: Floats, least: int) -> int:
    """How many parts of matches that touch, each of at least so many, there are."""
    if len(points) < 2 * least:
        return 1
    near = nearest_neighbours(points, LABEL_NEIGHBOURS)
    part = np.arange(len(points))
    while True:
        lowest = np.minimum(part, part[near].min(axis=1))
        np.minimum.at(lowest, near, lowest[:, None])
        if np.array_equal(lowest, part):
            return int((np.bincount(part) >= least).sum())
        part = lowest


def _most(labels: Integers) -> int:
    """The most frequent label, -1 of none."""
    return int(np.bincount(labels).argmax()) if len(labels) else -1


def _touching(members: list[int], labels: Integers, points: Floats) -> list[list[int]]:
    """The pieces ``members`` in groups of those that touch: a match is near one of the other."""
    groups = [[k] for k in members]
    for one, other in combinations(members, 2):
        a, b = ([k in group for group in groups].index(True) for k in (one, other))
        if a != b and _touch(labels, one + 1, other + 1, points):
            groups[a] += groups[b]
            del groups[b]
    return groups


def _touch(labels: Integers, one: int, other: int, points: Floats) -> bool:
    """Whether a match of one piece is among the nearest of a match of the other."""
    both = np.isin(labels, (one, other))
    near = nearest_neighbours(points[both], LABEL_NEIGHBOURS)
    return bool(contacts(np.where(labels[both] == one, 1, 2), near, 2)[0, 1] > 0)


def _whole(
    group: list[int], pieces: Candidates, labels: Integers, description: Description
) -> Candidates:
    """The motion of a group of pieces: one fitted to all, or that of a piece."""
    if len(group) == 1:
        return pieces.take(group)
    tracks: Floats = np.isin(labels, np.array(group) + 1).astype(np.float64)
    candidates = [pieces.take(group)]
    for family in description.families:
        candidates += family.fitted(tracks[None], pieces.modes[group[:1]])
    every = concatenate(candidates)
    return every.take([int((np.maximum(every.gains, 0.0) @ tracks).argmax())])
