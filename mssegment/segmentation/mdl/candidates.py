"""Candidate motions: the modes at two scales, refitted; and what each saves on each track.

A candidate is a motion with a scale. Every stage of its refitting is kept, because a candidate
that grows alone ends by swallowing its neighbours: the early stages are often the better motions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Floats, Integers, Record, replace
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.mdl.displacement import displacement_gains
from mssegment.segmentation.mdl.likelihood import Noise

UNSOUND = 1e6
"""Pixels; stands for an infinite residual."""
STAGES = 5
"""Fits of a mode, each to what the one before explains."""
SAME = 0.05
"""Share of the inliers by which two sets may differ whose fits would hardly do."""


class Candidates(Record, frozen=True):
    """K motions: ``set_indices`` [K], and ``modes`` [K] that each grew from (-1: none).

    ``points`` are K points on their manifolds, ``scales`` [K] pixels, ``gains`` [K, P] what each
    saves on each track (nats), ``residuals`` [K, P] pixels, ``prices`` [K] nats.
    """

    set_indices: Integers
    modes: Integers
    points: tuple[Floats, ...]
    scales: Floats
    residuals: Floats
    gains: Floats

    def __len__(self) -> int:
        return len(self.set_indices)

    @staticmethod
    def none(tracks: int) -> Candidates:
        """No candidates for so many tracks."""
        empty, rows = np.zeros(0, dtype=np.int64), np.zeros((0, tracks))
        return Candidates(empty, empty, (), np.zeros(0), rows, rows)

    def take(self, index: Sequence[int] | Integers) -> Candidates:
        """The candidates ``index``."""
        i = np.asarray(index, dtype=np.int64)
        points = tuple(self.points[k] for k in i)
        return Candidates(
            self.set_indices[i],
            self.modes[i],
            points,
            self.scales[i],
            self.residuals[i],
            self.gains[i],
        )


def join(parts: Sequence[Candidates]) -> Candidates:
    """All candidates of the ``parts``, in order."""
    return Candidates(
        np.concatenate([p.set_indices for p in parts]),
        np.concatenate([p.modes for p in parts]),
        tuple(point for p in parts for point in p.points),
        np.concatenate([p.scales for p in parts]),
        np.concatenate([p.residuals for p in parts]),
        np.concatenate([p.gains for p in parts]),
    )


class Family(Record, frozen=True):
    """One set of hypotheses with all that turns its motions into candidates.

    ``index`` is the place of the set.
    """

    index: int
    observed_set: ObservedSet
    noise: Noise

    def residuals(self, points: Floats) -> Floats:
        """Residuals [B, P] in pixels, finite."""
        return np.fmin(self.observed_set.residuals(points), UNSOUND)

    def measured(self) -> Family:
        """The same without parallax as noise: scales as small as measurements can have."""
        noise = replace(self.noise, parallax=np.zeros_like(self.noise.parallax))
        return replace(self, noise=noise)

    def fitted(self, inliers: Floats, modes: Integers) -> list[Candidates]:
        """The motions fitted to the ``inliers`` [B, P] (0 or 1), one element or none.

        Unsound fits are left out.
        """
        return self._fitted(inliers, inliers, modes)

    def grown(self, inliers: Floats, modes: Integers, seen: Seen) -> list[Candidates]:
        """Motions fitted to the ``inliers`` [B, P] (0 or 1), then to what they explain, and so on.

        One element per stage. Inliers that were ``seen`` already are not fitted again.
        """
        made: list[Candidates] = []
        weights = inliers
        for _ in range(STAGES):
            new = seen.new(inliers)
            found = self._fitted(inliers[new], weights[new], modes[new])
            if not found:
                break
            made += found
            residuals, scales, modes = found[0].residuals, found[0].scales, found[0].modes
            inliers = self.explained(residuals, scales)
            weights = inliers * self.noise.weights(residuals, scales)
        return made

    def _fitted(self, inliers: Floats, weights: Floats, modes: Integers) -> list[Candidates]:
        enough = np.flatnonzero(inliers.sum(axis=1) > self.observed_set.model.subset_size)
        if not enough.size:
            return []
        points, valid = self.observed_set.fit(weights[enough])
        if not valid.any():
            return []
        points, own = points[valid], enough[valid]
        inliers = inliers[own]
        residuals = self.residuals(points)
        scales = self.noise.scales(residuals, inliers)
        return [self._made(points, scales, residuals, modes[own], inliers)]

    def gains(self, points: Floats, residuals: Floats, scales: Floats, inliers: Floats) -> Floats:
        """Nats that each motion saves on each track, [B, P], given its ``inliers`` [B, P]."""
        gains = self.noise.gains(residuals, scales)
        observed_set = self.observed_set
        moved = observed_set.model.displacements(
            points, observed_set.observed, observed_set.hypotheses.normalization
        )
        if moved is None:
            return gains
        return gains + displacement_gains(moved, inliers, self.noise)

    def explained(self, residuals: Floats, scales: Floats) -> Floats:
        """Where a motion saves more than half of what it would save on a perfect fit, [B, P]."""
        return np.asarray(residuals < self.noise.half_gain(scales)[:, None], dtype=np.float64)

    def _made(
        self,
        points: Floats,
        scales: Floats,
        residuals: Floats,
        modes: Integers,
        inliers: Floats,
    ) -> Candidates:
        count = len(points)
        return Candidates(
            np.full(count, self.index),
            np.asarray(modes, dtype=np.int64),
            tuple(points),
            scales,
            residuals,
            self.gains(points, residuals, scales, inliers),
        )


def from_modes(family: Family, points: Floats, modes: Integers) -> list[Candidates]:
    """The modes ``points`` [B, ...] grown from what they explain, at two scales."""
    points = family.observed_set.model.orientations(points)
    modes = np.resize(modes, len(points))
    residuals = family.residuals(points)
    made: list[Candidates] = []
    seen = Seen(residuals.shape[1])
    for scale in family.noise.first_scales():
        inliers = family.explained(residuals, np.full(len(points), scale))
        made += family.grown(inliers, modes, seen)
    return made


class Seen:
    """Sets of inliers that were fitted; those that differ by a few tracks count as one."""

    def __init__(self, tracks: int) -> None:
        self._sets = np.zeros((0, tracks), dtype=np.float32)

    def new(self, inliers: Floats) -> list[int]:
        """The rows of ``inliers`` [B, P] (0 or 1) that are new; they are seen from now on."""
        rows = inliers.astype(np.float32)
        known = len(self._sets)
        every = np.concatenate([self._sets, rows])
        size = every.sum(axis=1)
        own = size[known:, None]
        apart = own + size - 2.0 * (rows @ every.T)
        same = apart <= SAME * own
        among = same[:, known:].tolist()
        fresh: list[int] = []
        for row in np.flatnonzero(~same[:, :known].any(axis=1)).tolist():
            if not any(among[row][k] for k in fresh):
                fresh.append(row)
        self._sets = np.concatenate([self._sets, rows[fresh]])
        return fresh
