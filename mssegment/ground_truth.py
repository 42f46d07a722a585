"""Manual labels in files become one true label per track.

A CSV holds located points with a label; a picture is a mask of one frame (0 none, n object n, 255
ignore). Several masks belong to the frames in order when there is one for each; otherwise the
number in a mask's name says which frame it labels.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mssegment.datasets import labels_from_masks, labels_from_points, read_located_labels
from mssegment.errors import DataError
from mssegment.records import IGNORED, Frame, Integers, Tracks


def true_labels(
    paths: Sequence[str], tracks: Tracks, frames: Sequence[Frame], radius: float
) -> Integers:
    """The true label of every track [P] (0 none, 1..n, ``IGNORED``) from the files ``paths``.

    ``radius`` in pixels is how far a located point may be from its track. Raises DataError for
    files that cannot be read, masks that fit no frame, and labels that match no track.
    """
    tables = [path for path in paths if Path(path).suffix.lower() == ".csv"]
    if tables and len(paths) > 1:
        raise DataError(
            f"{', '.join(paths)}: manual labels are one CSV, or mask pictures; give one kind"
        )
    if tables:
        places, labels = read_located_labels(Path(tables[0]))
        found = labels_from_points(tracks.points, places, labels, radius)
        hint = f"none lies within {radius:g} px of a track; are these the same pictures?"
    else:
        masks = _read_masks(paths, frames)
        found = labels_from_masks(tracks.points, masks)
        hint = "every track lies where the masks say ignore"
    if len(found) and (found == IGNORED).all():
        raise DataError(f"{', '.join(paths)}: the labels match no track, {hint}")
    return found


def check_labels(paths: Sequence[str]) -> None:
    """Raises DataError, as ``true_labels`` does, for files that cannot be read; cheap, for early.

    Whether the labels fit the tracks can only be said when there are tracks.
    """
    from mssegment.imaging.frames import open_frames

    masks = [path for path in paths if Path(path).suffix.lower() != ".csv"]
    for path in paths:
        if path not in masks:
            read_located_labels(Path(path))
    if masks:
        open_frames(masks, at_least=1)


def _read_masks(paths: Sequence[str], frames: Sequence[Frame]) -> dict[int, Integers]:
    from mssegment.imaging.frames import open_frames

    source = open_frames(list(paths), at_least=1)
    width, height = frames[0].width, frames[0].height
    masks: dict[int, Integers] = {}
    for i, place in enumerate(_frames_of([frame.path for frame in source.frames], frames)):
        path, mask = source.frames[i].path, np.asarray(source.pixels(i), dtype=np.int64)
        if mask.shape[:2] != (height, width):
            raise DataError(
                f"{path}: the mask is {mask.shape[1]}x{mask.shape[0]}, "
                f"the frames are {width}x{height}; draw it on the frame itself"
            )
        masks[place] = _one_channel(mask, path)
    return masks


def _one_channel(mask: Integers, path: str) -> Integers:
    if mask.ndim == 2:
        return mask
    colours = mask[..., :3]
    if (colours != colours[..., :1]).any():
        raise DataError(f"{path}: a coloured mask; grey values 0 none, n object n were expected")
    return np.asarray(colours[..., 0])


def _frames_of(masks: Sequence[str], frames: Sequence[Frame]) -> list[int]:
    """The index of the frame that each mask labels."""
    if len(masks) == len(frames):
        return list(range(len(frames)))
    if len(masks) == 1 and _number(masks[0]) is None:
        return [0]
    numbers = [f.index if f.index is not None else _number(f.path) for f in frames]
    places = []
    for path in masks:
        if _number(path) not in numbers:
            raise DataError(
                f"{path}: no frame has this number; give one mask per frame, "
                "or name masks like the frames they label (frame-3.png, mask-3.png)"
            )
        places.append(numbers.index(_number(path)))
    return places


def _number(path: str) -> int | None:
    digits = re.findall(r"\d+", Path(path).stem)
    return int(digits[-1]) if digits else None
