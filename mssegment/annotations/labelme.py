"""labelme: one JSON file per picture."""

from __future__ import annotations

import base64
import binascii
from collections import Counter
from typing import Any

import numpy as np

from mssegment.annotations.base import (
    Shape,
    ShapedFrame,
    ShapeFormat,
    Tree,
    box_outline,
    ellipse_outline,
    polygon_of,
)
from mssegment.errors import DataError
from mssegment.imaging.pictures import decode
from mssegment.inputs import limits
from mssegment.records import Floats


def recognises(tree: Tree) -> bool:
    """Whether a JSON file is one of labelme."""
    return isinstance(tree, dict) and {"shapes", "imagePath"} <= set(tree)


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """The polygons, rectangles and circles of a picture.

    Shapes with the same label and group are one object, and so are those with the same label and
    place among shapes of that label in several pictures. Raises DataError for damaged shapes.
    """
    shapes: list[Shape] = []
    count: Counter[str] = Counter()
    left_out: Counter[str] = Counter()
    if not isinstance(tree["shapes"], list):
        raise DataError(f"{path}: 'shapes' is no list; export the labels again")
    for entry in tree["shapes"]:
        if not isinstance(entry, dict):
            raise DataError(f"{path}: a damaged shape; export it again")
        label, group = str(entry.get("label", "")), entry.get("group_id")
        kind = str(entry.get("shape_type") or "polygon")
        outline = _outline(kind, entry.get("points"), path)
        region = _region(entry, tree, path) if kind == "mask" else None
        if outline is None and region is None:
            left_out[kind] += 1
            continue
        key = (label, str(group)) if group is not None else (label, f"#{count[label]}")
        count[label] += group is None
        polygons = () if outline is None else (outline,)
        shapes.append(Shape(key, label, polygons, region))
    width, height = tree.get("imageWidth"), tree.get("imageHeight")
    if type(width) is not int or type(height) is not int:  # true is an int, too
        raise DataError(f"{path}: no imageWidth and imageHeight; save the labels again")
    notes = [f"{path}: {number} {kind}s left out" for kind, number in left_out.items()]
    return [ShapedFrame(str(tree["imagePath"]), None, width, height, tuple(shapes))], notes


def _region(entry: dict[str, Any], tree: Tree, path: str) -> Any:
    """The pixels of a shape of the kind ``mask``: a PNG in base64, inside a box."""
    width, height = tree.get("imageWidth"), tree.get("imageHeight")
    try:
        content = base64.b64decode(str(entry.get("mask", "")), validate=True)
        own = np.asarray(decode(f"{path}: a mask", content), dtype=np.int64) > 0
        left, top = (int(value) for value in polygon_of(entry.get("points"), path).min(axis=0))
        limits.check("picture_pixels", int(height) * int(width), path)
        region = np.zeros((int(height), int(width)), dtype=bool)
        region[top : top + own.shape[0], left : left + own.shape[1]] = own.reshape(*own.shape[:2])
    except (ValueError, TypeError, binascii.Error):
        raise DataError(f"{path}: a damaged mask; save the labels again") from None
    return region


def _outline(kind: str, points: Any, path: str) -> Floats | None:
    """The outline of a shape with an area; None for points and lines."""
    if kind not in ("polygon", "rotation", "rectangle", "circle"):
        return None
    outline = polygon_of(points, path)
    if kind in ("polygon", "rotation"):
        return outline if len(outline) > 2 else None
    if len(outline) != 2:
        raise DataError(f"{path}: a {kind} of {len(outline)} points; expected 2")
    if kind == "rectangle":
        (left, top), (right, bottom) = outline.min(axis=0), outline.max(axis=0)
        return box_outline(left, top, right, bottom)
    radius = float(np.linalg.norm(outline[1] - outline[0]))
    return ellipse_outline(outline[0], radius, radius)


LABELME = ShapeFormat("labelme", "labelme JSON", recognises, read)
