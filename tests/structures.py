"""Data that is no picture, with structures that are known."""

from __future__ import annotations

import numpy as np


def hyperplanes(rng, count=3, dimension=2, per=60, outliers=60, noise=0.01):
    """Points of random hyperplanes in the cube from -1 to 1, and uniform outliers, with labels."""
    points, labels = [], []
    for k in range(count):
        normal = rng.standard_normal(dimension)
        normal /= np.linalg.norm(normal)
        offset = rng.uniform(-0.3, 0.3)
        own = np.zeros((0, dimension))
        while len(own) < per:
            x = rng.uniform(-1.0, 1.0, (1000, dimension))
            x -= (x @ normal - offset)[:, None] * normal
            own = np.concatenate([own, x[(np.abs(x) <= 1.0).all(axis=1)]])
        points.append(own[:per] + noise * rng.standard_normal((per, 1)) * normal)
        labels += [k + 1] * per
    points.append(rng.uniform(-1.0, 1.0, (outliers, dimension)))
    return _shuffled(rng, np.concatenate(points), np.array(labels + [0] * outliers))


def subspaces(rng, count=3, dimension=6, rank=2, per=50, outliers=100, noise=0.02):
    """Vectors of random subspaces, and outliers."""
    points, labels = [], []
    for k in range(count):
        basis, _ = np.linalg.qr(rng.standard_normal((dimension, rank)))
        own = rng.uniform(-1.5, 1.5, (per, rank)) @ basis.T
        points.append(own + noise * rng.standard_normal(own.shape))
        labels += [k + 1] * per
    points.append(rng.uniform(-1.0, 1.0, (outliers, dimension)))
    return _shuffled(rng, np.concatenate(points), np.array(labels + [0] * outliers))


def spheres(rng, per=150, outliers=100, noise=0.01):
    """Points of two spheres, and outliers."""
    points, labels = [], []
    for k, centre in enumerate(([-0.5, 0.0, 0.2], [0.6, 0.3, -0.2])):
        on_it = rng.standard_normal((per, 3))
        on_it /= np.linalg.norm(on_it, axis=1, keepdims=True)
        points.append(centre + 0.45 * on_it + noise * rng.standard_normal((per, 3)))
        labels += [k + 1] * per
    points.append(rng.uniform(-1.0, 1.0, (outliers, 3)))
    return _shuffled(rng, np.concatenate(points), np.array(labels + [0] * outliers))


def bodies(rng, count=3, per=40, outliers=80, noise=0.01):
    """Matched points [P, 2, 3] of bodies that turn and move, and mismatches."""
    points, labels = [], []
    for k in range(count):
        centre = rng.uniform(-2.0, 2.0, 3)
        first = rng.uniform(-0.6, 0.6, (per, 3))
        turn, _ = np.linalg.qr(np.eye(3) + 0.3 * rng.standard_normal((3, 3)))
        turn = turn * np.sign(np.linalg.det(turn))
        second = first @ turn.T + rng.normal(0.0, 0.5, 3)
        pair = centre + np.stack([first, second], axis=1)
        points.append(pair + noise * rng.standard_normal(pair.shape))
        labels += [k + 1] * per
    points.append(rng.uniform(-2.5, 2.5, (outliers, 2, 3)))
    return _shuffled(rng, np.concatenate(points), np.array(labels + [0] * outliers))


def _shuffled(rng, points, labels):
    order = rng.permutation(len(points))
    return points[order], labels[order]
