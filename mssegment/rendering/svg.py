"""Write a scene as SVG: photographs embedded as JPEG, everything over them as vectors."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from mssegment.records import Floats
from mssegment.rendering import scene as scenes
from mssegment.rendering.markup import escape
from mssegment.rendering.report import Picture
from mssegment.rendering.style import PAPER, hexadecimal, text_on

FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif"


def write_svg(scene: scenes.Scene, title: str = "") -> str:
    """The scene as the text of an SVG file; ``title`` is its accessible name."""
    size = f'width="{scene.width}" height="{scene.height}"'
    # the centre of the first pixel is at 0 in a scene, at 1/2 in SVG
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} '
        f'viewBox="-0.5 -0.5 {scene.width} {scene.height}" font-family="{escape(FONT)}">',
        f"<title>{escape(title)}</title>" if title else "",
        f'<rect x="-0.5" y="-0.5" {size} fill="{hexadecimal(PAPER)}"/>',
    ]
    parts += [_photograph(x, y, picture) for x, y, picture in scene.photographs]
    parts += [_item(item) for item in scene.items]
    return "\n".join(part for part in [*parts, "</svg>"] if part) + "\n"


def data_url(picture: Picture, quality: int = 90) -> str:
    """A picture (BGR) as a JPEG ``data:`` URL; ``quality`` 0 to 100."""
    _, encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return "data:image/jpeg;base64," + base64.b64encode(encoded.tobytes()).decode()


def path_of(points: Floats, closed: bool) -> str:
    """SVG path data through ``points`` [n, 2], with two decimals."""
    numbers = " L".join(f"{x:.2f} {y:.2f}" for x, y in points)
    return f"M{numbers}{'Z' if closed else ''}"


def _photograph(x: int, y: int, picture: Picture) -> str:
    height, width = picture.shape[:2]
    return (
        f'<image x="{x - 0.5}" y="{y - 0.5}" width="{width}" height="{height}" '
        f'href="{data_url(picture)}"/>'
    )


def _item(item: scenes.Item) -> str:
    match item:
        case scenes.Markers():
            return _markers(item)
        case scenes.Lines():
            return _lines(item)
        case scenes.Areas():
            path = "".join(path_of(contour, True) for contour in item.contours)
            colour = hexadecimal(item.colour)
            return (
                f'<path d="{path}" fill="{colour}" fill-opacity="{item.opacity}" '
                f'stroke="{colour}" stroke-width="{item.width:.2f}" stroke-linejoin="round"/>'
            )
        case scenes.Badge():
            return _badge(item)
        case scenes.Label():
            weight = ' font-weight="700"' if item.bold else ""
            return (
                f'<text x="{item.x:.2f}" y="{item.y:.2f}" font-size="{item.size:.2f}"{weight} '
                f'fill="{hexadecimal(item.colour)}">{escape(item.text)}</text>'
            )


def _lines(item: scenes.Lines) -> str:
    path = "".join(path_of(path, False) for path in item.paths if len(path) > 1)
    heads = "".join(path_of(head, True) for head in item.heads)
    colour = hexadecimal(item.colour)
    return (
        f'<g opacity="{item.opacity}"><path d="{path}" fill="none" stroke="{colour}" '
        f'stroke-width="{item.width:.2f}" stroke-linejoin="round"/>'
        f'<path d="{heads}" fill="{colour}"/></g>'
    )


def _markers(item: scenes.Markers) -> str:
    outline = scenes.OUTLINES[item.shape] * item.radius
    path = "".join(path_of(np.round(point + outline, 2), True) for point in item.points)
    colour = hexadecimal(item.colour)
    if item.shape == "ring":
        return f'<path d="{path}" fill="none" stroke="{colour}"/>'
    halo = f' stroke="#fff" stroke-width="{2 * item.halo:.2f}" paint-order="stroke"'
    return f'<path d="{path}" fill="{colour}"{halo if item.halo else ""}/>'


def _badge(item: scenes.Badge) -> str:
    size = item.radius * (1.45 if len(item.text) < 2 else 1.15)
    return (
        f'<circle cx="{item.x:.2f}" cy="{item.y:.2f}" r="{item.radius:.2f}" '
        f'fill="{hexadecimal(item.colour)}" stroke="#fff" stroke-width="{item.radius * 0.16:.2f}"/>'
        f'<text x="{item.x:.2f}" y="{item.y + 0.36 * size:.2f}" font-size="{size:.2f}" '
        f'font-weight="700" text-anchor="middle" '
        f'fill="{hexadecimal(text_on(item.colour))}">{escape(item.text)}</text>'
    )
