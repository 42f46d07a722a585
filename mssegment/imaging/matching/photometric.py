"""The light of a frame against that of the frame before: a gain and an offset."""

from __future__ import annotations

import cv2
import numpy as np

from mssegment.imaging.matching.views import grid
from mssegment.imaging.pictures import Grey
from mssegment.records import Floats, Record

WINDOW = 9
FLAT = 1.0
CLEAR_GAIN = 0.03
CLEAR_OFFSET = 3.0
FLASH = 1.25
NARROW = 128.0
FEW = 8


class Light(Record, frozen=True):
    """Grey value v under this light was (v - ``offset``) / ``gain`` in the first frame's."""

    gain: float = 1.0
    offset: float = 0.0

    def undone(self, picture: Grey) -> Grey:
        """The picture as the first frame's light would show it."""
        if self == Light():
            return picture
        return np.asarray((picture - np.float32(self.offset)) / np.float32(self.gain))

    def then(self, other: Light) -> Light:
        """This change, followed by ``other`` on the values that this one undoes."""
        return Light(self.gain * other.gain, self.offset + self.gain * other.offset)

    @property
    def is_clear(self) -> bool:
        """Whether the change is more than noise, and worth undoing."""
        return abs(self.gain - 1) > CLEAR_GAIN or abs(self.offset) > CLEAR_OFFSET


def first_light(picture: Grey) -> Light:
    """Spreads a picture that uses few of the 256 grey values over more of them."""
    low, high = float(picture.min()), float(picture.max())
    if high - low >= NARROW or high <= low:
        return Light()
    gain = (high - low) / NARROW
    return Light(gain, low - gain * (255 - NARROW) / 2)


def flash(before: Grey, after: Grey) -> Light:
    """A change of the whole picture so strong that tracking needs it undone to begin with."""
    gain = float(after.std()) / max(float(before.std()), 1e-6)
    if 1 / FLASH < gain < FLASH or gain < 1e-6:
        return Light()
    return Light(gain, float(after.mean()) - gain * float(before.mean()))


def light_between(before: Grey, after: Grey, starts: Floats, ends: Floats) -> Light:
    """Median gain and offset between windows at ``starts`` [n, 2] and at ``ends``.

    The medians do not see bodies that come, go or are tracked wrongly, as the means of whole
    pictures do.
    """
    mean1, spread1 = _statistics(before, starts)
    mean2, spread2 = _statistics(after, ends)
    textured = (spread1 > FLAT) & (spread2 > FLAT)
    if textured.sum() < FEW:
        return Light()
    gain = float(np.median(spread2[textured] / spread1[textured]))
    return Light(gain, float(np.median(mean2[textured] - gain * mean1[textured])))


def _statistics(picture: Grey, points: Floats) -> tuple[Floats, Floats]:
    """Mean and standard deviation of the window around each point."""
    offsets = grid(WINDOW, 1.0)
    x, y = points.astype(np.float32).T[:, :, None]
    # cv2.remap takes up to 32767 rows.
    values = [
        cv2.remap(picture, a + offsets[:, 0], b + offsets[:, 1], cv2.INTER_LINEAR)
        for a, b in zip(_parts(x), _parts(y), strict=True)
    ]
    windows = np.concatenate([np.asarray(v) for v in values])
    return windows.mean(axis=1), windows.std(axis=1)


def _parts(values: Grey) -> list[Grey]:
    return [values[i : i + 16384] for i in range(0, max(len(values), 1), 16384)]
