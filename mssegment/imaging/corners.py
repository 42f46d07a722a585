"""Harris corners with sub-pixel positions, on the levels of a pyramid."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.imaging.pictures import GreyPicture
from mssegment.imaging.pyramid import Level, build_pyramid, size_unit, strips
from mssegment.imaging.threads import threads_for
from mssegment.neighbours import pairs_within
from mssegment.progress import track
from mssegment.records import Corners, Floats, Frame
from mssegment.special import quantile

HARRIS_K = 0.04
"""The constant k of the Harris response."""
QUALITY = 1e-4
"""Least response of a corner, as a share of the largest of its level."""
TILES = 8
"""Tiles along each side of the picture, in which the largest response is looked up."""
QUANTILE_OF_TILES = 0.75
"""What is burnt into the picture covers less than a quarter of the tiles."""
MAX_ABOVE_USUAL = 100.0
"""Largest response of the picture over that quantile of the tiles: about three times the contrast.
In 30 ordinary pictures the ratio is 2 to 13, so that nothing changes there; that of a stamp burnt
into fog is millions."""
INTEGRATION_SIGMA = 1.0
"""Pixels; the Gaussian over which the products of gradients are summed."""
HARRIS_MARGIN = 8
"""Rows around a strip that are enough for its response: 1 of the gradient and 4 of the Gaussian."""
HARRIS_PIXELS = 2**16
"""Pixels of a strip; an array of them takes a quarter of a megabyte."""
MAXIMA_WINDOW = 5
"""Side in pixels of the window in which a corner is the maximum."""
LEVELS_TWO_VIEWS = 4
LIMIT_TWO_VIEWS = 1500
LIMIT_SEQUENCE = 1000
DISTANCE_SEQUENCE = 5.0
LIMIT_EXPONENT = 1.2
"""The limit on a level of scale s is divided by s to this power."""
FEW_FRAMES = 8
"""Sequences of more frames have their corners spread over the picture."""
CORNERS_PER_CELL = 8
"""Corners per cell of the grid over which corners are spread, on average."""
NO_TEXTURE = 1e-3
"""Harris response (grey levels to the fourth, per pixel) below which it is rounding error."""


def detect(
    grey: GreyPicture,
    *,
    levels: int | None = None,
    limit: int = LIMIT_TWO_VIEWS,
    distance: float = 0.0,
    quality: float = QUALITY,
    even: bool = False,
) -> Corners:
    """Detect Harris corners (Harris and Stephens 1988) on the levels of a pyramid.

    A corner is a maximum of the Harris response (k = 0.04) over 5 x 5 pixels, refined by a
    parabola through the response.

    Parameters
    ----------
    grey : float32 array [height, width]
        Grey values 0 to 255.
    levels : int, optional
        Pyramid levels, a factor of sqrt(2) apart. By default 4, and in pictures larger than
        640 x 480 the additional levels that reach the same coarsest size.
    limit : int
        Largest number of corners on a level. Levels coarser than ``size_unit`` by a factor s have
        at most ``limit`` / s**1.2.
    distance : float
        Least distance of two corners, in pixels of the level.
    quality : float
        Least response, as a share of the largest on the level.
    even : bool
        Take the strongest corners of every cell of a grid in turn, so that objects with little
        texture beside strong texture have corners too.

    Returns
    -------
    Corners
        Level by level, strongest first within a level. Positions are in pixels of the picture, the
        centre of the first pixel at (0, 0). Empty for a picture without texture.
    """
    unit = size_unit(grey)
    if levels is None:
        levels = LEVELS_TWO_VIEWS + int(2 * np.log2(unit) + 1e-9)
    found = [
        _detect_on_level(
            level,
            max(1, int(limit / max(1.0, level.scale / unit) ** LIMIT_EXPONENT)),
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
    pictures: Sequence[GreyPicture],
    frames: Sequence[Frame] = (),
    *,
    levels: int | None = None,
    limit: int | None = None,
    distance: float | None = None,
    quality: float = QUALITY,
) -> list[Corners]:
    """Detect the corners of every frame, with defaults that depend on their number.

    Two views: a pyramid, with at most 1500 corners on its finest level. More frames: one level,
    with at most 1000 corners at least 5 pixels apart; from 9 frames on spread over the picture.

    Parameters
    ----------
    pictures : sequence of float32 array [height, width]
        The frames, grey values 0 to 255.
    frames : sequence of Frame
        Their records, for errors.
    levels, limit, distance, quality
        As in ``detect``; None for the defaults.

    Returns
    -------
    list of Corners
        One per frame.

    Raises
    ------
    DataError
        If a frame has no corners; the error names it.
    """
    pair = len(pictures) == 2
    found: list[Corners] = []
    for number, grey in enumerate(track(pictures, "frames")):
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
                f"{grey.min():.0f} to {grey.max():.0f}), expected a picture with texture; "
                "leave this frame out"
            )
        found.append(corners)
    return found


def harris(grey: GreyPicture) -> npt.NDArray[np.float32]:
    """The Harris response det(M) - k tr(M)**2 of every pixel, [height, width].

    M is the matrix of products of gradients, smoothed by a Gaussian of sigma 1 pixel. Pictures are
    worked on in strips, whose arrays stay in the cache: that is twice as fast.
    """
    response = np.empty(grey.shape, np.float32)
    for rows, around, inside in strips(grey.shape, HARRIS_MARGIN, HARRIS_PIXELS):
        response[rows] = _harris(grey[around])[inside]
    return response


def _harris(grey: GreyPicture) -> npt.NDArray[np.float32]:
    """``harris`` of a whole picture or a strip of one."""
    # four arrays are reused throughout: allocating memory takes longer than the arithmetic
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
    """The corners of one level; parameters as in ``detect``."""
    response = harris(level.grey)
    rows, columns = _local_maxima(response, quality)
    strength = response[rows, columns]
    order = np.argsort(-strength, kind="stable")
    if distance > 0:
        places = np.column_stack([columns, rows])[order]
        order = order[select_apart(places, distance, None if even else limit)]
    if even:
        side = np.sqrt(response.size * CORNERS_PER_CELL / limit)
        cells = (rows[order] // side).astype(np.int64) * response.shape[1] + columns[order] // side
        order = order[np.argsort(_rank_in_cell(cells), kind="stable")]
    order = order[:limit]
    rows, columns = rows[order], columns[order]
    points = np.column_stack([columns, rows]) + _refine(response, rows, columns)
    return Corners(
        points=level.to_picture(points),
        responses=strength[order].astype(np.float64),
        scales=np.full(len(order), level.scale),
    )


def _local_maxima(
    response: npt.NDArray[np.float32], quality: float
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Rows and columns of the maxima over 5 x 5 pixels that are above ``quality`` and rounding."""
    window = np.ones((MAXIMA_WINDOW, MAXIMA_WINDOW), np.uint8)
    largest = np.asarray(cv2.dilate(response, window))
    candidates = response > max(quality * _strong(response), NO_TEXTURE)
    border = MAXIMA_WINDOW // 2
    candidates[:border] = candidates[-border:] = False
    candidates[:, :border] = candidates[:, -border:] = False
    places = np.flatnonzero(candidates)  # np.nonzero is slow in 2-D
    places = places[response.ravel()[places] == largest.ravel()[places]]
    return np.divmod(places, response.shape[1])


