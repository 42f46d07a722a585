"""Brightness changes between frames: a gain and an offset, estimated and undone."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.resampling import MAX_REMAP_ROWS, window_grid
from mssegment.imaging.pictures import GreyPicture
from mssegment.records import Floats, Record

Bytes = npt.NDArray[np.uint8]

STATISTICS_SIDE = 9
"""Side in pixels of the windows whose mean and standard deviation are compared."""
MIN_TEXTURE = 1.0
"""Grey levels; a window of smaller standard deviation says nothing about the gain."""
MIN_TEXTURED_WINDOWS = 8
NOTICEABLE_GAIN = 0.03
NOTICEABLE_OFFSET = 3.0
"""Grey levels."""
ABRUPT_GAIN = 1.25
"""Ratio of the contrasts of two pictures from which tracking fails unless it is undone first."""
LOW_CONTRAST_RANGE = 128.0
"""Grey levels; a first frame that uses fewer is stretched to this many."""


class PhotometricChange(Record, frozen=True):
    """The map v = ``gain`` * u + ``offset`` from grey values u of frame 1 to those of another.

    Examples
    --------
    >>> PhotometricChange(2.0, 10.0).undo(np.float32([[10, 30]]))
    array([[ 0., 10.]], dtype=float32)
    """

    gain: float = 1.0
    offset: float = 0.0

    def undo(self, picture: GreyPicture) -> GreyPicture:
        """The picture with the brightness and contrast of frame 1."""
        if self == PhotometricChange():
            return picture
        return np.asarray((picture - np.float32(self.offset)) / np.float32(self.gain))

    def then(self, further: PhotometricChange) -> PhotometricChange:
        """The combination of this change and a ``further`` one, measured after undoing this."""
        return PhotometricChange(self.gain * further.gain, self.offset + self.gain * further.offset)

    @property
    def is_noticeable(self) -> bool:
        """Whether the change exceeds noise, so that undoing it helps."""
        return abs(self.gain - 1) > NOTICEABLE_GAIN or abs(self.offset) > NOTICEABLE_OFFSET


def stretched_contrast(picture: GreyPicture | Bytes) -> PhotometricChange:
    """The change that spreads a first frame of low contrast over more grey values when undone."""
    low, high = float(picture.min()), float(picture.max())
    if high - low >= LOW_CONTRAST_RANGE or high <= low:
        return PhotometricChange()
    gain = (high - low) / LOW_CONTRAST_RANGE
    return PhotometricChange(gain, low - gain * (255 - LOW_CONTRAST_RANGE) / 2)


def abrupt_change(before: GreyPicture, after: GreyPicture) -> PhotometricChange:
    """A change of the whole picture (a flash) so strong that tracking fails with it.

    From means and standard deviations of the whole pictures; no change where it is weaker.
    """
    gain = float(after.std()) / max(float(before.std()), 1e-6)
    if 1 / ABRUPT_GAIN < gain < ABRUPT_GAIN or gain < 1e-6:
        return PhotometricChange()
    return PhotometricChange(gain, float(after.mean()) - gain * float(before.mean()))


def change_along_tracks(
    before: GreyPicture | Bytes, after: GreyPicture | Bytes, starts: Floats, ends: Floats
) -> PhotometricChange:
    """Median gain and offset between windows around tracked points.

    Unlike statistics of whole pictures, the medians are not affected by objects that enter, leave
    or are tracked wrongly.

    Parameters
    ----------
    before, after : float32 or uint8 array [height, width]
        Consecutive frames.
    starts, ends : float array [n, 2]
        Positions of the tracks in the two frames, pixels.

    Returns
    -------
    PhotometricChange
        No change where fewer than 8 windows have texture.
    """
    mean1, deviation1 = _statistics(before, starts)
    mean2, deviation2 = _statistics(after, ends)
    textured = (deviation1 > MIN_TEXTURE) & (deviation2 > MIN_TEXTURE)
    if textured.sum() < MIN_TEXTURED_WINDOWS:
        return PhotometricChange()
    gain = float(np.median(deviation2[textured] / deviation1[textured]))
    return PhotometricChange(gain, float(np.median(mean2[textured] - gain * mean1[textured])))


def _statistics(picture: GreyPicture | Bytes, points: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation of the window around each point."""
    offsets = window_grid(STATISTICS_SIDE, 1.0)
    x, y = points.astype(np.float32).T[:, :, None]
    values = [
        cv2.remap(picture, a + offsets[:, 0], b + offsets[:, 1], cv2.INTER_LINEAR)
        for a, b in zip(_blocks_of_rows(x), _blocks_of_rows(y), strict=True)
    ]
    windows = np.concatenate([np.asarray(v) for v in values])
    return windows.mean(axis=1), windows.std(axis=1)


def _blocks_of_rows(values: GreyPicture) -> list[GreyPicture]:
    """Blocks that ``cv2.remap`` takes, at least one."""
    starts = range(0, max(len(values), 1), MAX_REMAP_ROWS)
    return [values[start : start + MAX_REMAP_ROWS] for start in starts]
