"""Groups of matches that a larger group explains as well give way; bodies that move do not."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mssegment.imaging.matching.local_maps import AffineMatches
from mssegment.imaging.matching.pyramid_corners import PyramidCorners, with_pyramid
from mssegment.imaging.matching.rivals import groups, without_rivals
from mssegment.records import Corners, Floats

STEP, SHIFT = 70, np.array([9.0, 4.0])
Picture = npt.NDArray[np.float32]
Flags = npt.NDArray[np.bool_]


def texture(rng: np.random.Generator, height: int, width: int) -> Picture:
    drawn = cv2.GaussianBlur(rng.normal(0, 1, (height, width)).astype(np.float32), (0, 0), 1.5)
    return np.asarray(128 + 40 * drawn / drawn.std(), np.float32)


def facade(rng: np.random.Generator) -> Picture:
    """Windows that are all alike, ``STEP`` pixels apart."""
    wall = np.full((420, 560), 150.0, np.float32)
    window = texture(rng, 40, 40)
    for y in range(15, 380, STEP):
        for x in range(15, 520, STEP):
            wall[y : y + 40, x : x + 40] = window
    return wall


def moved(picture: Picture, shift: Floats) -> Picture:
    height, width = picture.shape
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]]], np.float64)
    border = cv2.BORDER_REFLECT
    return np.asarray(cv2.warpAffine(picture, matrix, (width, height), borderMode=border))


def view(picture: Picture, points: Floats) -> PyramidCorners:
    count = len(points)
    return with_pyramid(
        picture, Corners(points=points, scales=np.ones(count), responses=np.ones(count))
    )


def matched(points: Floats, shifts: Floats) -> AffineMatches:
    count = len(points)
    maps, levels = np.tile(np.eye(2), (count, 1, 1)), np.zeros(count, dtype=np.intp)
    return AffineMatches(points, points + shifts, maps, np.full(count, 0.99), levels, levels)


def in_windows(rng: np.random.Generator) -> tuple[Floats, npt.NDArray[np.intp]]:
    """Five points in each window, and the column of the window."""
    x, y = np.meshgrid(np.arange(15, 480, STEP), np.arange(15, 340, STEP))
    corner = np.column_stack([x.ravel(), y.ravel()])
    points = np.repeat(corner, 8, axis=0) + rng.uniform(10, 30, (8 * len(corner), 2))
    return points, np.repeat(x.ravel() // STEP, 8)


def inside(points: Floats, low: list[int], high: list[int]) -> Flags:
    return np.asarray(((points > low) & (points < high)).all(axis=1))


@pytest.mark.parametrize("seed", range(3))
def test_windows_that_are_matched_one_off_are_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    picture = facade(rng)
    points, column = in_windows(rng)
    off = column == 5
    found = matched(points, SHIFT + off[:, None] * [-STEP, 0.0])
    kept = without_rivals(view(picture, points), view(moved(picture, SHIFT), points), found, 0.8)
    np.testing.assert_allclose(
        kept.second - kept.first, np.tile(SHIFT, (len(kept.first), 1)), atol=0.3
    )
    assert len(kept.first) > 0.9 * len(points)


@pytest.mark.parametrize("seed", range(3))
def test_a_body_that_moves_by_itself_keeps_its_matches(seed: int) -> None:
    rng = np.random.default_rng(seed)
    picture, own = texture(rng, 420, 560), np.array([-30.0, 25.0])
    after = moved(picture, SHIFT)
    picture[200:320, 280:400] = after[225:345, 250:370] = texture(rng, 120, 120)
    points = rng.uniform([30, 30], [520, 380], (500, 2))
    body = inside(points, [285, 205], [395, 315])
    hidden = inside(points + SHIFT, [245, 220], [375, 350])
    seen = body | ~(hidden | inside(points, [275, 195], [405, 325]))
    points, body = points[seen], body[seen]
    found = matched(points, np.where(body[:, None], own, SHIFT))
    kept = without_rivals(view(picture, points), view(after, points), found, 0.8)
    np.testing.assert_array_equal(kept.second, found.second)


def test_groups_are_matches_that_predict_each_other() -> None:
    rng = np.random.default_rng(0)
    points, column = in_windows(rng)
    off = column == 5
    part = groups(matched(points, SHIFT + off[:, None] * [-STEP, 0.0]), 1.0)
    assert len(np.unique(part[off])) == len(np.unique(part[~off])) == 1
    assert len(np.unique(part)) == 2
