"""A set of hypotheses together with the tracks that it sees."""

from __future__ import annotations

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.models import Flags, MotionModel
from mssegment.records import Floats, HypothesisSet, Integers, Record


class ObservedSet(Record, frozen=True):
    """One set of hypotheses with the tracks as its model sees them.

    ``tracks`` [n] are the indices of the tracks that are visible in all frames of the set, and
    ``observed`` [n, F, 2] are these tracks, normalized.
    """

    hypotheses: HypothesisSet
    model: MotionModel
    tracks: Integers
    observed: Floats

    @classmethod
    def of(cls, points: Floats, hypotheses: HypothesisSet) -> ObservedSet:
        """What ``hypotheses`` see of the tracks ``points`` [P, F, 2] (pixels, NaN: not visible).

        Raises DataError where the set is of a frame that the tracks do not have, or holds points
        that are none of its model.
        """
        frames = list(hypotheses.frames)
        if max(frames) >= points.shape[1]:
            raise DataError(
                f"the hypotheses are of frame {max(frames) + 1}, but the tracks have "
                f"{points.shape[1]} frames: the document is damaged, run hypothesize again"
            )
        model = models.of_set(hypotheses)
        own = points[:, frames]
        tracks = np.flatnonzero(np.isfinite(own).all(axis=(1, 2)))
        return cls(hypotheses, model, tracks, model.observe(own[tracks], hypotheses.normalization))

    def residuals(self, points: Floats) -> Floats:
        """Residuals [B, n] in pixels of the tracks from the motions ``points`` [B, ...]."""
        return self.model.residuals(points, self.observed, self.hypotheses.normalization)

    def fit(self, weights: Floats) -> tuple[Floats, Flags]:
        """Least-squares motions under the weights [B, n], and which are valid."""
        return self.model.fit(self.observed, weights)

    def ranking_sq_residuals(self) -> Floats:
        """Squared residuals [n, hypotheses] of the tracks, normalized coordinates."""
        return self.model.ranking_sq_residuals(self.hypotheses.points, self.observed)
