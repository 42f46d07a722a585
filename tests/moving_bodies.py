"""Synthetic long sequences for the tests."""

from __future__ import annotations

import numpy as np


def rigid_bodies(
    rng: np.random.Generator, sizes=(80, 60, 40), frames: int = 20, noise: float = 0.15
):
    """Boxes of points that rotate and translate under an affine camera, and their labels."""
    points, labels = [], []
    for label, size in enumerate(sizes, start=1):
        body = rng.uniform(-1, 1, (size, 3)) * (60, 60, 30)
        place = np.array([150.0 * label, 120.0 + 90 * (label % 2)])
        speed, spin = rng.uniform(-3, 3, 2), rng.uniform(-0.03, 0.03, 3)
        for_frames = []
        for frame in range(frames):
            a, b, c = spin * frame
            turn_z = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
            turn_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
            turn_x = np.array([[1, 0, 0], [0, np.cos(c), -np.sin(c)], [0, np.sin(c), np.cos(c)]])
            seen = body @ (turn_z @ turn_y @ turn_x).T
            for_frames.append(seen[:, :2] + place + speed * frame)
        points.append(np.stack(for_frames, axis=1))
        labels += [label] * size
    tracks = np.concatenate(points)
    return tracks + rng.normal(0, noise, tracks.shape), np.array(labels)


def perspective_tracks(rng: np.random.Generator, tracks: int, frames: int):
    """A static scene with depth before a camera that translates and turns, without noise."""
    depth = rng.uniform(1.0, 3.0, tracks)
    rays = np.column_stack([rng.uniform(-0.4, 0.4, (tracks, 2)), np.ones(tracks)])
    scene = rays * depth[:, None]
    velocity, spin = rng.uniform(-1, 1, 3) * (0.03, 0.03, 0.04), rng.uniform(-0.004, 0.004, 3)
    cross = np.array([[0, -spin[2], spin[1]], [spin[2], 0, -spin[0]], [-spin[1], spin[0], 0]])
    seen = []
    for frame in range(frames):
        here = scene @ (np.eye(3) + frame * cross + 0.5 * (frame * cross) @ (frame * cross)).T
        here = here + frame * 10 / frames * velocity
        seen.append(600 * here[:, :2] / here[:, 2:] + (320, 240))
    return np.stack(seen, axis=1)
