"""A set of hypotheses together with the tracks that it applies to."""

from __future__ import annotations

import numpy as np

from mssegment import models
from mssegment.errors import DataError
from mssegment.models import Flags, MotionModel
from mssegment.records import Floats, HypothesisSet, Integers, Record


class ObservedSet(Record, frozen=True):
    """A set of hypotheses and the tracks as its model observes them.

    Attributes
    ----------
    hypotheses : HypothesisSet
        The set.
    model : MotionModel
        Its model.
    tracks : ndarray [n] of int
        Indices of the tracks that are visible in all frames of the set.
    observed : ndarray [n, F, 2]
        These tracks, normalized.
    """

    hypotheses: HypothesisSet
    model: MotionModel
    tracks: Integers
    observed: Floats

    @classmethod
    def of(cls, points: Floats, hypotheses: HypothesisSet) -> ObservedSet:
        """Select and normalize the tracks that a set of hypotheses applies to.

        Parameters
        ----------
        points : ndarray [P, F, 2]
            Tracks in pixels, NaN where a point is not visible.
        hypotheses : HypothesisSet
            The set.

        Returns
        -------
        ObservedSet

        Raises
        ------
        DataError
            If the set refers to a frame that the tracks do not have, or does not fit its model.
        """
        frames = list(hypotheses.frames)
        if max(frames) >= points.shape[1]:
            raise DataError(
                f"the hypotheses refer to frame {max(frames) + 1}, but the tracks have "
                f"{points.shape[1]} frames: the document is damaged, run hypothesize again"
            )
        model = models.of_set(hypotheses)
        points = points[:, frames]
        tracks = np.flatnonzero(np.isfinite(points).all(axis=(1, 2)))
        observed = model.observe(points[tracks], hypotheses.normalization)
        return cls(hypotheses, model, tracks, observed)

    def residuals(self, points: Floats) -> Floats:
        """Residuals [B, n] in pixels of the tracks from motions ``points`` [B, ...]."""
        return self.model.residuals(points, self.observed, self.hypotheses.normalization)

    def fit(self, weights: Floats) -> tuple[Floats, Flags]:
        """Least-squares motions with weights [B, n], and which of them are valid."""
        return self.model.fit(self.observed, weights)

    def ranking_sq_residuals(self) -> Floats:
        """Squared residuals [n, hypotheses] of the tracks, in normalized coordinates."""
        return self.model.ranking_sq_residuals(self.hypotheses.points, self.observed)
