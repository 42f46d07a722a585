"""The interface of a selection: from the modes of the hypotheses to motions.

``dominance`` is that of the paper: the densest modes before the largest gap. ``mdl`` uses the modes
as candidates for the shortest description of all tracks. To add one, write a function from
:class:`SelectionProblem` to :class:`SelectionResult` and register it in
``segmentation.SELECTIONS``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Mode, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.options import SegmentOptions


class SelectionProblem(Record, frozen=True):
    """The tracks to explain, and the modes to explain them with.

    Attributes
    ----------
    points : ndarray [P, F, 2]
        Complete, eligible tracks in pixels.
    observed_sets : tuple of ObservedSet
        The sets of hypotheses.
    modes : tuple of Mode
        The modes of all sets, densest first.
    options : SegmentOptions
        The settings.
    rng : numpy.random.Generator
        Source of random numbers.
    assignments : tuple of ndarray of int
        For each set, the index of the mode that each hypothesis converges to; -1 for none.
    tracks : ndarray [P] of int
        Index of each track in the elemental subsets of the hypotheses.
    static_camera : bool
        Whether a static background was removed, so that nothing else is static.
    noise : float
        Noise of two views in pixels (``preprocessing.noise``); NaN for more views.
    """

    points: Floats
    observed_sets: tuple[ObservedSet, ...]
    modes: tuple[Mode, ...]
    options: SegmentOptions
    rng: np.random.Generator
    assignments: tuple[Integers, ...]
    tracks: Integers
    static_camera: bool = False
    noise: float = float("nan")


class SelectedMotion(Record, frozen=True):
    """A motion that a selection found.

    Attributes
    ----------
    set_index : int
        Index of its set of hypotheses.
    point : ndarray
        The motion, a point on the manifold of the set.
    inliers : ndarray [P] of bool
        Its tracks. A track may be an inlier of two motions; it goes to the nearer one.
    mode : int, optional
        Index of the mode from which it was refitted.
    scale : float
        Standard deviation of the residuals in pixels.
    cost_saved : float, optional
        Description length saved in nats, if the selection computes it.
    """

    set_index: int
    point: Floats
    inliers: Flags
    mode: int | None
    scale: float
    cost_saved: float | None = None


class Body(Record, frozen=True):
    """Motions that are one rigid body.

    ``members`` are their indices, the largest motion first; ``evidence`` is in nats, None for a
    single motion.
    """

    members: tuple[int, ...]
    evidence: float | None = None


class SelectionResult(Record, frozen=True):
    """The motions that a selection found, and notes for the user.

    ``bodies`` says which of the motions are one; by default each is a body of its own. Motions that
    are ``refitted`` are most likely ones, which a fit to the tracks that they win would bias.
    """

    motions: tuple[SelectedMotion, ...]
    notes: tuple[str, ...] = ()
    bodies: tuple[Body, ...] | None = None
    refitted: bool = False


Selection = Callable[[SelectionProblem], SelectionResult]
