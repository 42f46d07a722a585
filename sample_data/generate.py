"""Make the sample scenes: ``python -m sample_data.generate [FOLDER]``.

One scene per motion model of the paper, three moving bodies each, before a wall that stands still:
``translation`` (three boxes that translate in space, seen by a calibrated perspective camera),
``factorization`` (three flat bodies under an affine camera, five frames) and ``affine`` (three
flat bodies, two frames). Masks: 0 nothing, n body n, 255 the rim of a body (ignore).
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from sample_data.png import Bytes, encode
from sample_data.textures import Floats, Integers, chequers, pebbles, print_page, wall

WIDTH, HEIGHT = 640, 480
SUPERSAMPLING = 3
SHADES = 64
TEXELS = 180.0
"""Texture units per unit of length in space."""
FOCAL, CENTRE_X, CENTRE_Y = 800.0, 319.5, 239.5
RIM = 2
"""Pixels on either side of a body's outline that the mask leaves out."""

Texture = Callable[[Floats, Floats, int], Floats]
Hit = tuple[npt.NDArray[np.bool_], Floats]
"""Where a body is seen, and its brightness at those places one after the other."""

RAMPS = (
    ((38, 34, 40), (226, 219, 205)),
    ((10, 32, 66), (196, 226, 250)),
    ((74, 22, 8), (255, 214, 150)),
    ((6, 52, 40), (214, 240, 190)),
)
"""Darkest and lightest colour of the wall and of the three bodies."""


@dataclass(frozen=True)
class Flat:
    """A flat body: its outline and texture around (0, 0), placed by an affine map per frame.

    ``maps`` are (a, b, c, d, x, y): u, v goes to (a u + b v + x, c u + d v + y).
    """

    texture: Texture
    seed: int
    half_width: float
    half_height: float
    round: float
    maps: tuple[tuple[float, ...], ...]

    def look(self, x: Floats, y: Floats, frame: int) -> Hit:
        """What pixels x, y of a frame see of the body."""
        a, b, c, d, shift_x, shift_y = self.maps[frame]
        determinant = a * d - b * c
        dx, dy = x - shift_x, y - shift_y
        u, v = (d * dx - b * dy) / determinant, (a * dy - c * dx) / determinant
        over_u = np.maximum(abs(u) - (self.half_width - self.round), 0.0)
        over_v = np.maximum(abs(v) - (self.half_height - self.round), 0.0)
        inside = over_u * over_u + over_v * over_v < self.round * self.round
        return inside, self.texture(u[inside], v[inside], self.seed)


@dataclass(frozen=True)
class Box:
    """A box in space whose three axes are turned, and which translates between the frames.

    ``centres`` are its positions per frame (x right, y down, z ahead), ``turns`` two angles as
    tangents of their halves (about y, then about x), ``halves`` half its extents.
    """

    texture: Texture
    seed: int
    centres: tuple[tuple[float, float, float], ...]
    turns: tuple[float, float]
    halves: tuple[float, float, float]

    def axes(self) -> tuple[tuple[float, float, float], ...]:
        """The box's axes, from tangents of half angles: no sine, so the same everywhere."""
        (ty, tx) = self.turns
        cy, sy = (1 - ty * ty) / (1 + ty * ty), 2 * ty / (1 + ty * ty)
        cx, sx = (1 - tx * tx) / (1 + tx * tx), 2 * tx / (1 + tx * tx)
        return ((cy, 0.0, -sy), (sx * sy, cx, sx * cy), (cx * sy, -sx, cx * cy))

    def look(self, x: Floats, y: Floats, frame: int) -> Hit:
        """What pixels x, y of a frame see: the ray's entry into the box, by slabs."""
        ray = ((x - CENTRE_X) / FOCAL, (y - CENTRE_Y) / FOCAL, np.ones_like(x))
        centre = self.centres[frame]
        near, far = np.full_like(x, -np.inf), np.full_like(x, np.inf)
        face = np.zeros(x.shape, np.int64)
        local = []
        for number, (axis, half) in enumerate(zip(self.axes(), self.halves, strict=True)):
            speed = axis[0] * ray[0] + axis[1] * ray[1] + axis[2] * ray[2]
            start = -(axis[0] * centre[0] + axis[1] * centre[1] + axis[2] * centre[2])
            speed = np.where(abs(speed) < 1e-9, 1e-9, speed)
            one, two = (-half - start) / speed, (half - start) / speed
            enter = np.minimum(one, two)
            face = np.where(enter > near, number, face)
            near, far = np.maximum(near, enter), np.minimum(far, np.maximum(one, two))
            local.append((start, speed))
        seen = near < far
        face, near = face[seen], near[seen]
        p = [(start + near * speed[seen]) * TEXELS for start, speed in local]
        u = np.where(face == 0, p[2] + 997.0, p[0])
        v = np.where(face == 1, p[2] + 997.0, p[1])
        # Each face has its own light, or the edges of the box would not be seen.
        light = np.where(face == 2, 1.0, np.where(face == 1, 1.12, 0.72))
        return seen, self.texture(u, v, self.seed) * light


