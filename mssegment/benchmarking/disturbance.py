"""Outlier tracks that a benchmark adds: mismatches, tracks shuffled in time, resampled ones."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats


def uniform_mismatches(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Tracks [count, F, 2], every position uniform over the box of all positions in its frame."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    return rng.uniform(low, high, (count, *points.shape[1:]))


def shuffled_in_time(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Some of the tracks with the positions where they are seen in another order."""
    tracks = points[rng.integers(len(points), size=count)].copy()
    for track in tracks:
        seen = np.flatnonzero(np.isfinite(track).all(axis=1))
        track[seen] = track[rng.permutation(seen)]
    return tracks


def resampled(tracks: Floats, frames: int) -> Floats:
    """Complete tracks [n, F, 2] over another number of frames, by linear interpolation."""
    place = np.linspace(0, tracks.shape[1] - 1, frames)
    before = np.minimum(place.astype(int), tracks.shape[1] - 2)
    share = (place - before)[:, None]
    return np.asarray(tracks[:, before] * (1 - share) + tracks[:, before + 1] * share)
