"""What mean shift says about each track: to which modes the hypotheses around it climb."""

from __future__ import annotations

import numpy as np

from mssegment.hypotheses import AGREEMENT, NEIGHBOURS, nearest_neighbours
from mssegment.records import Floats, Integers
from mssegment.segmentation.selection import Problem


def company(problem: Problem, index: int) -> Floats:
    """The share of each mode of set ``index`` in the hypotheses of each track, [P, modes].

    A hypothesis is one of a track's if the track is in its elemental subset, or near its seed and
    agrees with it. Tracks without any take over what their neighbours have; rows sum to 1.
    """
    points, view = problem.points, problem.views[index]
    near = nearest_neighbours(points, NEIGHBOURS)
    subsets = _places(problem.tracks, view.hypotheses.subsets)
    assigned = problem.assignments[index]
    usable = (subsets >= 0).all(axis=1) & (assigned >= 0)
    modes, own = np.unique(assigned[usable], return_inverse=True)
    votes = np.zeros((len(points), max(len(modes), 1)))
    subsets = subsets[usable]
    for around, hypothesis, mode in zip(
        subsets, view.hypotheses.points[usable], own.ravel(), strict=True
    ):
        close = near[around[0]]
        residuals = view.model.residuals(
            hypothesis[None], view.observed[close], view.hypotheses.coordinates
        )[0]
        votes[np.union1d(around, close[residuals < _tolerance(points)]), mode] += 1
    nobody = ~votes.any(axis=1)
    votes[nobody] = votes[near[nobody]].sum(axis=1)
    votes[~votes.any(axis=1)] = 1.0
    return np.asarray(votes / votes.sum(axis=1, keepdims=True))


def _tolerance(points: Floats) -> float:
    """The residual (pixels) below which a track near the seed agreed when it was drawn."""
    return AGREEMENT * float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=-1).mean()))


def _places(tracks: Integers, subsets: Integers) -> Integers:
    """``subsets`` [n, k], numbers among all tracks, as places in ``tracks``; -1: not there."""
    place = np.full(max(int(subsets.max(initial=0)), int(tracks.max(initial=0))) + 1, -1)
    place[tracks] = np.arange(len(tracks))
    return np.asarray(place[subsets])
