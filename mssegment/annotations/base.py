"""Labelled frames, and how shapes become masks."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import cv2
import numpy as np

from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.inputs.files import read_file
from mssegment.records import Floats, Integers, Record, replace

TEXTS = (".txt", ".csv")
"""Suffixes of labels that may be text."""
IGNORE = 255
"""Value of a mask where a pixel is not counted."""
_IGNORED = frozenset(("ignore", "ignored", "void", "__ignore__", "crowd", "dontcare"))
_NOTHING = frozenset(("background", "_background_", "bg"))
_SUBPIXEL_BITS = 4
_FINER = 5
"""Samples per pixel along each axis, odd, so that one lies in the centre."""
_STRIP = 512
"""Rows of a picture that are filled at once."""
LARGEST_SIDE = 100_000
"""Largest side of a frame, in pixels, that an annotation may state."""

Tree = Any
"""A parsed JSON file, or the root element of an XML file."""


class Shape(Record, frozen=True):
    """One outline or region.

    Attributes
    ----------
    key : hashable
        What identifies its object, also in other frames.
    name : str
        What the file calls it.
    polygons : tuple of ndarray [n, 2]
        Outlines in pixels; the first pixel spans 0 to 1.
    region : ndarray [h, w] of bool, optional
        Its pixels, where the file has those.
    rank : float
        Shapes of a higher rank lie in front.
    """

    key: Hashable
    name: str
    polygons: tuple[Floats, ...] = ()
    region: Any = None
    rank: float = 0.0


class ShapedFrame(Record, frozen=True):
    """The shapes of one frame in the order of the file, and what it calls the frame.

    Width and height do not count where the file does not state them, as ``has_size`` says. Of
    ``is_relative`` frames the outlines are in units of the picture.
    """

    name: str
    number: int | None
    width: int
    height: int
    shapes: tuple[Shape, ...]
    has_size: bool = True
    is_relative: bool = False


class LabelledFrame(Record, frozen=True):
    """The mask of one frame.

    Attributes
    ----------
    name : str
        The file of the frame or of its mask.
    number : int or None
        The number of the frame, where the file states it.
    mask : ndarray [h, w] of int64
        0 no object, n object n, 255 ignore.
    """

    name: str
    number: int | None
    mask: Integers


class Annotations(Record, frozen=True):
    """All labelled frames of some files, and notes on how they were read."""

    frames: tuple[LabelledFrame, ...]
    notes: tuple[str, ...] = ()


class ShapeFormat(Record, frozen=True):
    """A format of labelled shapes: how to recognize and read a file of it.

    ``read`` takes the tree and the path, and returns the frames and notes on what it left out.
    """

    name: str
    title: str
    recognises: Callable[[Tree], bool]
    read: Callable[[Tree, str], tuple[list[ShapedFrame], list[str]]]


def load_tree(path: str) -> Tree:
    """Parse a JSON or XML file, or give a table or text as it is.

    Raises DataError if it is damaged, or defines XML entities.
    """
    try:
        content = read_file(path, expected="a file of labels")
        limits.check("text_bytes", len(content), path)
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DataError(f"{path}: cannot be read ({error})") from None
    if not text.lstrip().startswith(("<", "{", "[")) and path.lower().endswith(TEXTS):
        return text
    if not text.lstrip().startswith("<"):
        try:
            return json.loads(text)
        except (ValueError, RecursionError) as error:
            raise DataError(f"{path}: not JSON ({error})") from None
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise DataError(f"{path}: XML with a DOCTYPE is not read")
    from xml.etree import ElementTree

    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise DataError(f"{path}: not XML ({error})") from None


def numbered(
    frames: Sequence[ShapedFrame],
    notes: Sequence[str],
    paths: Sequence[str],
    size_of: Callable[[str], tuple[int, int]],
) -> Annotations:
    """Masks of frames with shapes: every object gets a number, the same in all frames.

    Objects that are named by whole numbers keep them. ``size_of`` gives the size of the picture of
    a frame whose file does not state it. Raises DataError if there is no shape.
    """
    frames = [_sized(frame, size_of) for frame in frames]
    values: dict[Hashable, int] = {}
    names: dict[Hashable, str] = {s.key: s.name for frame in frames for s in frame.shapes}
    if not names:
        raise DataError(f"{', '.join(paths)}: no shapes in these labels; draw some")
    keep = all(re.fullmatch("[0-9]{1,3}", n) and int(n) < IGNORE for n in names.values())
    for key, name in names.items():
        word = name.strip().lower()
        if word in _IGNORED:
            values[key] = IGNORE
        elif word in _NOTHING:
            values[key] = 0
        else:
            taken = sum(0 < value < IGNORE for value in values.values())
            values[key] = int(name) if keep else taken + 1
    objects = [f"{value} {names[key]}" for key, value in values.items() if 0 < value < IGNORE]
    shown = ", ".join(objects[:6]) + (", ..." if len(objects) > 6 else "")
    pixels = sum(frame.width * frame.height * _regions(frame) for frame in frames)
    limits.check("stack_pixels", pixels, f"{', '.join(paths)}: all masks together")
    drawn = [LabelledFrame(f.name, f.number, _draw(f, values)) for f in frames]
    return Annotations(tuple(drawn), (*notes, f"labelled objects: {shown}"))


def _sized(frame: ShapedFrame, size_of: Callable[[str], tuple[int, int]]) -> ShapedFrame:
    """The frame with its size, and outlines in pixels."""
    if frame.has_size:
        return frame
    width, height = size_of(frame.name)
    shapes = frame.shapes
    if frame.is_relative:
        shapes = tuple(
            replace(shape, polygons=tuple(own * [width, height] for own in shape.polygons))
            for shape in shapes
        )
    return replace(frame, width=width, height=height, shapes=shapes)


def _regions(frame: ShapedFrame) -> int:
    """The number of masks of a frame that are held in memory at once."""
    return 1 + sum(shape.region is not None for shape in frame.shapes)


def _draw(frame: ShapedFrame, values: dict[Hashable, int]) -> Integers:
    if not (0 < frame.width <= LARGEST_SIDE and 0 < frame.height <= LARGEST_SIDE):
        raise DataError(
            f"{frame.name}: a frame of {frame.width}x{frame.height} pixels; expected its size"
        )
    limits.check("picture_pixels", frame.width * frame.height, f"{frame.name}: a labelled frame")
    mask = np.zeros((frame.height, frame.width), np.int64)
    for shape in sorted(frame.shapes, key=lambda shape: shape.rank):
        if shape.region is not None:
            mask[shape.region] = values[shape.key]
        if shape.polygons:
            _fill(mask, shape.polygons, values[shape.key])
    return mask


def _fill(mask: Integers, polygons: Sequence[Floats], value: int) -> None:
    """Set the pixels whose centres lie inside outlines; each pixel spans 1 from whole numbers.

    OpenCV also draws the outline itself, half a pixel to both sides, so it fills a finer grid, and
    the sample at the centre of each pixel decides.
    """
    points = np.concatenate(polygons)
    if not len(points):
        return
    low = np.maximum(np.floor(points.min(axis=0)).astype(int), 0)
    high = np.minimum(np.ceil(points.max(axis=0)).astype(int), mask.shape[::-1])
    for top in range(low[1], high[1], _STRIP):
        # in strips: the finer grid of a large picture would take 25 times its memory
        start, stop = np.array([low[0], top]), np.array([high[0], min(top + _STRIP, high[1])])
        width, height = np.maximum(stop - start, 0)
        fine = np.zeros((height * _FINER, width * _FINER), np.uint8)
        if not fine.size:
            return
        outlines = [
            np.rint(((polygon - start) * _FINER - 0.5) * 2**_SUBPIXEL_BITS).astype(np.int32)
            for polygon in polygons
        ]
        cv2.fillPoly(fine, outlines, 1, shift=_SUBPIXEL_BITS)
        inside = fine[_FINER // 2 :: _FINER, _FINER // 2 :: _FINER] > 0
        mask[top : stop[1], start[0] : stop[0]][inside] = value


def polygon_of(values: Any, where: str) -> Floats:
    """Flat or nested coordinates as an outline [n, 2]; raises DataError for anything else."""
    try:
        found = np.asarray(values, dtype=np.float64).reshape(-1, 2)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"{where}: an outline that is no list of x, y; export it again") from None
    if not np.isfinite(found).all() or np.abs(found).max(initial=0) > LARGEST_SIDE:
        raise DataError(f"{where}: an outline that leaves every picture; export it again")
    return found


def ellipse_outline(centre: Floats, rx: float, ry: float, angle: float = 0.0) -> Floats:
    """The outline of an ellipse with these radii, turned by an angle in radians."""
    turn = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    return turned(centre + np.stack([rx * np.cos(turn), ry * np.sin(turn)], axis=1), angle)


def turned(outline: Floats, angle: float) -> Floats:
    """An outline turned about its middle, by an angle in radians from x to y."""
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.asarray(middle + (outline - middle) @ np.array([[cosine, sine], [-sine, cosine]]))


def box_outline(left: float, top: float, right: float, bottom: float) -> Floats:
    """The outline of a box."""
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], dtype=np.float64)
