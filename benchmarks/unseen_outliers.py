"""Outlier tracks of several kinds, and tracks without any motion."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Integers

KINDS = ("uniform", "reach", "walk", "shuffled")
REACH = 40.0
"""Pixels in x and y that a mismatch within reach of a tracker is away from where it began."""
JITTER = 30.0
"""Pixels in x and y that jitter about a fixed place reaches."""
STEP = (0.5, 1.5)
"""Standard deviation of a step of a random walk, over the speed of the bodies."""
Picture = tuple[int, int]


def outlier_tracks(
    kind: str,
    count: int,
    inliers: Floats,
    picture: Picture,
    speed: float,
    rng: np.random.Generator,
) -> Floats:
    """Tracks [count, F, 2] of one of ``KINDS``; ``inliers`` [n, F, 2] are the tracks of the bodies.

    ``speed`` in pixels a frame is the scale of the random walks.
    """
    frames = inliers.shape[1]
    if kind == "uniform":
        return uniform(count, frames, picture, rng)
    if kind == "reach":
        return within_reach(count, frames, picture, rng)
    if kind == "walk":
        return random_walks(count, frames, picture, speed, rng)
    if kind == "shuffled":
        return shuffled(inliers, count, rng)
    raise ValueError(f"outliers of kind {kind!r}; expected one of {', '.join(KINDS)}")


def uniform(count: int, frames: int, picture: Picture, rng: np.random.Generator) -> Floats:
    """Tracks [count, F, 2] whose positions are uniform over the picture, each by itself."""
    return rng.uniform(0, np.array(picture) - 1.0, (count, frames, 2))


def within_reach(count: int, frames: int, picture: Picture, rng: np.random.Generator) -> Floats:
    """Tracks that begin anywhere; every later position lies within ``REACH`` of the first."""
    tracks = np.repeat(uniform(count, 1, picture, rng), frames, axis=1)
    tracks[:, 1:] += rng.uniform(-REACH, REACH, (count, frames - 1, 2))
    return tracks


def jitter(count: int, frames: int, picture: Picture, rng: np.random.Generator) -> Floats:
    """Tracks about fixed places: every position lies within ``JITTER`` of its place."""
    places = uniform(count, 1, picture, rng)
    return places + rng.uniform(-JITTER, JITTER, (count, frames, 2))


def random_walks(
    count: int, frames: int, picture: Picture, speed: float, rng: np.random.Generator
) -> Floats:
    """Tracks that begin anywhere and go on by independent normal steps, each track at its pace."""
    steps = rng.normal(0, speed, (count, frames, 2)) * rng.uniform(*STEP, (count, 1, 1))
    steps[:, :1] = uniform(count, 1, picture, rng)
    return np.asarray(np.cumsum(steps, axis=1))


def independent_paths(
    count: int, frames: int, picture: Picture, speed: float, rng: np.random.Generator
) -> Floats:
    """Tracks that begin anywhere, each with a velocity and an acceleration of its own."""
    time = np.arange(frames)[:, None]
    velocity = rng.normal(0, speed, (count, 1, 2))
    bend = rng.normal(0, speed / frames, (count, 1, 2))
    start = uniform(count, 1, picture, rng)
    return np.asarray(start + velocity * time + 0.5 * bend * time**2)


def shuffled(tracks: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Some of the complete tracks [n, F, 2] with their positions in another order in time.

    Of two frames the second positions are those of other tracks: in exchanged order the tracks
    of a body would be a motion again.
    """
    chosen = rng.integers(len(tracks), size=count)
    if tracks.shape[1] == 2:
        other = (chosen + rng.integers(1, max(len(tracks), 2), count)) % len(tracks)
        return np.stack([tracks[chosen, 0], tracks[other, 1]], axis=1)
    frames = tracks.shape[1]
    orders = [_another_order(frames, rng) for _ in range(count)]
    return np.asarray(tracks[chosen[:, None], np.reshape(orders, (count, frames)).astype(int)])


def _another_order(frames: int, rng: np.random.Generator) -> Integers:
    """A random order of three or more frames that is neither the usual one nor its reverse."""
    order = np.arange(frames)
    while True:
        found = rng.permutation(frames)
        if (found != order).any() and (found[::-1] != order).any():
            return found
