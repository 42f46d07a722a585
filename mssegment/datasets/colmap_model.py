"""COLMAP's sparse models: where each 3-D point was seen, from ``images.txt`` or ``images.bin``."""

from __future__ import annotations

import re
import struct

import numpy as np

from mssegment.datasets.base import (
    ImportedTracks,
    check_points,
    frames_inside,
    size_that_holds,
    unseen,
)
from mssegment.datasets.containers import InputFile
from mssegment.errors import DataError
from mssegment.records import Floats, Integers, Tracks

_CENTRE = 0.5
"""COLMAP's centre of the first pixel."""
_NONE = -1
"""Identifier of a keypoint that belongs to no 3-D point."""
_POSE = struct.Struct("<I7dI")
"""Identifier, quaternion, translation, camera."""

Seen = tuple[str, Floats, Integers]
"""The name of an image, the positions [n, 2] of its keypoints, and their 3-D points [n]."""


def read_images(text: str, file: InputFile) -> ImportedTracks:
    """Read ``images.txt``: two lines for each image, the pose and ``x y point`` in turn.

    Raises DataError, with the line, for a damaged file.
    """
    images: list[Seen] = []
    name = ""
    for number, line in enumerate(text.splitlines(), 1):
        if line.lstrip().startswith("#"):
            continue
        if not name:
            words = line.split(maxsplit=9)
            if not words:
                continue
            if len(words) != 10:
                raise DataError(
                    f"{file.name}: line {number}: {len(words)} fields; expected IMAGE_ID, QW, QX, "
                    "QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"
                )
            name = words[9].strip()
            continue
        try:
            values = np.array(line.split(), dtype=np.float64).reshape(-1, 3)
            images.append((name, values[:, :2], _identifiers(values[:, 2])))
        except ValueError:
            raise DataError(
                f"{file.name}: line {number}: expected x, y and POINT3D_ID of each keypoint"
            ) from None
        name = ""
    return _tracks(images, file)


def read_binary_images(file: InputFile) -> ImportedTracks:
    """Read ``images.bin``; raises DataError for a damaged file, or another one of the model."""
    base = re.split(r"[\\/]", file.name)[-1]
    if base.lower() != "images.bin":
        raise DataError(
            f"{file.name}: {base} of a COLMAP model has no positions in pictures; give its "
            "images.bin, or database.db for the matches of a pair"
        )
    images: list[Seen] = []
    content, place = file.content, 8
    try:
        (count,) = struct.unpack_from("<Q", content)
        for _ in range(count):
            place += _POSE.size
            end = content.index(b"\0", place)
            name = content[place:end].decode("utf-8", "replace")
            (keypoints,) = struct.unpack_from("<Q", content, end + 1)
            kind = np.dtype([("xy", "<f8", 2), ("point", "<i8")])
            values = np.frombuffer(content, kind, count=keypoints, offset=end + 9)
            images.append((name, values["xy"].copy(), values["point"].astype(np.int64)))
            place = end + 9 + values.nbytes
    except (struct.error, ValueError, OverflowError):
        raise DataError(f"{file.name}: a damaged COLMAP model; copy it again") from None
    return _tracks(images, file)


def _identifiers(values: Floats) -> Integers:
    if not np.isfinite(values).all() or (np.abs(values) > 2**53).any():
        raise ValueError("identifiers are whole numbers")
    return values.astype(np.int64)


def _tracks(images: list[Seen], file: InputFile) -> ImportedTracks:
    """A track for each 3-D point, in the order of the names of the images.

    Keypoints without a 3-D point are left out. Where a point has two keypoints in an image, the
    first counts.
    """
    images = sorted(images, key=lambda image: image[0])
    found = np.unique(np.concatenate([own[2] for own in images] or [np.empty(0, np.int64)]))
    found = found[found != _NONE]
    points = unseen(len(found), len(images), file.name)
    for frame, (_, places, own) in enumerate(images):
        known = np.flatnonzero(own != _NONE)[::-1]
        points[np.searchsorted(found, own[known]), frame] = places[known] - _CENTRE
    if np.isinf(points).any():
        raise DataError(f"{file.name}: holds infinity; expected pixels")
    points[np.isnan(points).any(axis=-1)] = np.nan
    check_points(points, file.name)
    shown = f"{images[0][0]} ... {images[-1][0]}"
    notes = (
        f"COLMAP model: {len(found)} points in {len(images)} images ({shown}); what moves by "
        "itself is often missing from it",
    )
    frames = frames_inside(file.name, file.content, range(len(images)), *size_that_holds(points))
    return ImportedTracks(
        file.path.stem, Tracks(points), frames, ids=tuple(map(str, found.tolist())), notes=notes
    )
