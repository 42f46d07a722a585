"""The split test of incomplete tracks: in windows of frames, over all of them together.

What two rigid bodies predict better than one is measured over all frames, by the affine flats of
incomplete tracks; their noise and least spread are those of a middle window.
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.incomplete_flats import FLAT_DIMENSION, incomplete_flat
from mssegment.records import Floats, Integers
from mssegment.sampling.windows import shortest_length, window_starts
from mssegment.segmentation.consensus.split_test import (
    COMPONENTS,
    MISFIT_FACTORS,
    SplitTest,
    nats_apart,
)

MIN_WINDOW_TRACKS = 20
"""Fewest complete tracks of a window: the noise is measured among their 14 nearest."""
MOST_FREE = COMPONENTS + 2 - FLAT_DIMENSION
"""Directions in which a track says how it moves, as many as the components of complete tracks."""
MIN_GROUP_TRACKS = 5
"""Fewest tracks of either group in a window."""


class WindowedSplitTest:
    """The ratio R of pairs of groups among tracks that are not visible in all frames.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    agreement, distances : ndarray [P, P]
        Coassociation and distance (pixels) of every two tracks.
    single : bool
        Whether the decision is that between one body and several.
    """

    def __init__(
        self, points: Floats, agreement: Floats, distances: Floats, *, single: bool
    ) -> None:
        visible = np.asarray(np.isfinite(points).all(axis=2))
        length = shortest_length(visible)
        self._points, self._frames = points, visible.sum(axis=1)
        self._residuals: dict[bytes, Floats] = {}
        self._windows: list[tuple[Integers, SplitTest]] = []
        for start in window_starts(points.shape[1], length):
            frames = slice(int(start), int(start) + length)
            tracks = np.flatnonzero(visible[:, frames].all(axis=1))
            if len(tracks) < MIN_WINDOW_TRACKS:
                continue
            row = np.full(len(points), -1)
            row[tracks] = np.arange(len(tracks))
            block = np.ix_(tracks, tracks)
            test = SplitTest(
                points[tracks, frames], agreement[block], distances[block], single=single
            )
            self._windows.append((row, test))

    def ratio(self, first: Integers, second: Integers) -> float | None:
        """What a split saves over what it must save, both summed over the windows.

        None where both groups are together in no window.
        """
        saved, price = 0.0, 0.0
        for row, test in self._windows:
            one, two = row[first], row[second]
            one, two = one[one >= 0], two[two >= 0]
            if min(len(one), len(two)) >= MIN_GROUP_TRACKS:
                saved += test.saved(one, two)
                price += test.price(one, two)
        return saved / price if price > 0 else None

    def rigid_evidence(self, first: Integers, second: Integers) -> float:
        """N of two groups, as ``SplitTest.rigid_evidence``; 0 without any window.

        The least spread holds three standard deviations of what a flat leaves of either group
        beyond the noise: perspective, over all frames.
        """
        if not self._windows:
            return 0.0
        both = np.concatenate([first, second])
        free = np.clip(2 * self._frames[both] - FLAT_DIMENSION, 0, MOST_FREE)
        known = free > 0
        apart = np.concatenate([self._own_residuals(first), self._own_residuals(second)])[known]
        together = self._own_residuals(both)[known]
        noise = float(np.median([test.noise for _, test in self._windows]))
        systematic = np.sqrt(max(float(np.median(apart)) ** 2 - noise**2, 0.0))
        misfit = float(np.hypot(noise, MISFIT_FACTORS[True] * systematic))
        least = max(float(np.median([test.rigid_spread for _, test in self._windows])), misfit)
        return nats_apart(apart, together, free[known], noise, least)

    def _own_residuals(self, group: Integers) -> Floats:
        """Of each track of a group [n] from the flat of the others; it needs no window."""
        key = group.tobytes()
        if key not in self._residuals:
            points = self._points[group]
            self._residuals[key] = incomplete_flat(points).own_residuals(points)
        return self._residuals[key]
