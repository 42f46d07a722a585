"""How well one rigid motion predicts a group of tracks, between many pairs of frames.

A rigid motion has one epipolar geometry between two frames, whatever the shape of the object. A
group is described by the leave-one-out residuals of its tracks: what the others predict about each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.geometry.robust import student_t_weights
from mssegment.geometry.robust_epipolar import (
    AFFINE_MATCHES,
    FREEDOM,
    FUNDAMENTAL_MATCHES,
    TO_DEVIATION,
    affine_epipolar_residuals,
    fundamental_residuals,
)
from mssegment.models import Flags
from mssegment.records import Floats, Integers, Record

UNPREDICTED = 20.0
"""Range in pixels of a displacement that nothing predicts; its code has the logarithm of it."""
LEAST_NOISE = 1e-3
"""Pixels; tracks without noise must not divide by zero."""
SCALE_ROUNDS = 8
"""Rounds of the most likely scale of a Student t distribution."""
FITTED_TRACKS = 300
"""Of larger groups the geometry is fitted to so many tracks, evenly spread; all are predicted."""
NORMALIZER = (
    math.lgamma(FREEDOM / 2) - math.lgamma((FREEDOM + 1) / 2) + 0.5 * math.log(FREEDOM * math.pi)
)
"""Negative logarithm of the Student t density of scale 1 at 0."""
MODELS = (
    (affine_epipolar_residuals, AFFINE_MATCHES),
    (fundamental_residuals, FUNDAMENTAL_MATCHES),
)


class GroupEvidence(Record, frozen=True):
    """How well the epipolar geometry of a group predicts its tracks.

    Attributes
    ----------
    cost : float
        Description length of the residuals, in nats.
    log_misfit : ndarray [p]
        Of each track, half the logarithm of its mean squared residual over the noise.
    """

    cost: float
    log_misfit: Floats


class EpipolarEvidence:
    """Descriptions of groups among the same tracks.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    pairs : sequence of (int, int)
        Pairs of frames.

    Attributes
    ----------
    noise : ndarray [pairs]
        Standard deviation of the residuals in pixels, the same for pairs with one gap.
    """

    def __init__(self, points: Floats, pairs: Sequence[tuple[int, int]]) -> None:
        matches = np.stack([points[:, pair].reshape(len(points), 4) for pair in pairs])
        self._seen: Flags = np.asarray(np.isfinite(matches).all(axis=2))
        self._matches = np.where(self._seen[:, :, None], matches, 0.0)
        gaps = np.array([second - first for first, second in pairs])
        self._gaps = [np.flatnonzero(gaps == gap) for gap in np.unique(gaps)]
        self.noise = np.full(len(pairs), LEAST_NOISE)
        self._cache: dict[bytes, GroupEvidence] = {}

    @property
    def pairs_seen(self) -> Integers:
        """Number of frame pairs in which each track is visible, [P]."""
        return np.asarray(self._seen.sum(axis=0), dtype=np.int64)

    def measure_noise(self, groups: Sequence[Integers]) -> None:
        """Set the ``noise`` from the residuals of small groups, which hold one motion each.

        1.48 times the median absolute residual, for each gap between frames: the tracker drifts
        with the time.
        """
        found: list[list[Floats]] = [[] for _ in self._gaps]
        for group in groups:
            by_model = [np.abs(errors) for errors in self.residuals(group)]
            for values, rows in zip(found, self._gaps, strict=True):
                known = [errors[rows][~np.isnan(errors[rows])] for errors in by_model]
                # what a model leaves to few matches is no measurement of it
                most = max(len(errors) for errors in known)
                usable = [errors for errors in known if len(errors) > most / 2]
                if most:
                    values.append(min(usable, key=lambda errors: float(np.median(errors))))
        for values, rows in zip(found, self._gaps, strict=True):
            if values:
                typical = float(np.median(np.concatenate(values)))
                self.noise[rows] = max(TO_DEVIATION * typical, LEAST_NOISE)
        self._cache = {}

    def residuals(self, tracks: Integers, members: Flags | None = None) -> list[Floats]:
        """Residuals [pairs, p] of tracks by each model, pixels; leave-one-out for the members.

        NaN where a track is not visible, or where too few members are for a fit. The geometry is
        fitted to the ``members`` [p] among the ``tracks`` [p], by default to all.
        """
        seen = self._seen[:, tracks]
        used = seen & _spread_out(np.ones(len(tracks), dtype=bool) if members is None else members)
        # only the columns of visible tracks: incomplete ones are not in most pairs
        columns = np.argsort(~seen, axis=1, kind="stable")[:, : seen.sum(axis=1).max(initial=1)]
        every = np.arange(len(seen))[:, None]
        matches = self._matches[every, tracks[columns]].transpose(0, 2, 1).copy()
        used, shown = used[every, columns], seen[every, columns]
        counts = used.sum(axis=1)
        found = []
        for of_model, least in MODELS:
            errors = np.full(seen.shape, np.nan)
            rows = np.flatnonzero(counts >= least)
            if len(rows):
                predicted = of_model(matches[rows], used[rows], self.noise[rows])
                predicted[~shown[rows]] = np.nan
                errors[rows[:, None], columns[rows]] = predicted
            found.append(errors)
        return found

    def of(self, group: Integers) -> GroupEvidence:
        """The evidence of a group, sorted indices of tracks [p], by the cheaper model."""
        key = group.tobytes()
        if key not in self._cache:
            seen, every = self._seen[:, group], np.ones(len(group), dtype=bool)
            found = [
                (float(self._code(errors, seen, every).sum()), errors)
                for errors in self.residuals(group)
            ]
            cost, errors = min(found, key=lambda one: one[0])
            relative = np.where(np.isnan(errors), UNPREDICTED, errors) / self.noise[:, None]
            squared = np.where(seen, relative**2, 0.0).sum(axis=0)
            misfit = 0.5 * np.log((squared + 1) / (seen.sum(axis=0) + 1))
            self._cache[key] = GroupEvidence(cost, misfit)
        return self._cache[key]

    def code_lengths(self, group: Integers) -> Floats:
        """Nats [P] to describe the residuals of each track by the geometry of a group."""
        tracks = np.arange(self._seen.shape[1])
        members = np.isin(tracks, group)
        codes = [
            self._code(errors, self._seen, members) for errors in self.residuals(tracks, members)
        ]
        return min(codes, key=lambda code: float(code[members].sum()))

    def _code(self, errors: Floats, seen: Flags, members: Flags) -> Floats:
        """Nats [p] to describe the residuals [pairs, p]; the ``members`` determine the scales.

        By the most likely Student t distribution of each gap, no narrower than the noise.
        """
        nats = np.where(seen, math.log(UNPREDICTED), 0.0)
        for rows in self._gaps:
            own = errors[rows][:, members]
            own = own[~np.isnan(own)]
            if len(own):
                scale_sq = _student_t_scale_sq(own, float(self.noise[rows[0]]))
                constant = NORMALIZER + 0.5 * math.log(scale_sq)
                tails = np.log1p(errors[rows] ** 2 / (FREEDOM * scale_sq))
                code = constant + (FREEDOM + 1) / 2 * tails
                nats[rows] = np.where(np.isnan(code), nats[rows], code)
        return np.asarray(nats.sum(axis=0))

    def growth(self, first: Integers, second: Integers) -> float:
        """How much worse the geometry of the union predicts two groups than their own does.

        The mean growth of ``log_misfit``, of the group where it is larger, at least 0.
        """
        both = np.concatenate([first, second])
        order = np.argsort(both, kind="stable")
        misfit = np.empty(len(both))
        misfit[order] = self.of(both[order]).log_misfit
        grown = misfit[: len(first)] - self.of(first).log_misfit
        grown_too = misfit[len(first) :] - self.of(second).log_misfit
        return max(float(grown.mean()), float(grown_too.mean()), 0.0)

    def cost(self, groups: Sequence[Integers]) -> float:
        """Description length in nats of a partition: its groups, and the label of each track."""
        total = sum(len(group) for group in groups)
        labels = -sum(len(group) * math.log(len(group) / total) for group in groups)
        return labels + sum(self.of(group).cost for group in groups)


def _spread_out(members: Flags) -> Flags:
    """``FITTED_TRACKS`` of the members [p], evenly spread; all where they are fewer."""
    chosen = np.flatnonzero(members)
    if len(chosen) <= FITTED_TRACKS:
        return members
    fitted = np.zeros(len(members), dtype=bool)
    fitted[chosen[np.linspace(0, len(chosen) - 1, FITTED_TRACKS).round().astype(int)]] = True
    return fitted


def _student_t_scale_sq(values: Floats, least: float) -> float:
    """The most likely squared scale of a Student t distribution about 0, at least ``least``^2."""
    squared = values**2
    scale_sq = max(float(np.median(squared)), least**2)
    for _ in range(SCALE_ROUNDS):
        weights = student_t_weights(squared / scale_sq, FREEDOM, 1)
        scale_sq = max(float(weights @ squared) / len(squared), least**2)
    return scale_sq
