"""Masks in the forms that other tools read: DAVIS, COLMAP, one file per object, COCO."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from mssegment.export import Mask
from mssegment.export.names import frame_names
from mssegment.export.png import encode_png, voc_palette
from mssegment.rendering.report import Report

FOLDER = "masks"
UNKNOWN = 255


def davis(report: Report, masks: Iterable[Mask]) -> Iterator[tuple[str, bytes]]:
    """One indexed PNG per frame, with the palette of DAVIS and PASCAL VOC.

    0 is the static world, 1, 2, ... the motions, 255 not known.
    """
    palette = voc_palette()
    for name, mask in zip(frame_names(report.frames), masks, strict=True):
        yield f"{FOLDER}/{name}.png", encode_png(mask, palette)


def colmap(report: Report, masks: Iterable[Mask]) -> Iterator[tuple[str, bytes]]:
    """One grey PNG per frame, called as the picture with ``.png`` appended.

    0 where features are to be ignored, which is on moving objects, 255 elsewhere. What is not
    known is not ignored.
    """
    for name, mask in zip(frame_names(report.frames, suffix=True), masks, strict=True):
        moves = (mask != 0) & (mask != UNKNOWN)
        yield f"{FOLDER}/{name}.png", encode_png(np.where(moves, 0, 255).astype(np.uint8))


def binary(report: Report, masks: Iterable[Mask]) -> Iterator[tuple[str, bytes]]:
    """A folder per object, with one grey PNG per frame: 255 on the object, 0 elsewhere."""
    for name, mask in zip(frame_names(report.frames), masks, strict=True):
        for motion in report.objects:
            own = np.where(mask == motion.label, 255, 0).astype(np.uint8)
            yield f"{FOLDER}/{motion.label}/{name}.png", encode_png(own)


def coco(report: Report, masks: Iterable[Mask]) -> Iterator[tuple[str, bytes]]:
    """One JSON with the objects of all frames as uncompressed run-length encodings.

    An annotation has the ``track_id`` of its motion, as the COCO form of video data sets has.
    """
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    names = frame_names(report.frames, suffix=True)
    for index, (name, mask) in enumerate(zip(names, masks, strict=True), start=1):
        height, width = mask.shape
        images.append(
            {
                "id": index,
                "file_name": name,
                "width": width,
                "height": height,
                "frame_index": index - 1,
            }
        )
        for motion in report.objects:
            own = mask == motion.label
            if own.any():
                place = {"id": len(annotations) + 1, "image_id": index}
                annotations.append(place | {"track_id": motion.label} | annotation(own))
    document = {
        "info": {"description": "mssegment: independently moving objects"},
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "moving object"}],
    }
    yield "masks.json", json.dumps(document).encode() + b"\n"


def annotation(own: np.ndarray[Any, np.dtype[np.bool_]]) -> dict[str, Any]:
    """Area, box and run-length encoding of an object that is seen, [height, width]."""
    rows, columns = np.flatnonzero(own.any(axis=1)), np.flatnonzero(own.any(axis=0))
    left, top = int(columns[0]), int(rows[0])
    return {
        "category_id": 1,
        "iscrowd": 1,  # an uncompressed encoding, by the convention of COCO
        "area": int(own.sum()),
        "bbox": [left, top, int(columns[-1]) - left + 1, int(rows[-1]) - top + 1],
        "segmentation": {"size": list(own.shape), "counts": run_lengths(own)},
    }


def run_lengths(own: np.ndarray[Any, np.dtype[np.bool_]]) -> list[int]:
    """Lengths of the runs of 0, 1, 0, ... down the columns; the first may be 0.

    Examples
    --------
    >>> run_lengths(np.array([[False, True], [True, True]]))
    [1, 3]
    """
    flat = np.asarray(own).ravel(order="F").astype(np.int8)
    changes = np.flatnonzero(np.diff(flat, prepend=0, append=-1))
    return [int(length) for length in np.diff(changes, prepend=0)]
