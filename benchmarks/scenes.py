"""Synthetic tracks like the paper's three experiments, without pictures.

Bodies of 80-160 px that do not overlap in the first frame, points uniform on them, noise on every
position; outliers have all their positions independently uniform over the bounding box of the
bodies in all frames. Nobody chooses easy scenes: everything is drawn from the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm

from mssegment import models
from mssegment.records import Camera, Floats, Integers, Normalization

WIDTH, HEIGHT = 640, 480
NOISE = 0.5
CAMERA = Camera(800.0, 800.0, WIDTH / 2, HEIGHT / 2)
WITHIN = 2.5
"""The oracle's limit: so many sigmas of a one-dimensional residual, and the same probability for
residuals of more dimensions."""


@dataclass(frozen=True)
class SetUp:
    """One of the paper's experiments: the model, the sizes, and how the bodies move."""

    name: str
    model: str
    inliers: tuple[int, ...]
    outliers: int
    hypotheses: int
    frames: int
    move: Callable[[np.random.Generator, Floats], Floats]
    """Points of one body in frame 1 [n, 2] to its exact tracks [n, F, 2]."""


@dataclass(frozen=True)
class Scene:
    """Tracks [P, F, 2] in random order, true labels, and the same tracks without noise."""

    points: Floats
    labels: Integers
    exact: Floats


def generate(setup: SetUp, seed: int) -> Scene:
    """The scene number ``seed`` of a set-up."""
    rng = np.random.default_rng(seed)
    boxes = _separate_boxes(rng, len(setup.inliers))
    bodies = [
        setup.move(rng, rng.uniform(box[:2], box[2:], (n, 2)))
        for box, n in zip(boxes, setup.inliers, strict=True)
    ]
    everything = np.concatenate([body.reshape(-1, 2) for body in bodies])
    low, high = everything.min(axis=0), everything.max(axis=0)
    outliers = rng.uniform(low, high, (setup.outliers, setup.frames, 2))
    exact = np.concatenate([*bodies, outliers])
    sizes = [*setup.inliers, setup.outliers]
    labels = np.repeat([*range(1, len(setup.inliers) + 1), 0], sizes).astype(np.int64)
    order = rng.permutation(len(exact))
    noisy = exact + rng.normal(0.0, NOISE, exact.shape)
    return Scene(noisy[order], labels[order], exact[order])


def oracle(setup: SetUp, scene: Scene) -> Integers:
    """Labels by the true motions: every track to the nearest one within 2.5 sigma."""
    model = models.make(setup.model, frames=setup.frames)
    normalization = model.normalization(scene.points, CAMERA)
    weights = np.stack(
        [(scene.labels == j).astype(float) for j in range(1, len(setup.inliers) + 1)]
    )
    true, valid = model.fit(model.observe(scene.exact, normalization), weights)
    if not valid.all():
        raise RuntimeError(f"{setup.name}: a true motion is degenerate")
    distance = model.residuals(true, model.observe(scene.points, normalization), normalization)
    limit = float(np.sqrt(chi2.isf(2 * norm.sf(WITHIN), model.residual_dimension)))
    limit *= residual_sigma(setup, normalization) / np.sqrt(model.residual_terms)
    nearest = distance.argmin(axis=0)
    return np.where(distance.min(axis=0) <= limit, nearest + 1, 0).astype(np.int64)


def residual_sigma(setup: SetUp, normalization: Normalization) -> float:
    """Standard deviation of a residual's coordinate; a transfer error has two views' noise."""
    del normalization
    return NOISE * float(np.sqrt(2.0)) if setup.model == "affine" else NOISE


def _separate_boxes(rng: np.random.Generator, count: int) -> Floats:
    """``count`` boxes (x0, y0, x1, y1) inside the picture, none overlapping another."""
    boxes: list[Floats] = []
    while len(boxes) < count:
        size = rng.uniform(80.0, 160.0, 2)
        corner = rng.uniform(0.0, 1.0, 2) * (np.array([WIDTH, HEIGHT]) - size)
        box = np.concatenate([corner, corner + size])
        if all((box[2:] < b[:2]).any() or (b[2:] < box[:2]).any() for b in boxes):
            boxes.append(box)
    return np.stack(boxes)


def translate_in_space(rng: np.random.Generator, first: Floats) -> Floats:
    """A body 3-6 units away and 0.3 deep, translated so that it moves 10-40 px on average."""
    depth = rng.uniform(3.0, 6.0) + rng.uniform(-0.15, 0.15, len(first))
    rays = np.column_stack([(first - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx, np.ones(len(first))])
    space, wanted = rays * depth[:, None], rng.uniform(10.0, 40.0)
    while True:
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        low, high = 0.0, 1.5
        for _ in range(50):
            middle = (low + high) / 2
            second = _project(space + middle * direction)
            if np.linalg.norm(second - first, axis=1).mean() < wanted:
                low = middle
            else:
                high = middle
        # a direction along the line of sight may not move the body far enough
        if high < 1.5:
            return np.stack([first, second], axis=1)


def move_in_plane(steps: int, least: float, most: float) -> Callable[..., Floats]:
    """Planar motion: per step up to 5 degrees, scale 0.95-1.05, shift ``least``-``most`` px."""

    def move(rng: np.random.Generator, first: Floats) -> Floats:
        frames = [first]
        for _ in range(steps):
            angle, scale = np.deg2rad(rng.uniform(-5.0, 5.0)), rng.uniform(0.95, 1.05)
            heading, length = rng.uniform(0.0, 2 * np.pi), rng.uniform(least, most)
            turn = scale * np.array(
                [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
            )
            centre = frames[-1].mean(axis=0)
            shift = length * np.array([np.cos(heading), np.sin(heading)])
            frames.append((frames[-1] - centre) @ turn.T + centre + shift)
        return np.stack(frames, axis=1)

    return move


def _project(space: Floats) -> Floats:
    return np.asarray(CAMERA.fx * space[:, :2] / space[:, 2:] + [CAMERA.cx, CAMERA.cy])


SETUPS = {
    "fig2": SetUp("fig2", "translation", (27, 26, 26), 23, 500, 2, translate_in_space),
    "fig3": SetUp("fig3", "factorization", (32, 21, 29), 58, 1000, 5, move_in_plane(4, 0.0, 15.0)),
    "fig4": SetUp("fig4", "affine", (16, 18, 16), 30, 500, 2, move_in_plane(1, 10.0, 40.0)),
}
"""Fig. 2, Fig. 3 and Fig. 4 of the paper."""