Body = Flat | Box


@dataclass(frozen=True)
class Scene:
    """A named scene: bodies, the nearest last, before the wall."""

    name: str
    frames: int
    bodies: tuple[Body, ...]
    wall_seed: int
    camera: bool = False


@functools.cache
def _wall(seed: int) -> Floats:
    """The wall's brightness at every sample: the same in each frame of a scene."""
    return wall(*_samples(), seed)


def _samples() -> tuple[Floats, Floats]:
    """Positions x, y of the samples, several to a pixel; pixel centres are whole numbers."""
    n = SUPERSAMPLING
    line = (np.arange(max(WIDTH, HEIGHT) * n) + 0.5) / n - 0.5
    x, y = np.meshgrid(line[: WIDTH * n], line[: HEIGHT * n])
    return x, y


def render(scene: Scene, frame: int) -> tuple[Bytes, Bytes]:
    """The frame as palette indices [h, w], and its mask."""
    x, y = _samples()
    surface = np.zeros(x.shape, np.int64)
    bright = _wall(scene.wall_seed).copy()
    for number, body in enumerate(scene.bodies, start=1):
        seen, texture = body.look(x, y, frame)
        surface[seen] = number
        bright[seen] = texture
    level = np.clip(np.floor(bright * 4096.0), 0, 4095).astype(np.int64)
    return _colours(surface, level), _mask(surface)


def palette() -> Bytes:
    """The ramps one after the other, [256, 3]."""
    steps = np.arange(SHADES)[:, None]
    dark, light = (np.array([ramp[i] for ramp in RAMPS])[:, None, :] for i in (0, 1))
    ramps = dark + (light - dark) * steps // (SHADES - 1)
    return np.asarray(ramps.reshape(-1, 3), np.uint8)


def _blocks(samples: Integers) -> Integers:
    """The samples of each pixel, [h, w, n^2]."""
    n = SUPERSAMPLING
    grouped = samples.reshape(HEIGHT, n, WIDTH, n).transpose(0, 2, 1, 3)
    return grouped.reshape(HEIGHT, WIDTH, n * n)


def _colours(surface: Integers, level: Integers) -> Bytes:
    """Palette indices: the mean shade, and on outlines the palette's colour nearest the mix."""
    surfaces, levels = _blocks(surface), _blocks(level)
    shade = levels.sum(axis=2) * (SHADES - 1) // (4095 * levels.shape[2])
    index = surfaces[..., 0] * SHADES + shade
    rows, columns = np.nonzero(surfaces.min(axis=2) != surfaces.max(axis=2))
    table = palette().astype(np.int64)
    fine = surfaces[rows, columns] * SHADES + levels[rows, columns] * (SHADES - 1) // 4095
    mix = table[fine].sum(axis=1)
    count = levels.shape[2]
    away = ((table[None] * count - mix[:, None]) ** 2).sum(axis=2)
    index[rows, columns] = away.argmin(axis=1)
    return np.asarray(index, np.uint8)


def _mask(surface: Integers) -> Bytes:
    """The body of each pixel, 255 within ``RIM`` pixels of an outline."""
    surfaces = _blocks(surface)
    low, high = surfaces.min(axis=2), surfaces.max(axis=2)
    for _ in range(RIM):
        for axis in (0, 1):
            low = np.minimum.reduce([low, _shifted(low, 1, axis), _shifted(low, -1, axis)])
            high = np.maximum.reduce([high, _shifted(high, 1, axis), _shifted(high, -1, axis)])
    return np.where(low == high, surfaces[..., 0], 255).astype(np.uint8)


