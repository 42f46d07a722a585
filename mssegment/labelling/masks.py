"""Mask pictures from hand-drawn polygons: 0 no motion, n motion n, 255 ignored."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import cv2
import msgspec
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.records import Frame

IGNORE = 255
"""Mask value of pixels that do not count."""
POLYGONS = "polygons.json"
"""File with the polygons themselves, from which drawing continues later."""


class Polygon(msgspec.Struct, forbid_unknown_fields=True):
    """Label and vertices (x, y), in pixels of the frame; later polygons cover earlier ones."""

    label: int
    points: list[tuple[float, float]]


class Drawing(msgspec.Struct, forbid_unknown_fields=True):
    """The polygons of every frame, in drawing order."""

    frames: list[list[Polygon]]


def read_drawing(content: bytes, frames: Sequence[Frame]) -> Drawing:
    """Parse and check the JSON of a drawing; raises DataError if it does not fit the frames."""
    try:
        drawing = msgspec.json.decode(content, type=Drawing)
    except (msgspec.DecodeError, RecursionError) as error:
        raise DataError(f"not a list of polygons per frame: {error}") from None
    vertices = sum(len(polygon.points) for own in drawing.frames for polygon in own)
    limits.check("polygon_vertices", vertices, "polygons")
    if len(drawing.frames) != len(frames):
        raise DataError(f"polygons of {len(drawing.frames)} frames, expected {len(frames)}")
    for i, (frame, polygons) in enumerate(zip(frames, drawing.frames, strict=True)):
        for polygon in polygons:
            _check(polygon, frame, i)
    return drawing


def _check(polygon: Polygon, frame: Frame, index: int) -> None:
    """Raise DataError for a label or vertices that cannot be drawn."""
    if not 0 <= polygon.label <= IGNORE:
        raise DataError(f"frame {index + 1}: label {polygon.label}, expected 0 to {IGNORE}")
    if len(polygon.points) < 3:
        raise DataError(
            f"frame {index + 1}: polygon with {len(polygon.points)} vertices, expected 3 or more"
        )
    vertices = np.array(polygon.points)
    size = np.array([frame.width, frame.height])
    far = ~np.isfinite(vertices) | (np.abs(vertices - size / 2) > size)
    if far.any():
        x, y = vertices[far.any(axis=1)][0]
        raise DataError(
            f"frame {index + 1}: vertex ({x:g}, {y:g}) far outside the picture, expected it within "
            f"{frame.width}x{frame.height} pixels"
        )


def mask_of(polygons: Sequence[Polygon], frame: Frame) -> npt.NDArray[np.uint8]:
    """The mask [height, width] of one frame; pixels outside all polygons are 0."""
    mask = np.zeros((frame.height, frame.width), dtype=np.uint8)
    for polygon in polygons:
        vertices = np.round(np.array(polygon.points) * 16).astype(np.int32)  # 4 fractional bits
        cv2.fillPoly(mask, [vertices], polygon.label, cv2.LINE_8, 4)
    return mask


def mask_files(drawing: Drawing, frames: Sequence[Frame]) -> dict[str, bytes]:
    """Encode the masks of a drawing.

    File names end in the number of their frame, by which ``--labels`` assigns them. Frames without
    polygons have no mask then. If file names do not number the frames uniquely, every frame has a
    mask, which is 255 (ignored) throughout without polygons.

    Parameters
    ----------
    drawing : Drawing
        The polygons of every frame.
    frames : sequence of Frame
        The frames.

    Returns
    -------
    dict of str to bytes
        File name -> content of the PNG.
    """
    numbers = [frame.index if frame.index is not None else _number(frame) for frame in frames]
    unique = None not in numbers and len(set(numbers)) == len(numbers)
    files: dict[str, bytes] = {}
    for i, (frame, polygons) in enumerate(zip(frames, drawing.frames, strict=True)):
        if polygons:
            mask = mask_of(polygons, frame)
        elif unique:
            continue
        else:
            mask = np.full((frame.height, frame.width), IGNORE, dtype=np.uint8)
        width = len(str(len(frames)))
        name = f"mask-{numbers[i]}.png" if unique else f"mask-{i + 1:0{width}d}.png"
        files[name] = bytes(cv2.imencode(".png", mask)[1].tobytes())
    return files


def _number(frame: Frame) -> int | None:
    """The last number in the name of a file."""
    digits = re.findall(r"\d+", PurePath(frame.path).stem)
    return int(digits[-1]) if digits else None


def encode_drawing(drawing: Drawing) -> bytes:
    """The drawing as JSON."""
    return msgspec.json.encode(drawing) + b"\n"


def initial_state(
    frames: Sequence[Frame], drawing: Drawing, styles: Sequence[dict[str, Any]]
) -> bytes:
    """The JSON from which the page starts: frames, polygons so far, and styles of the labels."""
    return msgspec.json.encode(
        {
            "frames": [
                {"name": frame.path, "width": frame.width, "height": frame.height}
                for frame in frames
            ],
            "polygons": drawing.frames,
            "styles": styles,
        }
    )
