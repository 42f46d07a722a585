"""What a selection is: from the modes of the hypotheses to the motions that are there.

``dominance`` is the paper's (the densest modes before the largest gap), ``mdl`` takes the modes as
candidates for the shortest description of all tracks. A further one is a function from
:class:`SelectionProblem` to :class:`SelectionResult` and one line in ``segmentation.SELECTIONS``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Mode, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.options import SegmentOptions


class SelectionProblem(Record, frozen=True):
    """The tracks to explain and the modes to explain them with.

    ``points`` [P, F, 2] are the complete, eligible tracks in pixels, ``observed_sets`` the sets of
    hypotheses; ``modes``, strongest first, name their set. ``assignments`` holds, per set, the mode
    of each hypothesis (-1: none); ``tracks`` [P] are the numbers that the elemental subsets of the
    hypotheses use for the tracks.
    """

    points: Floats
    observed_sets: tuple[ObservedSet, ...]
    modes: tuple[Mode, ...]
    options: SegmentOptions
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
