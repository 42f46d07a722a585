"""CVAT XML, for images and for video."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from xml.etree.ElementTree import Element

import numpy as np

from mssegment.annotations.base import (
    Shape,
    ShapedFrame,
    ShapeFormat,
    Tree,
    box_outline,
    ellipse_outline,
    polygon_of,
    turned,
)
from mssegment.errors import DataError
from mssegment.records import Floats

_AREAS = ("polygon", "box", "ellipse", "mask")


def recognises(tree: Tree) -> bool:
    """Whether an XML file is one of CVAT."""
    return isinstance(tree, Element) and tree.tag == "annotations"


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """Polygons, boxes, ellipses and masks: by picture, or of tracks through the frames of a video.

    A track is one object; in pictures an object is a label with its group, or its place among its
    like. Shapes that are outside, and lines and points, are left out. Raises DataError for damaged
    shapes.
    """
    try:
        frames = [*_images(tree, path), *_tracks(tree, path)]
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise DataError(f"{path}: damaged CVAT labels ({error}); export them again") from None
    return frames, []


def _images(tree: Element, path: str) -> Iterator[ShapedFrame]:
    for image in tree.iter("image"):
        count: Counter[str] = Counter()
        shapes: list[Shape] = []
        width, height = int(image.attrib["width"]), int(image.attrib["height"])
        for element in image:
            if element.tag not in _AREAS:
                continue
            label, group = element.attrib["label"], element.get("group_id")
            key = (label, group) if group else (label, f"#{count[label]}")
            count[label] += not group
            shapes.append(_shape(element, key, label, (width, height), path))
        if shapes:
            yield ShapedFrame(image.attrib["name"], None, width, height, tuple(shapes))


def _tracks(tree: Element, path: str) -> Iterator[ShapedFrame]:
    size = tree.find(".//original_size")
    by_frame: dict[int, list[Shape]] = {}
    for track in tree.iter("track"):
        if size is None:
            raise DataError(f"{path}: no original_size; export the labels again")
        extent = int(size.findtext("width", "0")), int(size.findtext("height", "0"))
        for element in track:
            if element.tag in _AREAS and element.get("outside", "0") != "1":
                key = ("track", track.attrib["id"])
                shape = _shape(element, key, track.attrib["label"], extent, path)
                by_frame.setdefault(int(element.attrib["frame"]), []).append(shape)
    for frame, shapes in sorted(by_frame.items()):
        yield ShapedFrame(f"frame {frame}", frame, *extent, tuple(shapes))


def _shape(
    element: Element, key: tuple[str, str], label: str, size: tuple[int, int], path: str
) -> Shape:
    rank = float(element.get("z_order", 0))
    if element.tag == "mask":
        return Shape(key, label, (), _mask(element, size), rank)
    return Shape(key, label, (_outline(element, path),), None, rank)


def _outline(element: Element, path: str) -> Floats:
    angle = np.radians(float(element.get("rotation", 0.0)))
    if element.tag == "box":
        box = box_outline(*(float(element.attrib[n]) for n in ("xtl", "ytl", "xbr", "ybr")))
        return polygon_of(turned(box, angle), path)
    if element.tag == "ellipse":
        cx, cy, rx, ry = (float(element.attrib[name]) for name in ("cx", "cy", "rx", "ry"))
        return polygon_of(ellipse_outline(np.array([cx, cy]), rx, ry, angle), path)
    points = [point.split(",") for point in element.attrib["points"].split(";")]
    return polygon_of(points, path)


def _mask(element: Element, size: tuple[int, int]) -> object:
    """Runs of background and object, in rows, within a box."""
    left, top, width, height = (int(element.attrib[n]) for n in ("left", "top", "width", "height"))
    runs = [int(run) for run in element.attrib["rle"].split(",")]
    inside = 0 <= left <= left + width <= size[0] and 0 <= top <= top + height <= size[1]
    if not inside or min(runs) < 0 or sum(runs) != width * height:
        raise ValueError("a mask that does not fill its box inside the picture")
    flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
    region = np.zeros(size[::-1], dtype=bool)
    region[top : top + height, left : left + width] = flat.reshape(height, width)
    return region


CVAT = ShapeFormat("cvat", "CVAT XML", recognises, read)
