"""Draw a scene with OpenCV, anti-aliased and at sub-pixel positions."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np

from mssegment.records import Floats
from mssegment.rendering import scene as scenes
from mssegment.rendering.report import Picture
from mssegment.rendering.style import PAPER, Colour, bgr, text_on

_SHIFT = 4
"""Fractional bits of OpenCV's fixed-point coordinates."""
_MAX_COORDINATE = 1e6


def paint(scene: scenes.Scene) -> Picture:
    """Draw a scene; returns uint8 [height, width, 3] in BGR order."""
    canvas = np.full((scene.height, scene.width, 3), PAPER, dtype=np.uint8)
    for x, y, photograph in scene.photographs:
        height, width = photograph.shape[:2]
        canvas[y : y + height, x : x + width] = photograph
    for item in scene.items:
        _paint_item(canvas, item)
    return canvas


def _paint_item(canvas: Picture, item: scenes.Item) -> None:
    match item:
        case scenes.Markers():
            _markers(canvas, item)
        case scenes.Lines():
            _lines(canvas, item)
        case scenes.Areas():
            _areas(canvas, item)
        case scenes.Badge():
            _badge(canvas, item)
        case scenes.Label():
            _text(canvas, item)


def _fixed(points: Floats) -> Any:
    """Points as OpenCV's fixed-point integers."""
    # a wrong track may lie anywhere, and OpenCV takes 32 bits
    return np.rint(np.clip(points, -_MAX_COORDINATE, _MAX_COORDINATE) * (1 << _SHIFT)).astype(
        np.int32
    )


def _markers(canvas: Picture, item: scenes.Markers) -> None:
    outline = scenes.OUTLINES[item.shape]
    inner = _fixed(item.points[:, None] + outline * item.radius)
    convex = item.shape not in ("star", "plus", "cross")
    if item.shape == "ring":
        cv2.polylines(canvas, list(inner), True, bgr(item.colour), 1, cv2.LINE_AA, _SHIFT)
    elif not item.halo:
        _fill(canvas, inner, item.colour, convex)
    else:
        outer = _fixed(item.points[:, None] + outline * (item.radius + item.halo))
        # rim and marker in turn, so that a marker covers its neighbour with its rim
        both = np.stack([outer, inner], axis=1).reshape(-1, *outline.shape)
        _fill(canvas, both, PAPER, convex, item.colour)


def _fill(
    canvas: Picture,
    polygons: Any,
    colour: Colour,
    convex: bool = True,
    every_second: Colour | None = None,
) -> None:
    """Fill polygons [n, corners, 2] one by one, every second one in another colour if given."""
    colours = bgr(colour), bgr(every_second or colour)
    for i, polygon in enumerate(polygons):
        if convex:
            cv2.fillConvexPoly(canvas, polygon, colours[i & 1], cv2.LINE_AA, _SHIFT)
        else:
            cv2.fillPoly(canvas, [polygon], colours[i & 1], cv2.LINE_AA, _SHIFT)


def _lines(canvas: Picture, item: scenes.Lines) -> None:
    if not item.paths:
        return
    target = canvas if item.opacity == 1.0 else canvas.copy()
    _strokes(target, item.paths, item.width, item.colour)
    if item.heads:
        _fill(target, _fixed(np.array(item.heads)), item.colour)
    if target is not canvas:
        cv2.addWeighted(target, item.opacity, canvas, 1 - item.opacity, 0, dst=canvas)


def _strokes(canvas: Picture, paths: tuple[Floats, ...], width: float, colour: Colour) -> None:
    """Draw polylines of any width; OpenCV's own thickness is in whole pixels."""
    starts = np.concatenate([path[:-1] for path in paths])
    ends = np.concatenate([path[1:] for path in paths])
    steps = ends - starts
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    keep = lengths > 1e-3
    starts, ends, steps = starts[keep], ends[keep], steps[keep]
    side = np.stack([-steps[:, 1], steps[:, 0]], axis=1) * (width / 2 / lengths[keep, None])
    quads = np.stack([starts + side, ends + side, ends - side, starts - side], axis=1)
    _fill(canvas, _fixed(quads), colour)
    if width > 2.5:  # round the joints where gaps would be visible
        disc = scenes.OUTLINES["circle"][::2] * (width / 2)
        _fill(canvas, _fixed(starts[:, None] + disc), colour)


