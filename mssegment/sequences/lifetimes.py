"""Windows of a sequence, as long as its tracks last.

A window must be long, because motions differ by displacements that grow with time, and short,
because tracks end. Let tracks end at the rate lambda per frame. Over L frames the squared
displacement grows as L^2 and the share of tracks that last falls as exp(-lambda L); the product is
largest where lambda L = 2. Neighbouring windows overlap by the time in which half of the tracks
end, lambda L = ln 2: what is visible that long lies in one window as a whole.

The rate is that of the tracks that have moved. Those of a static background last for ever, but they
are not what is segmented.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from mssegment.records import Floats, Record

WINDOW_ENDINGS = 2.0
"""Integrated rate of endings over a window, lambda L."""
OVERLAP_ENDINGS = math.log(2)
"""The same over the overlap of two windows: half of the tracks."""
SHORTEST_WINDOW = 12
"""Frames; below, a displacement of a pixel a frame hardly exceeds that of a static track."""
ONE_WINDOW = 100
"""Frames; a sequence of at most as many is one window."""
LONGEST_WINDOW = 50
"""Frames of a window of longer sequences: objects stop, turn and meet within it."""
LEAST_MOVED = 10
"""Tracks that have moved, from which on their rate of endings is estimated."""
MOVED = 2.0
"""Pixels from its start beyond which a track has moved, as in ``preprocessing.background``."""


class WindowLimits(Record, frozen=True):
    """How long windows are.

    Attributes
    ----------
    length : int or "auto"
        Frames of a window; ``auto``: from the rate at which tracks end.
    overlap : int or "auto"
        Frames that neighbouring windows share, at most half of a window.
    """

    length: int | Literal["auto"] = "auto"
    overlap: int | Literal["auto"] = "auto"

    def is_one_window(self, frames: int) -> bool:
        """Whether a sequence of so many frames is a single window."""
        return frames <= (ONE_WINDOW if self.length == "auto" else self.length)

    def is_full(self, rates: Floats) -> bool:
        """Whether the frames of a window suffice.

        Parameters
        ----------
        rates : ndarray [n - 1]
            The rate of endings from each frame of the window to the next one.
        """
        frames = len(rates) + 1
        if self.length != "auto":
            return frames >= self.length
        if frames < SHORTEST_WINDOW:
            return False
        return frames >= LONGEST_WINDOW or float(rates.sum()) >= WINDOW_ENDINGS

    def shared(self, rates: Floats) -> int:
        """Frames of a full window that the next one shares, given the ``rates`` within it."""
        half = (len(rates) + 1) // 2
        if self.overlap != "auto":
            return min(self.overlap, half)
        endings = np.cumsum(rates[::-1])
        return min(int(np.searchsorted(endings, OVERLAP_ENDINGS)) + 1, half)


def rate_of_endings(moved: int, ended: int) -> float:
    """The share of the tracks that have moved, visible in a frame, that end there.

    Examples
    --------
    >>> rate_of_endings(moved=50, ended=5)
    0.1
    >>> rate_of_endings(moved=3, ended=1)  # too few to tell
    0.0
    """
    return ended / moved if moved >= LEAST_MOVED else 0.0


def rates_of_endings(points: Floats) -> Floats:
    """The rates [F - 1] of tracks [P, F, 2], from each frame to the next."""
    visible = np.asarray(np.isfinite(points).all(axis=2))
    start = points[np.arange(len(points)), visible.argmax(axis=1)]
    with np.errstate(invalid="ignore"):
        moved = visible & (np.linalg.norm(points - start[:, None], axis=2) > MOVED)
    ended = (moved[:, :-1] & ~visible[:, 1:]).sum(axis=0)
    counts = moved[:, :-1].sum(axis=0)
    return np.array([rate_of_endings(int(n), int(k)) for n, k in zip(counts, ended, strict=True)])


def plan_windows(points: Floats, limits: WindowLimits) -> list[tuple[int, int]]:
    """The first frame of each window and the frame after its last one.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    limits : WindowLimits
        How long windows are.

    Returns
    -------
    list of (int, int)
        They cover all frames; only the last one may be shorter than the limits say.
    """
    frames = points.shape[1]
    if limits.is_one_window(frames):
        return [(0, frames)]
    rates, windows, start = rates_of_endings(points), [], 0
    while True:
        stop = start + 1
        while stop < frames and not limits.is_full(rates[start : stop - 1]):
            stop += 1
        windows.append((start, stop))
        if stop == frames:
            return windows
        start = stop - limits.shared(rates[start : stop - 1])
