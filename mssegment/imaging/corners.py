"""Harris corners with sub-pixel positions, on one level or on a pyramid of them."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.imaging.pictures import Grey
from mssegment.imaging.pyramid import Level, build_pyramid, size_unit
from mssegment.imaging.threads import threads_for
from mssegment.neighbours import pairs_within
from mssegment.records import Corners, Floats, Frame

HARRIS_K = 0.04
QUALITY = 1e-4
INTEGRATION_SIGMA = 1.0
MAXIMA_WINDOW = 5
LEVELS_TWO_VIEWS = 4
LIMIT_TWO_VIEWS = 1500
LIMIT_SEQUENCE = 1000
DISTANCE_SEQUENCE = 5.0
LIMIT_FALLS_WITH_SCALE = 1.2
FEW_FRAMES = 8
"""Sequences of more frames have their corners spread over the picture."""
PER_CELL = 8
"""Corners spread: cells of a size that so many corners a cell make the limit."""
NO_TEXTURE = 1e-3
"""A Harris response (grey levels to the fourth, per pixel) that only rounding errors produce."""


def detect(
    grey: Grey,
    *,
    levels: int | None = None,
    limit: int = LIMIT_TWO_VIEWS,
    distance: float = 0.0,
    quality: float = QUALITY,
    even: bool = False,
) -> Corners:
    """Corners of one picture, level by level, the strongest first within a level.

    ``levels`` is the number of pyramid levels, a factor sqrt(2) apart: 4 by default, and as many
    more as a large picture is larger than 640x480 (its ``size_unit``). A level keeps at most
    ``limit`` corners, levels coarser than that unit ``limit`` / s^1.2 where s is by how much; no
    two are closer than ``distance`` pixels of the level. With ``even`` these are the strongest of
    every cell of a grid, in turn, so that a plain car beside a tree has corners too. Each is a
    maximum of the Harris response (k = 0.04; Harris and Stephens 1988) over 5x5 pixels that exceeds
    ``quality`` times the greatest of the level. Positions are in pixels of the picture, pixel
    centres at whole numbers, refined by a parabola through the response. A picture without texture
    gives no corners.
    """
    unit = size_unit(grey)
    if levels is None:
        levels = LEVELS_TWO_VIEWS + int(2 * np.log2(unit) + 1e-9)
    found = [
        _detect_on_level(
            level,
            max(1, int(limit / max(1.0, level.scale / unit) ** LIMIT_FALLS_WITH_SCALE)),
            distance,
            quality,
            even,
        )
        for level in build_pyramid(grey, levels)
    ]
    return Corners(
        points=np.concatenate([corners.points for corners in found]),
        responses=np.concatenate([corners.responses for corners in found]),
        scales=np.concatenate([corners.scales for corners in found]),
    )


def detect_all(
    pictures: Sequence[Grey],
    frames: Sequence[Frame] = (),
    *,
    levels: int | None = None,
    limit: int | None = None,
    distance: float | None = None,
    quality: float = QUALITY,
) -> list[Corners]:
    """The corners of each frame, with the defaults that suit their number.

    Two views: a pyramid, 1500 corners on the finest level. More: one level, 1000 corners
    at least 5 pixels apart, and from 9 frames on the best of each part of the picture. Raises
    ``DataError`` that names the frame (``frames`` has the paths) where there are no corners.
    """
    pair = len(pictures) == 2
    found: list[Corners] = []
    for number, grey in enumerate(pictures):
        with threads_for(len(pictures)):
            corners = detect(
                grey,
                levels=levels if levels is not None or pair else 1,
                limit=limit if limit is not None else (LIMIT_TWO_VIEWS if pair else LIMIT_SEQUENCE),
                distance=distance if distance is not None else (0.0 if pair else DISTANCE_SEQUENCE),
                quality=quality,
                even=len(pictures) > FEW_FRAMES,
            )
        if len(corners.points) == 0:
            name = frames[number].path if frames else f"frame {number + 1}"
            raise DataError(
                f"{name}: no corners ({grey.shape[1]}x{grey.shape[0]} pixels, grey values "
                f"{grey.min():.0f} to {grey.max():.0f}); expected a picture with texture"
            )
        found.append(corners)
    return found


def harris(grey: Grey) -> npt.NDArray[np.float32]:
    """Harris response det(M) - k tr(M)^2, M the gradients' products under a Gaussian of sigma 1.

    In four arrays, used again and again: fresh memory takes longer than the arithmetic.
    """
    xx = np.asarray(cv2.Scharr(grey, cv2.CV_32F, 1, 0, scale=1 / 32), np.float32)
    yy = np.asarray(cv2.Scharr(grey, cv2.CV_32F, 0, 1, scale=1 / 32), np.float32)
    xy = xx * yy
    xx *= xx
    yy *= yy
    for product in (xx, yy, xy):
        cv2.GaussianBlur(product, (0, 0), INTEGRATION_SIGMA, dst=product)
    response = xx * yy
    xy *= xy
    response -= xy
    xx += yy  # the trace
    np.multiply(xx, np.float32(HARRIS_K), out=yy)
    yy *= xx
    response -= yy
    return np.asarray(response)


def _detect_on_level(
    level: Level, limit: int, distance: float, quality: float, even: bool
) -> Corners:
    response = harris(level.grey)
    reach = MAXIMA_WINDOW // 2
    window = np.ones((MAXIMA_WINDOW, MAXIMA_WINDOW), np.uint8)
    greatest = float(response.max(initial=0.0))
    peaks = (response == cv2.dilate(response, window)) & (response > quality * greatest)
    peaks &= response > NO_TEXTURE
    peaks[:reach], peaks[-reach:], peaks[:, :reach], peaks[:, -reach:] = False, False, False, False
    rows, columns = np.divmod(np.flatnonzero(peaks), peaks.shape[1])  # np.nonzero is slow in 2-D
    strength = response[rows, columns]
    order = np.argsort(-strength, kind="stable")
    if distance > 0:
        kept = spread(np.column_stack([columns, rows])[order], distance, None if even else limit)
        order = order[kept]
    if even:
        side = np.sqrt(response.size * PER_CELL / limit)
        cells = (rows[order] // side).astype(np.int64) * response.shape[1] + columns[order] // side
        order = order[np.argsort(_turns(cells), kind="stable")]
    order = order[:limit]
    rows, columns = rows[order], columns[order]
    points = np.column_stack([columns, rows]) + _refine(response, rows, columns)
    return Corners(
        points=level.to_picture(points),
        responses=strength[order].astype(np.float64),
        scales=np.full(len(order), level.scale),
    )


def _turns(cells: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """How many before each of [n] are of the same cell."""
    by_cell = np.argsort(cells, kind="stable")
    ordered = cells[by_cell]
    starts = np.searchsorted(ordered, ordered)
    turns = np.empty(len(cells), dtype=np.intp)
    turns[by_cell] = np.arange(len(cells)) - starts
    return turns


def _refine(
    response: npt.NDArray[np.float32], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]
) -> Floats:
    """Offset (x, y) of the peak of a parabola through three responses each way, within 1/2 px."""
    offsets = np.empty((len(rows), 2))
    centre = response[rows, columns].astype(np.float64)
    for axis, (dy, dx) in enumerate(((0, 1), (1, 0))):
        before = response[rows - dy, columns - dx].astype(np.float64)
        after = response[rows + dy, columns + dx].astype(np.float64)
        curvature = before - 2 * centre + after
        slope = (before - after) / 2
        flat = curvature >= 0
        offsets[:, axis] = np.where(flat, 0.0, slope / np.where(flat, 1.0, curvature))
    return np.clip(offsets, -0.5, 0.5)


def spread(
    points: npt.ArrayLike, distance: float, limit: int | None = None
) -> npt.NDArray[np.intp]:
    """Indices of the points that stay when, in the order given, each keeps others away.

    ``points`` [n, 2] in pixels, all finite; a point is dropped if one kept before is closer than
    ``distance``. At most ``limit`` stay.
    """
    where = np.asarray(points, np.float64).reshape(-1, 2)
    pairs = pairs_within(where, float(np.nextafter(distance, 0)))
    earlier, later = pairs.min(axis=1, initial=len(where)), pairs.max(axis=1, initial=0)
    open_ = np.ones(len(where), bool)
    kept = np.zeros(len(where), bool)
    while len(earlier):
        # Nothing earlier is open near these: they stay, and what is near them goes.
        blocked = np.zeros(len(where), bool)
        blocked[later] = True
        stay = open_ & ~blocked
        kept |= stay
        open_ &= ~stay
        open_[later[stay[earlier]]] = False
        both = open_[earlier] & open_[later]
        earlier, later = earlier[both], later[both]
    kept |= open_
    return np.flatnonzero(kept)[:limit]
