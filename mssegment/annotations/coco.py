"""COCO instances: polygons and run-length codes of many pictures in one JSON file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable
from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.annotations.base import (
    LARGEST_SIDE,
    Shape,
    ShapedFrame,
    ShapeFormat,
    Tree,
    polygon_of,
)
from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.records import Floats

_IDS = ("track_id", "instance_id", "object_id")


def recognises(tree: Tree) -> bool:
    """Whether a JSON file is one of COCO instances."""
    return isinstance(tree, dict) and {"images", "annotations"} <= set(tree)


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """The instances of every picture that has some; smaller ones lie in front.

    ``track_id``, ``instance_id`` or ``object_id`` identify an object in several pictures, and
    without them its category and place among its like. Crowds are ignored. Raises DataError for
    damaged entries.
    """
    try:
        images = {image["id"]: image for image in tree["images"]}
        names = {c["id"]: str(c.get("name", c["id"])) for c in tree.get("categories", [])}
        by_image: dict[Any, list[dict[str, Any]]] = {}
        for entry in tree["annotations"]:
            by_image.setdefault(entry["image_id"], []).append(entry)
        frames, boxes = [], 0
        for key, image in images.items():
            own = [e for e in by_image.get(key, []) if e.get("segmentation")]
            boxes += len(by_image.get(key, [])) - len(own)
            if own:
                frames.append(_frame(image, own, names, path))
    except (KeyError, TypeError, AttributeError, ValueError, OverflowError) as error:
        raise DataError(f"{path}: damaged COCO labels ({error}); export them again") from None
    notes = [f"{path}: {boxes} annotations without a segmentation left out"] if boxes else []
    return frames, notes


def _frame(
    image: dict[str, Any], entries: list[dict[str, Any]], names: dict[Any, str], path: str
) -> ShapedFrame:
    width, height = int(image["width"]), int(image["height"])
    count: Counter[Any] = Counter()
    shapes = []
    for entry in entries:
        category = entry.get("category_id")
        extra = entry.get("attributes") or {}
        found = next((s[name] for s in (entry, extra) for name in _IDS if name in s), None)
        key: Hashable = ("id", found) if found is not None else (category, count[category])
        count[category] += 1
        name = "ignore" if entry.get("iscrowd") and found is None else names.get(category, "object")
        polygons: tuple[Floats, ...] = ()
        region = None
        if isinstance(entry["segmentation"], dict):
            region = decode_runs(entry["segmentation"], path)
            if region.shape != (height, width):
                raise DataError(f"{path}: a mask of another size than its picture")
            area = int(region.sum())
        else:
            polygons = tuple(polygon_of(own, path) for own in entry["segmentation"])
            area = entry.get("area") or 0
        shapes.append(Shape(key, name, polygons, region, -float(area)))
    return ShapedFrame(str(image["file_name"]), None, width, height, tuple(shapes))


def decode_runs(code: dict[str, Any], path: str) -> npt.NDArray[np.bool_]:
    """COCO's run-length code, as a list or as compressed text, as a mask [h, w].

    Raises DataError if the runs do not fill the mask.
    """
    height, width = (int(side) for side in code["size"])
    counts = code["counts"]
    runs = counts if isinstance(counts, list) else _decompressed(str(counts))
    fits = all(isinstance(run, int) and run >= 0 for run in runs)
    is_size = 0 < height <= LARGEST_SIDE and 0 < width <= LARGEST_SIDE
    if not fits or not is_size or sum(runs) != height * width:
        raise DataError(f"{path}: a damaged run-length code; export the labels again")
    limits.check("picture_pixels", height * width, path)
    values = np.arange(len(runs)) % 2 == 1
    return np.repeat(values, runs).reshape(width, height).T


def _decompressed(text: str) -> list[int]:
    """COCO's compressed counts: 5 bits a character, and differences to the run before the last."""
    runs: list[int] = []
    value, shift = 0, 0
    for letter in text:
        bits = ord(letter) - 48
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits & 0x20:
            continue
        if bits & 0x10:
            value |= -1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value, shift = 0, 0
    return runs


COCO = ShapeFormat("coco", "COCO JSON", recognises, read)
