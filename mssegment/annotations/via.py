"""VGG Image Annotator: its projects, its JSON and its CSV."""

from __future__ import annotations

import csv
import io
import json
from collections import Counter
from collections.abc import Iterator, Mapping
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
from mssegment.records import Floats

_CSV = ("filename", "region_shape_attributes", "region_attributes")
_IDENTITIES = ("track_id", "track", "id", "object", "instance", "name", "label", "type", "class")
"""Attributes that say which object a region is, the most telling first."""


def recognises(tree: Tree) -> bool:
    """Whether a file is one of VIA: every picture has a name and regions."""
    if isinstance(tree, str):
        return all(name in tree.partition("\n")[0] for name in _CSV)
    return isinstance(tree, dict) and bool(_pictures(tree))


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """Polygons, rectangles, circles and ellipses of every picture.

    VIA keeps no size of pictures. Regions with the same attribute are one object, as in labelme.
    Raises DataError for damaged shapes.
    """
    left_out: Counter[str] = Counter()
    frames = []
    for name, regions in _of_csv(tree, path) if isinstance(tree, str) else _pictures(tree).items():
        count: Counter[str] = Counter()
        shapes = []
        for region in regions:
            kind, outline = _outline(region.get("shape_attributes"), path)
            if outline is None:
                left_out[kind] += 1
                continue
            label = _label(region.get("region_attributes"))
            shapes.append(Shape((label, count[label]), label, (outline,)))
            count[label] += 1
        if shapes:
            frames.append(ShapedFrame(name, None, 0, 0, tuple(shapes), has_size=False))
    notes = [f"{path}: {number} {kind}s left out" for kind, number in left_out.items()]
    return frames, notes


def _pictures(tree: Mapping[str, Any]) -> dict[str, list[Any]]:
    """The regions of each picture by its name; empty if this is no file of VIA."""
    entries = tree.get("_via_img_metadata", tree)
    if not isinstance(entries, dict) or not entries:
        return {}
    found: dict[str, list[Any]] = {}
    for entry in entries.values():
        if not isinstance(entry, dict) or not {"filename", "regions"} <= set(entry):
            return {}
        regions = entry["regions"]
        listed = list(regions.values()) if isinstance(regions, dict) else regions
        if not isinstance(listed, list) or not all(isinstance(own, dict) for own in listed):
            return {}
        found.setdefault(str(entry["filename"]), []).extend(listed)
    return found


def _of_csv(text: str, path: str) -> Iterator[tuple[str, list[Any]]]:
    found: dict[str, list[Any]] = {}
    try:
        for row in csv.DictReader(io.StringIO(text)):
            shape, label = (json.loads(row[name] or "{}") for name in _CSV[1:])
            if shape:
                region = {"shape_attributes": shape, "region_attributes": label}
                found.setdefault(row["filename"], []).append(region)
    except (csv.Error, ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: damaged labels of VIA ({error}); export them again") from None
    yield from found.items()


def _label(attributes: Any) -> str:
    """The value of the attribute that says which object it is, or of all attributes."""
    own = attributes if isinstance(attributes, dict) else {}
    chosen = next((own[name] for name in _IDENTITIES if own.get(name)), None)
    if chosen is None:
        chosen = " ".join(str(value) for value in own.values() if value) or "object"
    return " ".join(chosen) if isinstance(chosen, dict) else str(chosen)


def _outline(shape: Any, path: str) -> tuple[str, Floats | None]:
    """The kind of a shape, and its outline; None for points and lines."""
    if not isinstance(shape, dict):
        raise DataError(f"{path}: a region without a shape; export the labels again")
    kind = str(shape.get("name", "polygon"))
    try:
        if kind == "polygon":
            points = zip(shape["all_points_x"], shape["all_points_y"], strict=True)
            return kind, polygon_of([list(point) for point in points], path)
        if kind == "rect":
            x, y, width, height = (float(shape[name]) for name in ("x", "y", "width", "height"))
            return kind, polygon_of(box_outline(x, y, x + width, y + height), path)
        if kind in ("circle", "ellipse"):
            rx, ry = (shape["r"], shape["r"]) if kind == "circle" else (shape["rx"], shape["ry"])
            angle = float(shape.get("theta", 0.0))
            centre = np.array([shape["cx"], shape["cy"]], dtype=np.float64)
            return kind, polygon_of(ellipse_outline(centre, float(rx), float(ry), angle), path)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{path}: a damaged {kind} ({error}); export the labels again") from None
    return kind, None


VIA = ShapeFormat("via", "VIA JSON or CSV", recognises, read)
