"""The frames of a finished clip, one after the other: which objects each shows, and where."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from mssegment.clips.store import ClipStore
from mssegment.documents.clips import WindowTracks
from mssegment.records import Floats, Integers, Record


class ClipFrame(Record, frozen=True):
    """The tracks in one frame of a clip.

    Attributes
    ----------
    number : int
        The frame, counted in the clip from 0.
    tracks : ndarray [n] of int64
        The numbers of the tracks.
    identities : ndarray [n] of int64
        Their objects; 0 the static world, -1 none.
    points : ndarray [n, 2]
        Their positions in pixels.
    resting : frozenset of int
        The objects that stand still.
    """

    number: int
    tracks: Integers
    identities: Integers
    points: Floats
    resting: frozenset[int] = frozenset()


def frames_of(store: ClipStore, windows: int) -> Iterator[ClipFrame]:
    """All frames of the first windows of a clip, with the memory of one window."""
    for document, tracks in store.windows(windows):
        resting = frozenset(document.resting)
        for number, rows, points in _by_frame(tracks, document.start, document.own_stop):
            yield ClipFrame(
                number, tracks.track[rows], tracks.identity[rows], points.astype(float), resting
            )


def _by_frame(
    tracks: WindowTracks, start: int, stop: int
) -> Iterator[tuple[int, Integers, Floats]]:
    """Frame number, rows of the runs, and positions, for each frame."""
    rows, frames = tracks.spread()
    order = np.argsort(frames, kind="stable")
    edges = np.searchsorted(frames[order], np.arange(start, stop + 1))
    for number, (first, last) in enumerate(pairwise(edges), start):
        own = order[first:last]
        yield number, rows[own], np.asarray(tracks.points[own], np.float64)
