"""Synthetic outlier tracks: uniform mismatches, tracks shuffled in time, resampled tracks."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats


def uniform_mismatches(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Random tracks, uniform over the bounding box of the given tracks.

    Parameters
    ----------
    points : ndarray [P, F, 2] of float64
        The tracks in pixels.
    count : int
        The number of tracks to draw.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    ndarray [count, F, 2] of float64
        In each frame uniform over the bounding box of that frame.
    """
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    return rng.uniform(low, high, (count, *points.shape[1:]))


def shuffled_in_time(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Randomly chosen tracks with their visible positions in random order.

    Parameters
    ----------
    points : ndarray [P, F, 2] of float64
        The tracks in pixels, NaN where a point is not visible.
    count : int
        The number of tracks to draw, with replacement.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    ndarray [count, F, 2] of float64
    """
    tracks = points[rng.integers(len(points), size=count)].copy()
    for track in tracks:
        seen = np.flatnonzero(np.isfinite(track).all(axis=1))
        track[seen] = track[rng.permutation(seen)]
    return tracks


def resampled(tracks: Floats, frames: int) -> Floats:
    """Resample complete tracks [n, F, 2] to ``frames`` frames by linear interpolation."""
    place = np.linspace(0, tracks.shape[1] - 1, frames)
    before = np.minimum(place.astype(int), tracks.shape[1] - 2)
    share = (place - before)[:, None]
    return np.asarray(tracks[:, before] * (1 - share) + tracks[:, before + 1] * share)
