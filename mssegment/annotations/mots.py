"""MOTS: a line for each object and frame, with a compressed run-length code."""

from __future__ import annotations

import re

from mssegment.annotations.base import Shape, ShapedFrame, ShapeFormat, Tree
from mssegment.annotations.coco import decode_runs
from mssegment.errors import DataError
from mssegment.inputs import limits

_LINE = re.compile(r"(\d{1,9}) (\d{1,9}) (\d{1,9}) (\d{1,6}) (\d{1,6}) (\S+)\s*")
_IGNORED = "10000"


def recognises(tree: Tree) -> bool:
    """Whether the first line of a text is frame, object, class, height, width and a code."""
    if not isinstance(tree, str):
        return False
    match = _LINE.fullmatch(tree.lstrip().partition("\n")[0])
    return match is not None and not match[6].replace(".", "").lstrip("-").isdigit()


def read(tree: Tree, path: str) -> tuple[list[ShapedFrame], list[str]]:
    """The masks of every frame; object 10000 is a region to ignore.

    Raises DataError, with the line, for a damaged one.
    """
    frames: dict[int, list[Shape]] = {}
    sizes: dict[int, tuple[int, int]] = {}
    pixels = 0
    for number, line in enumerate(tree.splitlines(), 1):
        if not line.strip():
            continue
        match = _LINE.fullmatch(line)
        if match is None:
            raise DataError(
                f"{path}: line {number}: expected frame, object, class, height, width and the code"
            )
        frame, height, width = int(match[1]), int(match[4]), int(match[5])
        pixels += height * width
        limits.check("stack_pixels", pixels, f"{path}: all masks together")
        code = {"size": [height, width], "counts": match[6]}
        region = decode_runs(code, f"{path}: line {number}")
        if sizes.setdefault(frame, (width, height)) != (width, height):
            raise DataError(f"{path}: line {number}: a mask of another size in the same frame")
        name = "ignore" if match[2] == _IGNORED else f"object {match[2]}"
        frames.setdefault(frame, []).append(Shape(name, name, (), region))
    return [
        ShapedFrame(f"frame {frame}", frame, *sizes[frame], tuple(shapes))
        for frame, shapes in sorted(frames.items())
    ], []


MOTS = ShapeFormat("mots", "MOTS text", recognises, read)
