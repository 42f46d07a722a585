"""Which frame a mask belongs to, and masks of another size."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import PurePath

import cv2
import numpy as np

from mssegment.annotations.base import LabelledFrame
from mssegment.errors import DataError
from mssegment.records import Frame, Integers


def frames_of(
    labelled: Sequence[LabelledFrame], frames: Sequence[Frame], given: Sequence[str]
) -> tuple[dict[int, LabelledFrame], tuple[str, ...]]:
    """The labelled frame of each frame.

    Parameters
    ----------
    labelled : sequence of LabelledFrame
        The masks.
    frames : sequence of Frame
        The frames of the tracks.
    given : sequence of str
        What the user named; masks that are not named themselves (of a folder) may be left over.

    Returns
    -------
    places : dict of int to LabelledFrame
        By index of the frame: of the same file name; else of the same number; else in order, if
        there are as many; else one mask is that of the first frame.
    notes : tuple of str

    Raises
    ------
    DataError
        If a mask belongs to no frame.
    """
    stems = {PurePath(f.path).stem: i for i, f in enumerate(frames) if f.index is None}
    by_name = [stems.get(PurePath(own.name).stem) for own in labelled]
    if any(place is not None for place in by_name):
        return _assigned(labelled, by_name, given, "no frame has this name")
    numbers = {_number_of_frame(frame): i for i, frame in reversed(list(enumerate(frames)))}
    by_number = [
        numbers.get(_number(own)) if _number(own) is not None else None for own in labelled
    ]
    if all(place is not None for place in by_number) and len(set(by_number)) == len(labelled):
        return _assigned(labelled, by_number, given, "")
    if len(labelled) == len(frames):
        return dict(enumerate(labelled)), ()
    if len(labelled) == 1:
        note = f"{labelled[0].name}: taken as the mask of the first frame"
        return {0: labelled[0]}, (note,) if _number(labelled[0]) is not None else ()
    return _assigned(labelled, by_number, given, "no frame has this number")


def _assigned(
    labelled: Sequence[LabelledFrame], places: Sequence[int | None], given: Sequence[str], why: str
) -> tuple[dict[int, LabelledFrame], tuple[str, ...]]:
    left = [own for own, place in zip(labelled, places, strict=True) if place is None]
    found = {p: own for own, p in zip(labelled, places, strict=True) if p is not None}
    if left and (not found or left[0].name in given):
        raise DataError(
            f"{left[0].name}: {why}; give one mask per frame, or name each mask like the frame "
            "that it labels (frame-3.png, mask-3.png)"
        )
    if left:
        return found, (f"{len(left)} of {len(labelled)} masks belong to no frame ({why})",)
    return found, ()


def _number_of_frame(frame: Frame) -> int | None:
    return frame.index if frame.index is not None else _last_number(frame.path)


def _number(own: LabelledFrame) -> int | None:
    return own.number if own.number is not None else _last_number(own.name)


def _last_number(path: str) -> int | None:
    digits = re.findall(r"\d+", PurePath(path).stem)
    return int(digits[-1]) if digits else None


def scaled(labelled: LabelledFrame, frame: Frame) -> tuple[Integers, bool]:
    """The mask at the size of its frame, and whether it was scaled (by the nearest pixel).

    Raises DataError for a mask of another shape than the frame.
    """
    height, width = labelled.mask.shape
    if (width, height) == (frame.width, frame.height):
        return labelled.mask, False
    # a scaled size is rounded to whole pixels
    other = abs(width * frame.height / height - frame.width) > 1
    if other and abs(height * frame.width / width - frame.height) > 1:
        raise DataError(
            f"{labelled.name}: the mask is {width}x{height}; expected {frame.width}x{frame.height},"
            " the size of the frame, or the same shape"
        )
    size = (frame.width, frame.height)
    resized = cv2.resize(
        labelled.mask.astype(np.int32), size, interpolation=cv2.INTER_NEAREST_EXACT
    )
    return np.asarray(resized, dtype=np.int64), True
