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

    def residuals(self, group: Integers) -> list[Floats]:
        """Leave-one-out residuals [pairs, p] of a group by each model, pixels.

        NaN where a track is not visible, or where too few tracks are for a fit.
        """
        seen = self._seen[:, group]
        used = seen
        if len(group) > FITTED_TRACKS:
            fitted = np.zeros(len(group), dtype=bool)
            fitted[np.linspace(0, len(group) - 1, FITTED_TRACKS).round().astype(int)] = True
            used = seen & fitted
        # only the columns of visible tracks: incomplete ones are not in most pairs
        columns = np.argsort(~seen, axis=1, kind="stable")[:, : seen.sum(axis=1).max(initial=1)]
        every = np.arange(len(seen))[:, None]
        matches = self._matches[every, group[columns]].transpose(0, 2, 1).copy()
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
            seen = self._seen[:, group]
            found = [self._described(errors, seen) for errors in self.residuals(group)]
            self._cache[key] = min(found, key=lambda one: one.cost)
        return self._cache[key]

    def _described(self, errors: Floats, seen: Flags) -> GroupEvidence:
        """By the residuals of one model [pairs, p], where the tracks are ``seen``."""
        predicted = ~np.isnan(errors)
        cost = math.log(UNPREDICTED) * float((seen & ~predicted).sum())
        for rows in self._gaps:
            values = errors[rows][predicted[rows]]
            if len(values):
                cost += _student_t_cost(values, float(self.noise[rows[0]]))
        relative = np.where(predicted, errors, UNPREDICTED) / self.noise[:, None]
        squared = np.where(seen, relative**2, 0.0).sum(axis=0)
        return GroupEvidence(cost, 0.5 * np.log((squared + 1) / (seen.sum(axis=0) + 1)))

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


def _student_t_cost(values: Floats, least: float) -> float:
    """Negative log likelihood of residuals under the most likely Student t distribution about 0.

    Its scale is at least ``least``.
    """
    squared = values**2
    scale_sq = max(float(np.median(squared)), least**2)
    for _ in range(SCALE_ROUNDS):
        weights = student_t_weights(squared / scale_sq, FREEDOM, 1)
        scale_sq = max(float(weights @ squared) / len(squared), least**2)
    constant = math.lgamma((FREEDOM + 1) / 2) - math.lgamma(FREEDOM / 2)
    constant -= 0.5 * math.log(FREEDOM * math.pi * scale_sq)
    tails = float(np.log1p(squared / (FREEDOM * scale_sq)).sum())
    return (FREEDOM + 1) / 2 * tails - len(values) * constant