def _areas(canvas: Picture, item: scenes.Areas) -> None:
    contours = [_fixed(contour) for contour in item.contours if len(contour) >= 3]
    if not contours:
        return
    corners = np.concatenate([np.asarray(contour) for contour in item.contours])
    height, width = canvas.shape[:2]
    left, top = np.clip(np.floor(corners.min(axis=0)).astype(int) - 2, 0, [width, height])
    right, bottom = np.clip(np.ceil(corners.max(axis=0)).astype(int) + 3, 0, [width, height])
    if right <= left or bottom <= top:
        return
    window = canvas[top:bottom, left:right]
    offset = np.array([left, top], dtype=np.int32) << _SHIFT
    moved = [contour - offset for contour in contours]
    if item.opacity > 0:
        tinted = window.copy()
        cv2.fillPoly(tinted, moved, bgr(item.colour), cv2.LINE_AA, _SHIFT)
        cv2.addWeighted(tinted, item.opacity, window, 1 - item.opacity, 0, dst=window)
    if item.width > 0:
        closed = tuple(np.concatenate([contour, contour[:1]]) for contour in item.contours)
        _strokes(canvas, closed, item.width, item.colour)


def _badge(canvas: Picture, item: scenes.Badge) -> None:
    centre = np.array([item.x, item.y])
    disc = scenes.OUTLINES["circle"]
    _fill(canvas, _fixed(centre + disc * item.radius * 1.16)[None], PAPER)
    _fill(canvas, _fixed(centre + disc * item.radius)[None], item.colour)
    size = item.radius * (1.45 if len(item.text) < 2 else 1.15)
    _centred(canvas, item, size)


def _centred(canvas: Picture, item: scenes.Badge, size: float) -> None:
    """Draw the text of a badge centred on its visible pixels."""
    # drawn enlarged on a mask and shrunk, for a sub-pixel position
    zoom = 4
    side = int(np.ceil(size * zoom * (1.2 + 0.6 * len(item.text))))
    ink = np.zeros((side, side, 3), dtype=np.uint8)
    _put(ink, item.text, (int(0.1 * side), int(0.75 * side)), size * zoom, (255, 255, 255), True)
    rows, columns = np.nonzero(ink[..., 0])
    if len(rows) == 0:
        return
    middle = np.array([columns.min() + columns.max() + 1, rows.min() + rows.max() + 1]) / 2
    left, top = int(item.x - item.radius), int(item.y - item.radius)
    span = int(2 * item.radius) + 2
    shift = np.array([item.x - left, item.y - top]) + 0.5
    affine = np.array([[1 / zoom, 0, shift[0] - middle[0] / zoom - 0.5 + 0.5 / zoom],
                       [0, 1 / zoom, shift[1] - middle[1] / zoom - 0.5 + 0.5 / zoom]])  # fmt: skip
    soft = cv2.GaussianBlur(ink[..., 0], (0, 0), zoom / 2.5)
    alpha = cv2.warpAffine(soft, affine, (span, span), flags=cv2.INTER_LINEAR)
    height, width = canvas.shape[:2]
    y0, y1 = max(0, top), min(height, top + span)
    x0, x1 = max(0, left), min(width, left + span)
    if y1 <= y0 or x1 <= x0:
        return
    weight = alpha[y0 - top : y1 - top, x0 - left : x1 - left, None] / 255.0
    window = canvas[y0:y1, x0:x1]
    window[:] = np.round(window * (1 - weight) + np.array(bgr(text_on(item.colour))) * weight)


def _text(canvas: Picture, item: scenes.Label) -> None:
    place = (round(item.x), round(item.y))
    _put(canvas, item.text, place, item.size, bgr(item.colour), item.bold)


def _put(
    canvas: Picture, text: str, place: tuple[int, int], size: float, colour: Colour, bold: bool
) -> None:
    face = _font()
    if face is not None:  # OpenCV 5 has outline fonts with weights
        cv2.putText(canvas, text, place, colour, face, max(6, round(size)), 700 if bold else 400)
        return
    thickness = max(1, round(size / (9 if bold else 16)))
    plain = text.encode("ascii", "replace").decode()
    font = cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(canvas, plain, place, font, size / 30, colour, thickness, cv2.LINE_AA)


@cache
def _font() -> Any:
    return cv2.FontFace("sans") if hasattr(cv2, "FontFace") else None
