"""PASCAL VOC's XML: boxes, and the polygons that some programs write beside them."""

from __future__ import annotations

from collections import Counter
from xml.etree.ElementTree import Element

from mssegment.annotations.base import (
    Shape,
    ShapedFrame,
    ShapeFormat,
    Tree,
    box_outline,
    polygon_of,
)
from mssegment.errors import DataError
from mssegment.records import Floats


def recognises(tree: Tree) -> bool:
    """Whether an XML file is one of VOC."""
    return isinstance(tree, Element) and tree.tag == "annotation"


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """The objects of a picture; of one without a polygon its box.

    An object is a name with its place among its like. Raises DataError for damaged entries.
    """
    count: Counter[str] = Counter()
    shapes = []
    boxes = 0
    try:
        for element in tree.iter("object"):
            label = element.findtext("name", "object")
            polygon = element.find("polygon")
            outline = _box(element) if polygon is None else _polygon(polygon, path)
            boxes += polygon is None
            shapes.append(Shape((label, count[label]), label, (polygon_of(outline, path),)))
            count[label] += 1
        size = [int(tree.findtext(f"size/{side}", "0")) for side in ("width", "height")]
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError(f"{path}: damaged labels of VOC ({error}); export them again") from None
    name = tree.findtext("filename") or path
    notes = [f"{path}: {boxes} boxes, which are more than their objects"] if boxes else []
    return [
        ShapedFrame(
            name, None, size[0], size[1], tuple(shapes), has_size=tree.find("size") is not None
        )
    ], notes


def _box(element: Element) -> Floats:
    box = element.find("bndbox")
    if box is None:
        raise ValueError("an object without a box")
    return box_outline(*(float(box.findtext(n, "")) for n in ("xmin", "ymin", "xmax", "ymax")))


def _polygon(element: Element, path: str) -> Floats:
    """Elements x1, y1, x2, y2, ..., or pt with x and y."""
    points = [[pt.findtext("x"), pt.findtext("y")] for pt in element.iter("pt")]
    values = [child.text for child in element if child.tag[:1] in "xy"]
    return polygon_of(points or values, path)


VOC = ShapeFormat("voc", "VOC XML", recognises, read)
