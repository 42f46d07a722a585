"""Candidate motions: the modes fitted to their tracks, and what each saves on each track.

A candidate is a motion with a scale. It is fitted only once, to what it explains at the least
scale: a candidate that grows alone ends by swallowing its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.segmentation.likelihood import Noise
from mssegment.segmentation.selection import View

UNSOUND = 1e6
"""Pixels; stands for an infinite residual."""


@dataclass(frozen=True)
class Candidates:
    """K motions: ``views`` [K] index the set, ``modes`` [K] the mode each grew from (-1: none).

    ``points`` are K points on their manifolds, ``scales`` [K] pixels, ``gains`` [K, P] what each
    saves on each track (nats), ``residuals`` [K, P] pixels, ``prices`` [K] nats.
    """

    views: Integers
    modes: Integers
    points: tuple[Floats, ...]
    scales: Floats
    residuals: Floats
    gains: Floats

    def __len__(self) -> int:
        return len(self.views)

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
            self.views[i],
            self.modes[i],
            points,
            self.scales[i],
            self.residuals[i],
            self.gains[i],
        )


def join(parts: Sequence[Candidates]) -> Candidates:
    """All candidates of the ``parts``, in order."""
    return Candidates(
        np.concatenate([p.views for p in parts]),
        np.concatenate([p.modes for p in parts]),
        tuple(point for p in parts for point in p.points),
        np.concatenate([p.scales for p in parts]),
        np.concatenate([p.residuals for p in parts]),
        np.concatenate([p.gains for p in parts]),
    )


@dataclass(frozen=True)
class Family:
    """One set of hypotheses with all that turns its motions into candidates.

    ``index`` is the place of the set.
    """

    index: int
    view: View
    noise: Noise

    def residuals(self, points: Floats) -> Floats:
        """Residuals [B, P] in pixels, finite."""
        return np.nan_to_num(self.view.residuals(points), nan=UNSOUND, posinf=UNSOUND)

    def measured(self) -> Family:
        """The same without parallax as noise: scales as small as measurements can have."""
        noise = replace(self.noise, parallax=np.zeros_like(self.noise.parallax))
        return replace(self, noise=noise)

    def fitted(self, inliers: Floats, modes: Integers) -> list[Candidates]:
        """The motions fitted to the ``inliers`` [B, P] (0 or 1), one element or none.

        Unsound fits are left out.
        """
        points, sound = self.view.fit(inliers)
        sound = sound & (inliers.sum(axis=1) > self.view.model.subset_size)
        if not sound.any():
            return []
        points, inliers = points[sound], inliers[sound]
        residuals = self.residuals(points)
        return [self._made(points, self.noise.scales(residuals, inliers), residuals, modes[sound])]

    def explained(self, residuals: Floats, scales: Floats) -> Floats:
        """Where a motion saves more than half of what it would save on a perfect fit, [B, P]."""
        perfect = self.noise.gains(np.zeros((len(scales), 1)), scales)
        return np.asarray(self.noise.gains(residuals, scales) > perfect / 2, dtype=np.float64)

    def _made(
        self, points: Floats, scales: Floats, residuals: Floats, modes: Integers
    ) -> Candidates:
        count = len(points)
        return Candidates(
            np.full(count, self.index),
            np.asarray(modes, dtype=np.int64),
            tuple(points),
            scales,
            residuals,
            self.noise.gains(residuals, scales),
        )


def from_modes(family: Family, points: Floats, modes: Integers) -> list[Candidates]:
    """The modes ``points`` [B, ...] fitted to what they explain at the least scale of a motion.

    Of modes that explain the same tracks the first is taken.
    """
    points = family.view.model.orientations(points)
    modes = np.resize(modes, len(points))
    least = np.full(len(points), family.noise.floor)
    inliers = family.explained(family.residuals(points), least)
    _, first = np.unique(np.packbits(inliers > 0, axis=1), axis=0, return_index=True)
    kept = np.sort(first)
    return family.fitted(inliers[kept], modes[kept])
