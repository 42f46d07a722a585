"""Textures as functions of a position (u, v), about one unit per pixel, to a brightness 0..1.

Only integer arithmetic and + - * / on single numbers: the same on every machine.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


def random_at(x: Integers, y: Integers, seed: int) -> Floats:
    """A number in [0, 1) that depends on whole coordinates and the seed alone (splitmix64)."""
    with np.errstate(over="ignore"):
        h = x.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        h ^= y.astype(np.uint64) * np.uint64(0xC2B2AE3D27D4EB4F)
        h ^= np.full_like(h, seed) * np.uint64(0x165667B19E3779F9)
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h ^= h >> np.uint64(31)
    return (h >> np.uint64(11)).astype(np.float64) / 2.0**53


def cell(u: Floats, v: Floats, width: float, height: float) -> tuple[Integers, Integers]:
    """Column and row of the grid cell that holds each position."""
    return np.floor(u / width).astype(np.int64), np.floor(v / height).astype(np.int64)


def clouds(u: Floats, v: Floats, size: float, seed: int) -> Floats:
    """Smooth random shades whose features measure about ``size``."""
    x, y = cell(u, v, size, size)
    fx, fy = u / size - x, v / size - y
    fx, fy = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy)
    top = random_at(x, y, seed) * (1 - fx) + random_at(x + 1, y, seed) * fx
    bottom = random_at(x, y + 1, seed) * (1 - fx) + random_at(x + 1, y + 1, seed) * fx
    return top * (1 - fy) + bottom * fy


def wall(u: Floats, v: Floats, seed: int) -> Floats:
    """Bricks whose shades come again every four columns and every two rows of bricks."""
    width, height, joint = 44.0, 20.0, 2.5
    row = np.floor(v / height).astype(np.int64)
    shifted = u + np.where(row % 2 == 0, 0.0, width / 2)
    column, _ = cell(shifted, v, width, height)
    in_joint = (shifted - column * width < joint) | (v - row * height < joint)
    shade = 0.45 + 0.35 * random_at(column % 4, row % 4, seed)
    grain = 0.22 * (clouds(u, v, 7.0, seed + 1) - 0.5) + 0.10 * (clouds(u, v, 90.0, seed + 2) - 0.5)
    return np.where(in_joint, 0.22, shade) + grain


def print_page(u: Floats, v: Floats, seed: int) -> Floats:
    """A printed page: rows of made-up letters, some words, two sizes."""
    paper = 0.90 - 0.10 * clouds(u, v, 60.0, seed + 3)
    big = np.floor(v / 60.0).astype(np.int64) % 2 == 0
    size = np.where(big, 4.0, 2.4)
    dot_u, dot_v = np.floor(u / size).astype(np.int64), np.floor(v / size).astype(np.int64)
    letter_u, letter_v = dot_u // 6, dot_v // 8
    inside = (dot_u % 6 < 5) & (dot_v % 8 < 6)
    space = random_at(letter_u, letter_v, seed + 7) < 0.16
    ink = random_at(dot_u, dot_v, seed + 11) < 0.52
    tone = 0.16 + 0.30 * (random_at(letter_u // 5, letter_v, seed + 5) < 0.3)
    return np.where(inside & ink & ~space, tone, paper)


def chequers(u: Floats, v: Floats, seed: int) -> Floats:
    """A game board: squares that repeat exactly, a few of them with a mark of their own."""
    side = 19.0
    x, y = cell(u, v, side, side)
    fu, fv = u - (x + 0.5) * side, v - (y + 0.5) * side
    board = np.where((x + y) % 2 == 0, 0.80, 0.24)
    kind = np.floor(random_at(x, y, seed) * 7).astype(np.int64)
    piece_u = 6.0 * (random_at(x, y, seed + 1) - 0.5)
    piece_v = 6.0 * (random_at(x, y, seed + 2) - 0.5)
    du, dv = fu - piece_u, fv - piece_v
    disc = (kind == 0) & (du * du + dv * dv < 22.0)
    bar = (kind == 1) & (abs(du) < 2.0) & (abs(dv) < 6.0)
    wedge = (kind == 2) & (du + dv > 0) & (abs(du) < 5.0) & (abs(dv) < 5.0)
    marked = np.where(disc | bar | wedge, np.where((x + y) % 2 == 0, 0.10, 0.95), board)
    return marked + 0.10 * (clouds(u, v, 11.0, seed + 4) - 0.5)


def pebbles(u: Floats, v: Floats, seed: int) -> Floats:
    """Pebbles: the nearest of one random point per cell decides the shade, the gaps are dark."""
    size = 17.0
    x, y = cell(u, v, size, size)
    nearest = np.full(u.shape, np.inf)
    second = np.full(u.shape, np.inf)
    shade = np.zeros(u.shape)
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            cx, cy = x + dx, y + dy
            du = u - (cx + 0.15 + 0.7 * random_at(cx, cy, seed)) * size
            dv = v - (cy + 0.15 + 0.7 * random_at(cx, cy, seed + 1)) * size
            gap = np.sqrt(du * du + dv * dv)
            closer = gap < nearest
            second = np.where(closer, nearest, np.minimum(second, gap))
            shade = np.where(closer, random_at(cx, cy, seed + 2), shade)
            nearest = np.where(closer, gap, nearest)
    rim = np.clip((second - nearest) / 4.0, 0.0, 1.0)
    return np.asarray(
        0.12 + rim * (0.25 + 0.55 * shade) + 0.12 * (clouds(u, v, 4.0, seed + 3) - 0.5)
    )
