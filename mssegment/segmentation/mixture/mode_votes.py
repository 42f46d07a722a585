"""What the hypotheses and their modes say about each track, before any groups are formed."""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Record
from mssegment.sampling.elemental_subsets import SEED_NEIGHBOURS, SUPPORT_TOLERANCE
from mssegment.sampling.neighbourhoods import nearest_neighbours
from mssegment.segmentation.selection import SelectionProblem

AROUND = 20
"""A track's misfit comes from hypotheses whose seed is among so many nearest tracks."""


class ModeVotes(Record, frozen=True):
    """Tracks among the hypotheses of one set.

    ``vote_shares`` [P, modes]: of the hypotheses of each track, the share that climbs to each mode.
    A hypothesis is one of a track's if the track is in its elemental subset, or near its seed and
    agrees with it; tracks without any take over what their neighbours have; rows sum to 1.
    ``misfit`` [P]: the least residual (pixels) from the hypotheses that are seeded around the track
    and not made of it.
    """

    vote_shares: Floats
    misfit: Floats

    @classmethod
    def of_set(cls, problem: SelectionProblem, index: int) -> ModeVotes:
        """From set ``index`` of the problem and the modes that its hypotheses climb to."""
        points, observed_set = problem.points, problem.observed_sets[index]
        near = nearest_neighbours(points, AROUND)
        subsets = _places(problem.tracks, observed_set.hypotheses.subsets)
        usable = (subsets >= 0).all(axis=1)
        subsets, assigned = subsets[usable], problem.assignments[index][usable]
        residuals = observed_set.residuals(observed_set.hypotheses.points[usable])
        vote_shares = _shares(
            near[:, :SEED_NEIGHBOURS], subsets, assigned, residuals < _tolerance(points)
        )
        np.put_along_axis(residuals, subsets, np.inf, axis=1)
        around = np.zeros((len(points), len(points)), dtype=bool)
        np.put_along_axis(around, near, True, axis=1)
        own = np.where(around[:, subsets[:, 0]].T, residuals, np.inf).min(axis=0, initial=np.inf)
        anywhere = residuals.min(axis=0, initial=np.inf)
        return cls(vote_shares, np.where(np.isfinite(own), own, anywhere))


def _shares(near: Integers, subsets: Integers, assigned: Integers, agree: Flags) -> Floats:
    """``Company.shares`` from the neighbours [P, n] and who agrees with which hypothesis [B, P]."""
    member = np.zeros(agree.shape)
    around = near[subsets[:, 0]]
    np.put_along_axis(member, around, np.take_along_axis(agree, around, axis=1), axis=1)
    np.put_along_axis(member, subsets, 1.0, axis=1)
    modes, own = np.unique(assigned, return_inverse=True)
    climbs = (own.ravel()[:, None] == np.arange(len(modes))) & (assigned >= 0)[:, None]
    votes = member.T @ climbs
    nobody = ~votes.any(axis=1)
    votes[nobody] = votes[near[nobody]].sum(axis=1)
    votes[~votes.any(axis=1)] = 1.0
    return np.asarray(votes / votes.sum(axis=1, keepdims=True))


def _tolerance(points: Floats) -> float:
    """The residual (pixels) below which a track near the seed agreed when it was drawn."""
    return SUPPORT_TOLERANCE * float(
        np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=-1).mean())
    )


def _places(tracks: Integers, subsets: Integers) -> Integers:
    """``subsets`` [n, k], numbers among all tracks, as places in ``tracks``; -1: not there."""
    place = np.full(max(int(subsets.max(initial=0)), int(tracks.max(initial=0))) + 1, -1)
    place[tracks] = np.arange(len(tracks))
    return np.asarray(place[subsets])
