"""Two rendered pictures of a scene that is static, but for one body at most.

The scene consists of textured planes in space: layers at several depths, or a facade with windows
that repeat. A camera is moved sideways, as pictures for stereo are rectified, or held in the hand.
"""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

import mssegment
from benchmarks.unseen_bodies import rotation
from benchmarks.unseen_rows import Case, Outcome, Plan, judged
from mssegment.evaluation import misclassification
from mssegment.records import Floats, Integers

Rng = np.random.Generator
Picture = npt.NDArray[np.uint8]
WIDTH, HEIGHT = 640, 480
FOCAL = 700.0
INNER = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1.0]])
GRAINS = (3.0, 7.0, 16.0, 40.0)
"""Sizes in pixels of the grains of a texture."""
RIGHT_MATCH = 2.0
"""Pixels up to which a match is one of its layer."""
GREY_NOISE = 2.0
"""Grey levels of the noise of a picture."""
BODY = 2
"""The label of a body that moves by itself."""
LEAST_BODY = 15
"""Right matches on a body; with fewer it is hidden, and no motion."""


@dataclass(frozen=True)
class Layer:
    """A plane with a picture on it: centre and axes [3] in space for one pixel of the picture.

    ``moved`` [3] is how far the layer moves between the two pictures.
    """

    picture: npt.NDArray[np.float32]
    mask: npt.NDArray[np.float32]
    centre: Floats
    axes: Floats
    moved: Floats

    def homography(self, turn: Floats, shift: Floats, second: bool) -> Floats:
        """The map [3, 3] from pixels of the layer to those of a camera with this pose."""
        middle = (np.array(self.mask.shape[::-1]) - 1) / 2
        origin = self.centre - middle @ self.axes + (self.moved if second else 0.0)
        columns = np.stack([turn @ self.axes[0], turn @ self.axes[1], turn @ origin + shift], 1)
        return np.asarray(INNER @ columns)


@dataclass(frozen=True)
class RenderedPair:
    """Two pictures, the layer [height, width] that each pixel of the first shows, and its maps.

    ``maps`` [L, 3, 3] are the homographies of the layers between the pictures; the last layer is a
    body if ``moving``.
    """

    pictures: tuple[Picture, Picture]
    layers: Integers
    maps: Floats
    moving: bool

    def truth(self, points: Floats) -> Integers:
        """Labels [P] of matches [P, 2, 2]: 1 the static scene, 2 the body, 0 a wrong match."""
        x, y = np.clip(np.rint(points[:, 0]).astype(int), 0, [WIDTH - 1, HEIGHT - 1]).T
        layer = self.layers[y, x]
        rays = np.concatenate([points[:, 0], np.ones((len(points), 1))], axis=1)
        mapped = np.einsum("nij,nj->ni", self.maps[layer], rays)
        error = np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - points[:, 1], axis=1)
        body = self.moving & (layer == len(self.maps) - 1)
        return np.asarray(np.where(error < RIGHT_MATCH, np.where(body, BODY, 1), 0))