def _shifted(values: Integers, by: int, axis: int) -> Integers:
    """Moved by one pixel, the border repeated."""
    index = np.clip(np.arange(values.shape[axis]) - by, 0, values.shape[axis] - 1)
    return np.take(values, index, axis=axis)


def write(folder: Path) -> None:
    """Write every scene into ``folder``."""
    for scene in SCENES:
        target = folder / scene.name
        target.mkdir(parents=True, exist_ok=True)
        for frame in range(scene.frames):
            picture, mask = render(scene, frame)
            (target / f"frame-{frame + 1}.png").write_bytes(encode(picture, palette()))
            (target / f"mask-{frame + 1}.png").write_bytes(encode(mask))
        if scene.camera:
            (target / "camera.yaml").write_text(
                f"# Pinhole camera, pixels\nfx: {FOCAL}\nfy: {FOCAL}\ncx: {CENTRE_X}\n"
                f"cy: {CENTRE_Y}\n",
                encoding="utf-8",
            )


SCENES = (
    Scene(
        "translation",
        2,
        (
            Box(
                print_page,
                11,
                ((-0.95, -0.45, 4.2), (-0.80, -0.41, 4.32)),
                (0.22, -0.16),
                (0.50, 0.42, 0.22),
            ),
            Box(
                chequers,
                22,
                ((0.88, -0.38, 4.6), (0.83, -0.24, 4.50)),
                (-0.26, -0.14),
                (0.52, 0.46, 0.24),
            ),
            Box(
                pebbles,
                33,
                ((0.02, 0.55, 3.7), (-0.07, 0.46, 3.82)),
                (0.15, 0.20),
                (0.55, 0.30, 0.25),
            ),
        ),
        wall_seed=5,
        camera=True,
    ),
    Scene(
        "factorization",
        5,
        (
            Flat(
                print_page,
                44,
                92.0,
                78.0,
                12.0,
                (
                    (1.000, 0.000, 0.000, 1.000, 150.0, 150.0),
                    (0.998, -0.050, 0.048, 0.985, 160.0, 146.0),
                    (0.985, -0.098, 0.100, 0.962, 171.0, 144.0),
                    (0.962, -0.150, 0.146, 0.935, 181.0, 140.0),
                    (0.940, -0.196, 0.198, 0.905, 192.0, 138.0),
                ),
            ),
            Flat(
                chequers,
                55,
                88.0,
                82.0,
                82.0,
                (
                    (1.000, 0.000, 0.000, 1.000, 480.0, 165.0),
                    (1.020, 0.060, -0.055, 1.015, 474.0, 175.0),
                    (1.035, 0.118, -0.112, 1.028, 469.0, 186.0),
                    (1.048, 0.176, -0.170, 1.040, 463.0, 196.0),
                    (1.060, 0.236, -0.226, 1.050, 458.0, 207.0),
                ),
            ),
            Flat(
                pebbles,
                66,
                110.0,
                70.0,
                30.0,
                (
                    (1.000, 0.000, 0.000, 1.000, 300.0, 360.0),
                    (0.975, 0.020, -0.022, 0.990, 290.0, 351.0),
                    (0.948, 0.042, -0.040, 0.982, 279.0, 343.0),
                    (0.925, 0.060, -0.062, 0.971, 269.0, 334.0),
                    (0.900, 0.082, -0.080, 0.963, 258.0, 326.0),
                ),
            ),
        ),
        wall_seed=6,
    ),
    Scene(
        "affine",
        2,
        (
            Flat(
                print_page,
                77,
                88.0,
                84.0,
                10.0,
                (
                    (1.000, 0.060, -0.060, 1.000, 165.0, 330.0),
                    (1.045, 0.170, -0.090, 0.970, 186.0, 312.0),
                ),
            ),
            Flat(
                chequers,
                88,
                104.0,
                70.0,
                16.0,
                (
                    (0.980, -0.150, 0.150, 0.980, 200.0, 120.0),
                    (0.940, -0.020, 0.045, 1.010, 176.0, 134.0),
                ),
            ),
            Flat(
                pebbles,
                99,
                86.0,
                86.0,
                86.0,
                (
                    (1.000, 0.000, 0.000, 1.000, 462.0, 240.0),
                    (0.955, -0.100, 0.120, 0.985, 468.0, 272.0),
                ),
            ),
        ),
        wall_seed=7,
    ),
)

if __name__ == "__main__":
    write(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
