"""The a-contrario test of tracks that are not visible in all frames: in windows of frames.

Chimeras and random walks (``sampling.chimeras``) are made of complete tracks. A window is a few
frames; the tracks that are visible in all of them are tested there, and a track is meaningful if it
is in any of its windows, whose number counts as tests.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.sampling.chimeras import log_false_alarms

SHORT_SHARE = 0.1
"""Windows are so short that all but this share of the tracks are certain to fill one."""
SHORTEST_WINDOW = 3
"""Frames; between two frames alone most displacements look like those of some motion."""
MIN_WINDOW_TRACKS = 15
"""Fewest tracks that a window is tested with: fewer have no neighbours to be compared with."""


def log_false_alarms_in_windows(
    points: Floats, eligible: Flags, rng: np.random.Generator
) -> Floats:
    """Logarithm of the expected number of false alarms of each track.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Tracks in pixels, NaN where a point is not visible.
    eligible : ndarray [P] of bool
        Tracks to be tested.
    rng : numpy.random.Generator
        Draws the flats and the samples of the null hypotheses.

    Returns
    -------
    ndarray [P]
        Nats; below 0 the track is meaningful. NaN for tracks that fill no window.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2)) & eligible[:, None]
    least = np.full(len(points), np.inf)
    windows = np.zeros(len(points))
    length = window_length(visible)
    for start in window_starts(points.shape[1], length):
        frames = slice(int(start), int(start) + length)
        tracks = np.flatnonzero(visible[:, frames].all(axis=1))
        if len(tracks) >= MIN_WINDOW_TRACKS:
            found = log_false_alarms(points[tracks, frames], rng)
            least[tracks] = np.minimum(least[tracks], found)
            windows[tracks] += 1
    return np.where(windows > 0, least + np.log(np.maximum(windows, 1)), np.nan)


def window_length(visible: Flags) -> int:
    """Frames of a window, from the lengths of the tracks [P, F].

    A contiguous track of 2 w - 1 frames holds one of the windows of w frames that lie side by side.
    """
    short = (shortest_length(visible) + 1) // 2
    return min(max(SHORTEST_WINDOW, short), int(visible.shape[1]))


def shortest_length(visible: Flags) -> int:
    """Frames of all but the ``SHORT_SHARE`` shortest of the tracks [P, F]."""
    lengths = visible.sum(axis=1)
    short = int(np.quantile(lengths[lengths > 0], SHORT_SHARE)) if lengths.any() else 0
    return min(max(SHORTEST_WINDOW, short), int(visible.shape[1]))


def window_starts(frames: int, length: int) -> Integers:
    """First frames of windows side by side; the last one ends with the last frame."""
    return np.asarray(
        np.unique(np.append(np.arange(0, frames - length + 1, length), frames - length))
    )