def texture(rng: Rng, width: int, height: int) -> npt.NDArray[np.float32]:
    """A random picture with grains of several sizes, some of them stronger than others."""
    drawn = np.zeros((height, width), np.float32)
    for grain in GRAINS:
        small = rng.normal(0, 1, (int(height / grain) + 3, int(width / grain) + 3))
        size = (int(small.shape[1] * grain), int(small.shape[0] * grain))
        large = cv2.resize(small.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
        drawn += np.float32(rng.uniform(0.3, 1.0)) * large[:height, :width]
    drawn *= np.float32(rng.uniform(15, 45) / drawn.std())
    return np.asarray(drawn + np.float32(rng.uniform(80, 170)), np.float32)


def windows(rng: Rng, width: int, height: int) -> npt.NDArray[np.float32]:
    """A wall of weak texture with rows of windows that are all alike."""
    wall = texture(rng, width, height)
    wall = (wall - wall.mean()) * np.float32(rng.uniform(0.05, 0.3)) + np.float32(150)
    step = rng.integers([45, 60], [90, 110])
    size = (step * rng.uniform(0.4, 0.7, 2)).astype(int)
    window = texture(rng, int(size[0]), int(size[1])) - np.float32(60)
    cv2.rectangle(window, (0, 0), (int(size[0]) - 1, int(size[1]) - 1), 230.0, 3)
    cv2.line(window, (int(size[0]) // 2, 0), (int(size[0]) // 2, int(size[1])), 220.0, 2)
    cv2.line(window, (0, int(size[1]) // 3), (int(size[0]), int(size[1]) // 3), 220.0, 2)
    own = np.float32(rng.uniform(0, 6))
    for y in range(10, height - size[1], step[1]):
        for x in range(10, width - size[0], step[0]):
            light = rng.normal(0, 1, (size[1], size[0])).astype(np.float32) * own
            wall[y : y + size[1], x : x + size[0]] = window + light
    return wall


def _layer(
    rng: Rng, place: Floats, depth: float, size: tuple[int, int], tilt: float, drawn: Any = texture
) -> Layer:
    """A plane at a place [2] in the first picture, slanted by at most ``tilt`` radians."""
    rays = (place - [WIDTH / 2, HEIGHT / 2]) / FOCAL
    centre = np.append(rays, 1.0) * depth
    spin = np.append(rng.uniform(-tilt, tilt, 2), 0.0)
    axes = (rotation(spin) @ np.eye(3)).T[:2] * depth / FOCAL
    return Layer(
        drawn(rng, *size), np.ones(size[::-1], np.float32), centre, np.asarray(axes), np.zeros(3)
    )


def _piece(rng: Rng, depth: float, tilt: float) -> Layer:
    """An ellipse or a rectangle somewhere in the picture."""
    size = tuple(int(n) for n in rng.integers(90, 230, 2))
    place = rng.uniform([60, 60], [WIDTH - 60, HEIGHT - 60])
    layer = _layer(rng, place, depth, (size[0], size[1]), tilt)
    if rng.random() < 0.6:
        layer.mask[:] = 0.0
        cv2.ellipse(
            layer.mask, (size[0] // 2, size[1] // 2), (size[0] // 2, size[1] // 2), 0, 0, 360, 1, -1
        )
    return layer


def _layered(rng: Rng) -> tuple[list[Layer], float]:
    """A wall, perhaps a floor, and two to five pieces before it; the middle depth."""
    far = 10.0
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    layers = [_layer(rng, middle, far, (1300, 1000), 0.3)]
    depths = np.sort(far * rng.uniform(0.35, 0.9, rng.integers(2, 6)))[::-1]
    return layers + [_piece(rng, depth, 0.4) for depth in depths], 7.0


def _facade(rng: Rng) -> tuple[list[Layer], float]:
    """A facade with windows, a wing beside it that is farther away, a street, and a piece."""
    far = 10.0
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    layers = [_layer(rng, middle, 1.3 * far, (1500, 1000), 0.1)]
    wing = np.array([rng.choice([0.15, 0.85]) * WIDTH, 0.4 * HEIGHT])
    layers.append(_layer(rng, wing, far * rng.uniform(1.05, 1.25), (500, 420), 0.1, windows))
    wall = rng.uniform([0.4, 0.35], [0.6, 0.45]) * [WIDTH, HEIGHT]
    layers.append(_layer(rng, wall, far, (420, 400), 0.35, windows))
    street = _layer(rng, np.array([WIDTH / 2, 1.1 * HEIGHT]), 0.7 * far, (1400, 500), 0.0)
    axes = (rotation(np.array([-1.2, 0, 0])) @ np.eye(3)).T[:2] * 0.7 * far / FOCAL
    layers.append(Layer(street.picture, street.mask, street.centre, np.asarray(axes), street.moved))
    if rng.random() < 0.5:
        layers.append(_piece(rng, 0.7 * far, 0.2))
    return layers, far


def _rectified(rng: Rng, depth: float) -> tuple[Floats, Floats]:
    """A camera that is moved sideways: 8 to 50 pixels at this depth."""
    side = -rng.uniform(8, 50) * depth / FOCAL
    return np.eye(3), np.array([side, 0.0, 0.0])


def _hand_held(rng: Rng, depth: float) -> tuple[Floats, Floats]:
    """A camera that is moved by 10 to 60 pixels at this depth, and turned by up to 4 degrees."""
    towards = rng.normal(size=3) * [1.0, 0.5, 0.5]
    shift = towards / np.linalg.norm(towards) * rng.uniform(10, 60) * depth / FOCAL
    spin = rng.normal(size=3)
    angle = np.deg2rad(rng.uniform(0, 4))
    return rotation(spin / np.linalg.norm(spin) * angle), np.asarray(shift)


def rendered(
    layers: list[Layer], pose: tuple[Floats, Floats], moving: bool, rng: Rng
) -> RenderedPair:
    """The pictures of layers, the last of them in front, by a camera at rest and at a pose."""
    poses = (np.eye(3), np.zeros(3)), pose
    pictures = []
    shown = np.zeros((HEIGHT, WIDTH), dtype=np.int64)
    for second, (turn, shift) in enumerate(poses):
        drawn = np.full((HEIGHT, WIDTH), 120.0, np.float32)
        for number, layer in enumerate(layers):
            matrix = layer.homography(turn, shift, bool(second))
            mask = cv2.warpPerspective(layer.mask, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
            own = cv2.warpPerspective(
                layer.picture, matrix, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT
            )
            drawn = drawn * (1 - mask) + own * mask
            if not second:
                shown = np.where(mask > 0.5, number, shown)
        drawn = cv2.GaussianBlur(drawn, (0, 0), 0.6) * rng.uniform(0.9, 1.1)
        noisy = drawn + rng.normal(0, GREY_NOISE, drawn.shape)
        pictures.append(np.asarray(np.clip(noisy, 0, 255), np.uint8))
    maps = [
        layer.homography(*pose, True) @ np.linalg.inv(layer.homography(*poses[0], False))
        for layer in layers
    ]
    return RenderedPair((pictures[0], pictures[1]), shown, np.stack(maps), moving)


def stereo(rng: Rng) -> RenderedPair:
    """Layers at several depths, seen by a camera that is moved sideways."""
    layers, depth = _layered(rng)
    return rendered(layers, _rectified(rng, depth), False, rng)


def hand_held(rng: Rng) -> RenderedPair:
    """Layers at several depths, seen by a camera in the hand."""
    layers, depth = _layered(rng)
    return rendered(layers, _hand_held(rng, depth), False, rng)


def facade(rng: Rng) -> RenderedPair:
    """Windows that repeat, seen by a camera in the hand."""
    layers, depth = _facade(rng)
    return rendered(layers, _hand_held(rng, depth), False, rng)


def with_body(pose: Callable[[Rng, float], tuple[Floats, Floats]], rng: Rng) -> RenderedPair:
    """Layers at several depths, of which the front one moves by itself."""
    layers, depth = _layered(rng)
    front = _piece(rng, 0.5 * depth, 0.2)
    step = rng.normal(size=3) * [1.0, 1.0, 0.3]
    step *= rng.uniform(8, 40) * 0.5 * depth / FOCAL / np.linalg.norm(step)
    body = Layer(front.picture, front.mask, front.centre, front.axes, step)
    return rendered([*layers, body], pose(rng, depth), True, rng)


KINDS: dict[str, Callable[[Rng], RenderedPair]] = {
    "rectified": stereo,
    "hand-held": hand_held,
    "facade": facade,
    "rectified, a body": lambda rng: with_body(_rectified, rng),
    "hand-held, a body": lambda rng: with_body(_hand_held, rng),
}


def rendered_pairs(plan: Plan) -> Iterator[Outcome]:
    """Rendered pairs, judged by the matches that are right."""
    each = -(-plan.scenes // len(KINDS))
    for seed in plan.seeds:
        for kind, make in KINDS.items():
            for index in range(each):
                pair = make(np.random.default_rng([seed, zlib.crc32(kind.encode()), index]))
                start = time.process_time()
                found = mssegment.segment_pictures(list(pair.pictures), {"seed": seed})
                seconds = time.process_time() - start
                true = pair.truth(found.points)
                case = Case(found.points, true, name=f"{kind} {index}", oracle=0.0)
                seen = (true == BODY).sum() >= LEAST_BODY
                motions = 1 + int(seen), len(np.unique(found.labels[found.labels > 0]))
                # wrong matches may be anywhere
                right = (true > 0) & (seen | (true != BODY))
                error = misclassification(found.labels[right], true[right])
                yield judged(case, seed, kind, error, motions, seconds)
