"""Ground-truth labels in files, converted to one true label per track.

A CSV holds labelled points. An image is the mask of one frame: 0 no object, n object n, 255 ignore.
If there is one mask per frame, they belong to the frames in order; otherwise the number in the name
of a mask identifies its frame.
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
    """Read the true label of every track.

    Parameters
    ----------
    paths : sequence of str
        One CSV of labelled points, or mask images.
    tracks : Tracks
        The tracks [P, F, 2] in pixels.
    frames : sequence of Frame
        The frames of the tracks.
    radius : float
        Maximum distance in pixels from a labelled point to its track.

    Returns
    -------
    ndarray [P] of int64
        1..n for a motion, 0 outlier, ``IGNORED`` where there is no label.

    Raises
    ------
    DataError
        If a file cannot be read, a mask belongs to no frame or has another size, or no track gets
        a label.
    """
    tables = [path for path in paths if Path(path).suffix.lower() == ".csv"]
    if tables and len(paths) > 1:
        raise DataError(
            f"{', '.join(paths)}: expected either one CSV of labels or mask images, not both"
        )
    if tables:
        places, labels = read_located_labels(Path(tables[0]))
        found = labels_from_points(tracks.points, places, labels, radius)
        hint = f"none lies within {radius:g} px of a track; do they belong to the same images?"
    else:
        masks = _read_masks(paths, frames)
        found = labels_from_masks(tracks.points, masks)
        hint = "every visible point lies outside the masks or where they are 255 (ignore)"
    if len(found) and (found == IGNORED).all():
        raise DataError(f"{', '.join(paths)}: the labels match no track: {hint}")
    return found


def check_labels(paths: Sequence[str]) -> None:
    """Check before the first stage that label files can be read; raises DataError if not.

    Whether the labels match the tracks can only be checked once there are tracks.
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
                f"{path}: the mask is {mask.shape[1]}x{mask.shape[0]}; expected {width}x{height}, "
                "the size of the frames"
            )
        masks[place] = _one_channel(mask, path)
    return masks


def _one_channel(mask: Integers, path: str) -> Integers:
    if mask.ndim == 2:
        return mask
    colours = mask[..., :3]
    if (colours != colours[..., :1]).any():
        raise DataError(
            f"{path}: found a coloured mask; expected grey values: 0 no object, n object n"
        )
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
                f"{path}: no frame has this number; give one mask per frame, or name each mask "
                "like the frame that it labels (frame-3.png, mask-3.png)"
            )
        places.append(numbers.index(_number(path)))
    return places


def _number(path: str) -> int | None:
    digits = re.findall(r"\d+", Path(path).stem)
    return int(digits[-1]) if digits else None
