"""What the hypotheses and their modes indicate about each track before groups are formed."""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Record
from mssegment.sampling.elemental_subsets import SEED_NEIGHBOURS, SUPPORT_TOLERANCE
from mssegment.sampling.neighbourhoods import nearest_neighbours
from mssegment.sampling.validation import MISFIT_NEIGHBOURS
from mssegment.segmentation.selection import SelectionProblem


class ModeVotes(Record, frozen=True):
    """Tracks with respect to the hypotheses of one set.

    Attributes
    ----------
    vote_shares : ndarray [P, M]
        Shares of the hypotheses of each track that converge to each mode; rows sum to 1. A
        hypothesis belongs to a track that is in its elemental subset, or near its seed and an
        inlier. Tracks without hypotheses have the votes of their neighbours.
    misfit : ndarray [P]
        Smallest residual in pixels from the hypotheses that are seeded near the track and were not
        computed from it.
    """

    vote_shares: Floats
    misfit: Floats

    @classmethod
    def of_set(cls, problem: SelectionProblem, index: int) -> ModeVotes:
        """Compute the votes for set ``index`` of the problem."""
        points, observed_set = problem.points, problem.observed_sets[index]
        neighbours = nearest_neighbours(points, MISFIT_NEIGHBOURS)
        subsets = _rows(problem.tracks, observed_set.hypotheses.subsets)
        usable = (subsets >= 0).all(axis=1)
        subsets, assigned = subsets[usable], problem.assignments[index][usable]
        residuals = observed_set.residuals(observed_set.hypotheses.points[usable])
        inliers = residuals < _tolerance(points)
        vote_shares = _vote_shares(neighbours[:, :SEED_NEIGHBOURS], subsets, assigned, inliers)
        np.put_along_axis(residuals, subsets, np.inf, axis=1)
        near = np.zeros((len(points), len(points)), dtype=bool)
        np.put_along_axis(near, neighbours, True, axis=1)
        local = np.where(near[:, subsets[:, 0]].T, residuals, np.inf).min(axis=0, initial=np.inf)
        overall = residuals.min(axis=0, initial=np.inf)
        return cls(vote_shares, np.where(np.isfinite(local), local, overall))


def _vote_shares(
    neighbours: Integers, subsets: Integers, assigned: Integers, inliers: Flags
) -> Floats:
    """Vote shares from ``neighbours`` [P, n] and the ``inliers`` [B, P] of the hypotheses."""
    member = np.zeros(inliers.shape)
    near = neighbours[subsets[:, 0]]
    np.put_along_axis(member, near, np.take_along_axis(inliers, near, axis=1), axis=1)
    np.put_along_axis(member, subsets, 1.0, axis=1)
    modes, column = np.unique(assigned, return_inverse=True)
    converges = (column.ravel()[:, None] == np.arange(len(modes))) & (assigned >= 0)[:, None]
    votes = member.T @ converges
    without = ~votes.any(axis=1)
    votes[without] = votes[neighbours[without]].sum(axis=1)
    votes[~votes.any(axis=1)] = 1.0
    return np.asarray(votes / votes.sum(axis=1, keepdims=True))


def _tolerance(points: Floats) -> float:
    """Residual in pixels below which a track near the seed supported a hypothesis when sampling."""
    radius = np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=-1).mean())
    return SUPPORT_TOLERANCE * float(radius)


def _rows(tracks: Integers, subsets: Integers) -> Integers:
    """Positions in ``tracks`` of the indices ``subsets`` [n, k] of all tracks; -1 if not there."""
    row = np.full(max(int(subsets.max(initial=0)), int(tracks.max(initial=0))) + 1, -1)
    row[tracks] = np.arange(len(tracks))
    return np.asarray(row[subsets])