def _strong(response: npt.NDArray[np.float32]) -> float:
    """The response of a strong corner: the largest, unless it is far above that of most places.

    A burnt-in time stamp or a hot pixel must not hide a scene of low contrast.
    """
    rows, columns = (_starts(size, min(TILES, size)) for size in response.shape)
    tiles = np.maximum.reduceat(np.maximum.reduceat(response, rows, axis=0), columns, axis=1)
    usual = float(quantile(tiles.ravel().astype(np.float64), QUANTILE_OF_TILES))
    return min(float(tiles.max()), MAX_ABOVE_USUAL * max(usual, NO_TEXTURE))


def _starts(size: int, parts: int) -> npt.NDArray[np.intp]:
    """Where the parts of a range begin, the larger ones first, as of ``numpy.array_split``."""
    part = np.arange(parts)
    return part * (size // parts) + np.minimum(part, size % parts)


def _rank_in_cell(cells: npt.NDArray[np.floating]) -> npt.NDArray[np.intp]:
    """How many earlier entries of ``cells`` [n] are equal to each."""
    by_cell = np.argsort(cells, kind="stable")
    ordered = cells[by_cell]
    starts = np.searchsorted(ordered, ordered)
    rank = np.empty(len(cells), dtype=np.intp)
    rank[by_cell] = np.arange(len(cells)) - starts
    return rank


def _refine(
    response: npt.NDArray[np.float32], rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]
) -> Floats:
    """Offset (x, y) [n, 2] of the peak of a parabola in each direction, at most 1/2 pixel."""
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


def select_apart(
    points: npt.ArrayLike, distance: float, limit: int | None = None
) -> npt.NDArray[np.intp]:
    """Select points greedily so that no two are too close.

    Parameters
    ----------
    points : array_like [n, 2]
        Finite positions in pixels, the preferred ones first.
    distance : float
        A point is dropped if one selected before is closer than this.
    limit : int, optional
        Largest number of points to select.

    Returns
    -------
    int array [k]
        Indices of the selected points, ascending.

    Examples
    --------
    >>> select_apart([[0, 0], [1, 0], [3, 0]], 2).tolist()
    [0, 2]
    """
    where = np.asarray(points, np.float64).reshape(-1, 2)
    pairs = pairs_within(where, float(np.nextafter(distance, 0)))
    earlier, later = pairs.min(axis=1, initial=len(where)), pairs.max(axis=1, initial=0)
    undecided = np.ones(len(where), bool)
    selected = np.zeros(len(where), bool)
    while len(earlier):
        # points without an undecided earlier neighbour are selected, and drop their neighbours
        blocked = np.zeros(len(where), bool)
        blocked[later] = True
        chosen = undecided & ~blocked
        selected |= chosen
        undecided &= ~chosen
        undecided[later[chosen[earlier]]] = False
        both = undecided[earlier] & undecided[later]
        earlier, later = earlier[both], later[both]
    selected |= undecided
    return np.flatnonzero(selected)[:limit]
