"""The split test of incomplete tracks: in windows of frames, over all of them together."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Integers
from mssegment.sampling.windows import shortest_length, window_starts
from mssegment.segmentation.consensus.split_test import SplitTest

MIN_WINDOW_TRACKS = 20
"""Fewest complete tracks of a window: the noise is measured among their 14 nearest."""
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
