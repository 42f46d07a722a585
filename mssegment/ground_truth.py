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
from mssegment.neighbours import nearest
from mssegment.records import IGNORED, Floats, Frame, Integers, Record, Tracks


class Truth(Record, frozen=True):
    """What label files say about the tracks of a scene.

    Attributes
    ----------
    labels : ndarray [P] of int64
        1..n for a motion, 0 outlier or no object, ``IGNORED`` where there is no label.
    masks : dict of int to ndarray [h, w]
        The masks by the index of their frame; empty for labelled points.
    note : str
        How much of the labels belongs to a track.
    """

    labels: Integers
    masks: dict[int, Integers]
    note: str


def true_labels(
    paths: Sequence[str], tracks: Tracks, frames: Sequence[Frame], radius: float
) -> Integers:
    """Read the true label of every track: the ``labels`` of ``read_truth``."""
    return read_truth(paths, tracks, frames, radius).labels


def read_truth(
    paths: Sequence[str], tracks: Tracks, frames: Sequence[Frame], radius: float
) -> Truth:
    """Read the true label of every track, and the masks it is from.

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
    Truth

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
    masks: dict[int, Integers] = {}
    if tables:
        places, labels = read_located_labels(Path(tables[0]))
        found = labels_from_points(tracks.points, places, labels, radius)
        note = _coverage(tracks.points, places, radius)
        hint = f"none lies within {radius:g} px of a track; do they belong to the same images?"
    else:
        masks = _read_masks(paths, frames)
        found = labels_from_masks(tracks.points, masks)
        judged = int((found != IGNORED).sum())
        note = f"{judged} of {len(found)} tracks have a label in the {_count(len(masks), 'mask')}"
        hint = "every visible point lies outside the masks or where they are 255 (ignore)"
    if len(found) and (found == IGNORED).all():
        raise DataError(f"{', '.join(paths)}: the labels match no track: {hint}")
    return Truth(found, masks, note)


def _coverage(points: Floats, places: Floats, radius: float) -> str:
    """How many labelled points [n, 2 or 4] lie near a track."""
    frames = places.shape[1] // 2
    seen = points[:, :frames]
    seen = seen[np.isfinite(seen).all(axis=(1, 2))].reshape(-1, 2 * frames)
    near = 0
    if len(seen):
        closest = seen[nearest(seen, places)[1][:, 0]]
        gaps = np.linalg.norm((places - closest).reshape(-1, frames, 2), axis=-1)
        near = int((gaps <= radius).all(axis=1).sum())
    return f"{near} of {_count(len(places), 'labelled point')} lie within {radius:g} px of a track"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


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
