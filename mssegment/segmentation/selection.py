"""What a selection is: from the modes of the hypotheses to the motions that are there.

``dominance`` is the paper's (the densest modes before the largest gap), ``mdl`` takes the modes as
candidates for the shortest description of all tracks. A further one is a function from
:class:`Problem` to :class:`Choice` and one line in ``segmentation.SELECTIONS``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

from mssegment.models import Flags, MotionModel
from mssegment.records import Floats, HypothesisSet, Integers, Mode, Record

Granularity = Literal["object", "surface", "auto"]


class ObservedSet(Record, frozen=True):
    """One set of hypotheses with the tracks as its model sees them: ``observed`` [P, F, 2]."""

    hypotheses: HypothesisSet
    model: MotionModel
    observed: Floats

    def residuals(self, points: Floats) -> Floats:
        """Residuals [B, P] in pixels of the tracks from the motions ``points`` [B, ...]."""
        return self.model.residuals(points, self.observed, self.hypotheses.normalization)

    def fit(self, weights: Floats) -> tuple[Floats, Flags]:
        """Least-squares motions under the weights [B, P], and which are sound."""
        return self.model.fit(self.observed, weights)


class SelectionProblem(Record, frozen=True):
    """The tracks to explain and the modes to explain them with.

    ``points`` [P, F, 2] are the complete, eligible tracks in pixels, ``observed_sets`` the sets of
    hypotheses; ``modes``, strongest first, name their set. ``motions`` is the number of motions,
    None where it must be found, then at least ``min_motions``. ``assignments`` holds, per set, the
    mode of each hypothesis (-1: none); ``tracks`` [P] are the numbers that the elemental subsets of
    the hypotheses use for the tracks.
    """

    points: Floats
    observed_sets: tuple[ObservedSet, ...]
    modes: tuple[Mode, ...]
    motions: int | None
    min_motions: int
    granularity: Granularity
    rng: np.random.Generator
    assignments: tuple[Integers, ...]
    tracks: Integers


class SelectedMotion(Record, frozen=True):
    """A motion that a selection found: its point on the manifold of its set, and its inliers.

    ``mode`` is the index of the mode it grew from, ``scale`` the standard deviation of its
    residuals in pixels, ``cost_saved`` in nats where the selection reckons with it. A track may be
    an inlier of two motions: it goes to the one with the smaller residual.
    """

    set_index: int
    point: Floats
    inliers: Flags
    mode: int | None
    scale: float
    cost_saved: float | None = None


class SelectionResult(Record, frozen=True):
    """The motions that a selection found, and what the user should know about it."""

    motions: tuple[SelectedMotion, ...]
    notes: tuple[str, ...] = ()


Selection = Callable[[SelectionProblem], SelectionResult]
