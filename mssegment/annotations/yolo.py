"""YOLO's text files: a line for each object, in units of the picture."""

from __future__ import annotations

import re
from collections import Counter

import numpy as np

from mssegment.annotations.base import Shape, ShapedFrame, ShapeFormat, Tree, box_outline
from mssegment.errors import DataError

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LINE = re.compile(rf"\d+(?: +{_NUMBER}){{4,}} *")
_BOX = 4


def recognises(tree: Tree) -> bool:
    """Whether every line of a text is a class and coordinates between 0 and 1."""
    if not isinstance(tree, str):
        return False
    lines = [line for line in tree.splitlines() if line.strip()]
    if not lines or not all(_LINE.fullmatch(line) for line in lines):
        return False
    values = [float(word) for line in lines for word in line.split()[1:]]
    return max(values) <= 1 + 1e-6 and min(values) >= -1e-6


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """The polygons, or the boxes (centre, width, height), of the picture of the same name.

    A fifth number after a box is its confidence. An object is a class with its place among its
    like. Raises DataError for half a coordinate.
    """
    count: Counter[str] = Counter()
    shapes = []
    boxes = 0
    for number, line in enumerate(tree.splitlines(), 1):
        words = line.split()
        if not words:
            continue
        label, values = words[0], np.array([float(word) for word in words[1:]])
        if len(values) in (_BOX, _BOX + 1):
            x, y, width, height = values[:_BOX].tolist()
            outline = box_outline(x - width / 2, y - height / 2, x + width / 2, y + height / 2)
            boxes += 1
        elif len(values) % 2:
            raise DataError(
                f"{path}: line {number}: {len(values)} numbers after the class; expected x and y "
                "of each corner"
            )
        else:
            outline = values.reshape(-1, 2)
        name = f"class {label}"
        shapes.append(Shape((name, count[name]), name, (outline,)))
        count[name] += 1
    notes = [f"{path}: {boxes} boxes, which are more than their objects"] if boxes else []
    return [ShapedFrame(path, None, 0, 0, tuple(shapes), has_size=False, is_relative=True)], notes


YOLO = ShapeFormat("yolo", "YOLO text", recognises, read)
