"""Tracks of bodies that enter, stop and leave before a static camera, as a tracker gives them."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats, Integers

SIZE = (640, 480)


def passing_bodies(
    rng: np.random.Generator, frames: int = 300, life: int = 60
) -> tuple[Floats, Integers]:
    """Tracks [P, F, 2] that last for about ``life`` frames, and the body of each; 0 the wall.

    Body 1 crosses the picture, 2 enters, stops for a while and leaves, 3 comes late.
    """
    time = np.arange(frames)
    stops = np.clip(time, 0, frames // 3) + np.clip(time - frames // 3 - 30, 0, None)
    paths = [
        np.column_stack([40 + 1.8 * time, np.full(frames, 90.0)]),
        np.column_stack([600 - 2.6 * stops, np.full(frames, 240.0)]),
        np.column_stack([-100 + 3.0 * (time - frames / 2), 380 + 0.1 * time]),
    ]
    points, bodies = [], []
    for number, path in enumerate(paths, start=1):
        for _ in range(24 * frames // life):
            place = rng.uniform(-35, 35, 2)
            points.append(_seen(rng, path + place, int(rng.integers(-life, frames)), life))
            bodies.append(number)
    for _ in range(120):
        points.append(np.tile(rng.uniform((0, 0), SIZE), (frames, 1)))
        bodies.append(0)
    tracks = np.array(points) + rng.normal(0, 0.15, (len(points), frames, 2))
    inside = ((tracks >= 0) & (tracks < SIZE)).all(axis=2)
    tracks[~inside] = np.nan
    seen = inside.sum(axis=1) >= 3
    return tracks[seen], np.array(bodies)[seen]


def _seen(rng: np.random.Generator, path: Floats, start: int, life: int) -> Floats:
    """A path, visible for about ``life`` frames from ``start`` on."""
    shown = np.full_like(path, np.nan)
    stop = start + int(rng.integers(life // 2, 3 * life // 2))
    shown[max(start, 0) : stop] = path[max(start, 0) : stop]
    return shown
