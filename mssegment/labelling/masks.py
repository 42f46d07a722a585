"""Polygons drawn by a person become mask pictures: 0 none, n object n, 255 ignore."""

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
from mssegment.records import Frame

IGNORE = 255
POLYGONS = "polygons.json"
"""The file that keeps the polygons themselves, so that one can go on later."""


class Polygon(msgspec.Struct, forbid_unknown_fields=True):
    """A closed outline in pixels of its frame; a later polygon covers an earlier one."""

    label: int
    points: list[tuple[float, float]]


class Drawing(msgspec.Struct, forbid_unknown_fields=True):
    """The polygons of every frame."""

    frames: list[list[Polygon]]


def read_drawing(content: bytes, frames: Sequence[Frame]) -> Drawing:
    """The drawing in ``content``; raises DataError, in one line, where it does not fit."""
    try:
        drawing = msgspec.json.decode(content, type=Drawing)
    except msgspec.DecodeError as error:
        raise DataError(f"these are no polygons: {error}") from None
    if len(drawing.frames) != len(frames):
        raise DataError(f"polygons for {len(drawing.frames)} frames, but there are {len(frames)}")
    for i, (frame, polygons) in enumerate(zip(frames, drawing.frames, strict=True)):
        for polygon in polygons:
            _check(polygon, frame, i)
    return drawing


def _check(polygon: Polygon, frame: Frame, index: int) -> None:
    if not 0 <= polygon.label <= IGNORE:
        raise DataError(f"frame {index + 1}: label {polygon.label}, expected 0..{IGNORE}")
    if len(polygon.points) < 3:
        raise DataError(f"frame {index + 1}: a polygon of {len(polygon.points)} corners")
    corners = np.array(polygon.points)
    size = np.array([frame.width, frame.height])
    if not (np.isfinite(corners).all() and (np.abs(corners - size / 2) <= size).all()):
        raise DataError(f"frame {index + 1}: a corner lies far outside of the picture")


def mask_of(polygons: Sequence[Polygon], frame: Frame) -> npt.NDArray[np.uint8]:
    """The mask [height, width] of one frame; pixels outside of all polygons are 0."""
    mask = np.zeros((frame.height, frame.width), dtype=np.uint8)
    for polygon in polygons:
        corners = np.round(np.array(polygon.points) * 16).astype(np.int32)
        cv2.fillPoly(mask, [corners], polygon.label, cv2.LINE_8, 4)
    return mask


def mask_files(drawing: Drawing, frames: Sequence[Frame]) -> dict[str, bytes]:
    """File name -> PNG of the masks, named so that ``--labels`` finds the frame of each.

    Frames without polygons have no mask where the names tell the frames apart; else every frame
    has one, and 255 says that nobody looked at it.
    """
    numbers = [frame.index if frame.index is not None else _number(frame) for frame in frames]
    tell_apart = None not in numbers and len(set(numbers)) == len(numbers)
    files: dict[str, bytes] = {}
    for i, (frame, polygons) in enumerate(zip(frames, drawing.frames, strict=True)):
        if polygons:
            mask = mask_of(polygons, frame)
        elif tell_apart:
            continue
        else:
            mask = np.full((frame.height, frame.width), IGNORE, dtype=np.uint8)
        width = len(str(len(frames)))
        name = f"mask-{numbers[i]}.png" if tell_apart else f"mask-{i + 1:0{width}d}.png"
        files[name] = bytes(cv2.imencode(".png", mask)[1].tobytes())
    return files


def _number(frame: Frame) -> int | None:
    digits = re.findall(r"\d+", PurePath(frame.path).stem)
    return int(digits[-1]) if digits else None


def encode_drawing(drawing: Drawing) -> bytes:
    """The polygons as JSON."""
    return msgspec.json.encode(drawing) + b"\n"


def state_of(frames: Sequence[Frame], drawing: Drawing, looks: Sequence[dict[str, Any]]) -> bytes:
    """What the page needs to begin: the frames, the polygons so far, and how labels look."""
    return msgspec.json.encode(
        {
            "frames": [
                {"name": frame.path, "width": frame.width, "height": frame.height}
                for frame in frames
            ],
            "polygons": drawing.frames,
            "looks": looks,
        }
    )
