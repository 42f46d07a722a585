"""Candidate motions: the modes, refitted at two scales, and what each saves on each track.

A candidate is a motion with a scale. Every stage of its refitting is kept: a candidate that is
refitted without competition ends up including neighbouring motions, so the early stages are often
better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Record, replace
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.mdl.displacement import displacement_gains
from mssegment.segmentation.mdl.likelihood import Noise
from mssegment.segmentation.mdl.relief import Misfits, Relief

MAX_RESIDUAL = 1e6
"""Residuals in pixels are at most this; infinite ones are replaced by it."""
GROWTH_STAGES = 5
"""Number of fits of a mode, each to the tracks that the previous one explains."""
COVERING = 16
"""Most hypotheses that are candidates although they are no modes; twice the motions of a scene."""
BLOCK = 512
"""Hypotheses whose residuals are computed at a time."""
SAME_INLIERS_SHARE = 0.05
"""Two sets of inliers count as one if they differ by at most this share."""


class Candidates(Record, frozen=True):
    """K motions, and what they save on P tracks.

    Attributes
    ----------
    set_indices : ndarray [K] of int
        Index of the set of hypotheses of each.
    modes : ndarray [K] of int
        Index of the mode that each was refitted from; -1 for none.
    points : tuple of K ndarrays
        Points on the manifolds.
    scales : ndarray [K]
        Scales of the residuals in pixels.
    residuals : ndarray [K, P]
        Residuals in pixels; of motions with relief, misfits in units that make the direction of
        the relief and the other one alike (``relief``).
    gains : ndarray [K, P]
        Nats that each motion saves on each track.
    lengths : ndarray [K, P]
        Residuals in pixels.
    shapes : ndarray [K, 5]
        Scales in pixels across and along the relief, along it without bounds, and their bound;
        ``scales`` for motions without relief. Nats to tell the epipole.
    """

    set_indices: Integers
    modes: Integers
    points: tuple[Floats, ...]
    scales: Floats
    residuals: Floats
    gains: Floats
    lengths: Floats
    shapes: Floats

    def __len__(self) -> int:
        return len(self.set_indices)

    @staticmethod
    def empty(tracks: int) -> Candidates:
        """No candidates, for this number of tracks."""
        empty, rows = np.zeros(0, dtype=np.int64), np.zeros((0, tracks))
        return Candidates(empty, empty, (), np.zeros(0), rows, rows, rows, np.zeros((0, 5)))

    def take(self, index: Sequence[int] | Integers) -> Candidates:
        """The candidates with these indices."""
        i = np.asarray(index, dtype=np.int64)
        return Candidates(
            self.set_indices[i],
            self.modes[i],
            tuple(self.points[k] for k in i),
            self.scales[i],
            self.residuals[i],
            self.gains[i],
            self.lengths[i],
            self.shapes[i],
        )

    def without(self, *index: int) -> Candidates:
        """All candidates but those with these indices."""
        return self.take([k for k in range(len(self)) if k not in index])


def concatenate(parts: Sequence[Candidates]) -> Candidates:
    """All candidates of the ``parts``, in order."""
    return Candidates(
        np.concatenate([p.set_indices for p in parts]),
        np.concatenate([p.modes for p in parts]),
        tuple(point for p in parts for point in p.points),
        np.concatenate([p.scales for p in parts]),
        np.concatenate([p.residuals for p in parts]),
        np.concatenate([p.gains for p in parts]),
        np.concatenate([p.lengths for p in parts]),
        np.concatenate([p.shapes for p in parts]),
    )


class Measured(Record, frozen=True):
    """Attributes of ``Candidates`` that depend on their inliers."""

    scales: Floats
    residuals: Floats
    lengths: Floats
    shapes: Floats


class Family(Record, frozen=True):
    """The motions of one set of hypotheses: its tracks, its model, and the noise of its residuals.

    ``index`` is the index of the set; ``with_relief`` whether misfits may lie along the lines to
    an epipole, as those of bodies do that are not flat.
    """

    index: int
    observed_set: ObservedSet
    noise: Noise
    with_relief: bool = False

    def residuals(self, points: Floats) -> Floats:
        """Residuals [B, P] in pixels, finite."""
        return np.fmin(self.observed_set.residuals(points), MAX_RESIDUAL)

    def without_parallax(self) -> Family:
        """The same family with measurement noise only."""
        noise = replace(self.noise, parallax=np.zeros_like(self.noise.parallax))
        return replace(self, noise=noise)

    def fitted(self, inliers: Floats, modes: Integers) -> list[Candidates]:
        """Fit motions to their ``inliers`` [B, P] (0 or 1).

        Returns a list of at most one element; invalid fits are left out.
        """
        return self._fitted(inliers, inliers, modes)

    def grown(self, inliers: Floats, modes: Integers, fitted: FittedSets) -> list[Candidates]:
        """Fit motions to their ``inliers`` [B, P] (0 or 1), then to what they explain, and so on.

        Returns one element per stage. Sets of inliers in ``fitted`` are not fitted again.
        """
        stages: list[Candidates] = []
        weights = inliers
        for _ in range(GROWTH_STAGES):
            new = fitted.add_new(inliers)
            found = self._fitted(inliers[new], weights[new], modes[new])
            if not found:
                break
            stages += found
            residuals, scales, modes = found[0].residuals, found[0].scales, found[0].modes
            inliers = self.explained(residuals, scales)
            weights = inliers * self.noise.weights(residuals, scales)
        return stages

    def _fitted(self, inliers: Floats, weights: Floats, modes: Integers) -> list[Candidates]:
        """The valid fits to weighted inliers, as candidates; a list of at most one element."""
        enough = np.flatnonzero(inliers.sum(axis=1) > self.observed_set.model.subset_size)
        if not enough.size:
            return []
        points, valid = self.observed_set.fit(weights[enough])
        if not valid.any():
            return []
        points, rows = points[valid], enough[valid]
        inliers = inliers[rows]
        found = self.measured(points, inliers)
        return [
            Candidates(
                np.full(len(points), self.index),
                np.asarray(modes[rows], dtype=np.int64),
                tuple(points),
                found.scales,
                found.residuals,
                self.gains(points, found.residuals, found.scales, inliers),
                found.lengths,
                found.shapes,
            )
        ]

    def measured(self, points: Floats, inliers: Floats, start: Floats | None = None) -> Measured:
        """What misfits motions ``points`` leave, given their ``inliers`` [B, P]."""
        if not self.with_relief:
            residuals = self.residuals(points)
            scales = self.noise.scales(residuals, inliers, start)
            shapes = np.stack([*[scales] * 4, np.zeros_like(scales)], axis=1)
            return Measured(scales, residuals, residuals, shapes)
        misfits = Misfits.of(self.observed_set, points)
        relief = Relief.of(misfits, inliers, self.noise)
        if not self.noise.parallax.any():
            relief = relief.where_it_pays(misfits.lengths, inliers, self.noise)
        return Measured(relief.scales, relief.residuals, misfits.lengths, relief.shapes)

    def gains(self, points: Floats, residuals: Floats, scales: Floats, inliers: Floats) -> Floats:
        """Nats that each motion saves on each track, [B, P], given its ``inliers`` [B, P]."""
        gains = self.noise.gains(residuals, scales)
        observed_set = self.observed_set
        displacements = observed_set.model.displacements(
            points, observed_set.observed, observed_set.hypotheses.normalization
        )
        if displacements is None:
            return gains
        return gains + displacement_gains(displacements, inliers, self.noise)

    def explained(self, residuals: Floats, scales: Floats) -> Floats:
        """1 where a motion saves more than half of its ``max_gain``, else 0, [B, P]."""
        limits = self.noise.residual_at_half_gain(scales)
        return np.asarray(residuals < limits[:, None], dtype=np.float64)


def from_modes(family: Family, points: Floats, modes: Integers) -> list[Candidates]:
    """Refit the modes ``points`` [B, ...] to what they explain, starting at two scales."""
    points = family.observed_set.model.orientations(points)
    modes = np.resize(modes, len(points))
    residuals = family.residuals(points)
    candidates: list[Candidates] = []
    fitted = FittedSets(residuals.shape[1])
    for scale in family.noise.initial_scales():
        inliers = family.explained(residuals, np.full(len(points), scale))
        candidates += family.grown(inliers, modes, fitted)
    return candidates


def covering(family: Family, tracks: Flags) -> list[int]:
    """Indices of hypotheses that explain as many of ``tracks`` [P] as possible together.

    The best one first; each saves what it saves, at the smallest scale, on tracks that none before
    explains.
    """
    points = family.observed_set.hypotheses.points
    residuals = np.concatenate(
        [family.residuals(points[k : k + BLOCK])[:, tracks] for k in range(0, len(points), BLOCK)]
    )
    scales = np.repeat(family.noise.initial_scales()[:1], len(points))
    gains = np.maximum(family.noise.gains(residuals, scales), 0.0)
    remaining = np.ones(gains.shape[1])
    found: list[int] = []
    for _ in range(min(COVERING, len(points))):
        saved = gains @ remaining
        k = int(saved.argmax())
        if saved[k] <= 0:
            break
        found.append(k)
        remaining[gains[k] > 0] = 0.0
    return found


class FittedSets:
    """Sets of inliers to which a motion was fitted; sets that hardly differ count as one."""

    def __init__(self, tracks: int) -> None:
        self._sets = np.zeros((0, tracks), dtype=np.float32)

    def add_new(self, inliers: Floats) -> list[int]:
        """Add the rows of ``inliers`` [B, P] (0 or 1) that are new, and return their indices."""
        rows = inliers.astype(np.float32)
        known = len(self._sets)
        sets = np.concatenate([self._sets, rows])
        sizes = sets.sum(axis=1)
        row_sizes = sizes[known:, None]
        differences = row_sizes + sizes - 2.0 * (rows @ sets.T)
        same = differences <= SAME_INLIERS_SHARE * row_sizes
        same_row = same[:, known:].tolist()
        new: list[int] = []
        for row in np.flatnonzero(~same[:, :known].any(axis=1)).tolist():
            if not any(same_row[row][k] for k in new):
                new.append(row)
        self._sets = np.concatenate([self._sets, rows[new]])
        return new
