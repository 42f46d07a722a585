"""Which picture belongs to which frame of tracks that were made elsewhere."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mssegment.errors import DataError
from mssegment.records import Floats, Frame, Integers


def pictures_of_frames(frames: Sequence[Frame], pictures: Sequence[Frame]) -> list[Frame]:
    """The picture of each frame of some tracks.

    Parameters
    ----------
    frames : sequence of Frame
        The frames of the tracks; ``index`` is their number in the file.
    pictures : sequence of Frame
        The opened pictures.

    Returns
    -------
    list of Frame
        All pictures in order if there are as many as frames; otherwise those whose number (in the
        file name, or in the video) is that of the frame; otherwise by place, from 0.

    Raises
    ------
    DataError
        If a frame has no picture.
    """
    if len(pictures) == len(frames):
        return list(pictures)
    numbers = [frame.index if frame.index is not None else i for i, frame in enumerate(frames)]
    by_number = {number_of(picture): picture for picture in reversed(pictures)}
    if set(numbers) <= set(by_number):
        return [by_number[number] for number in numbers]
    if max(numbers) < len(pictures):
        return [pictures[number] for number in numbers]
    raise DataError(
        f"the tracks have {len(frames)} frames, numbered {min(numbers)} to {max(numbers)}, but "
        f"--images names {len(pictures)} pictures ({pictures[0].path}, ...); give one picture per "
        "frame, or pictures with the numbers of the frames in their names"
    )


def number_of(frame: Frame) -> int | None:
    """The number of a frame: its index, or the last number in its name; None if it has none."""
    if frame.index is not None:
        return frame.index
    digits = re.findall(r"\d+", Path(frame.path).stem)
    return int(digits[-1]) if digits else None


def check_inside(points: Floats, frames: Integers, pictures: Sequence[Frame]) -> tuple[str, ...]:
    """A note if some of the visible positions [n, 2] of tracks leave the pictures of their frames.

    Raises DataError if most of them do: then the pictures are others, or of another size.
    """
    sizes = np.array([[picture.width, picture.height] for picture in pictures], dtype=np.float64)
    # half a pixel beyond the centres of the border, and one more for rounding
    outside = ((points < -1.5) | (points > sizes[frames] + 0.5)).any(axis=-1)
    if not outside.any():
        return ()
    share = outside.mean()
    size = f"{pictures[0].width}x{pictures[0].height}"
    if share > 0.5:
        raise DataError(
            f"{share:.0%} of the positions lie outside the pictures ({size} pixels); give the "
            "pictures that were tracked, at their own size"
        )
    return (f"{share:.1%} of the positions lie outside the pictures ({size} pixels)",)
