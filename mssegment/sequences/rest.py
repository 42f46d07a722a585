"""Objects that stand still, and move on.

An object at rest is seen by its tracks among those of the static world. If they end before it moves
on, by a tracker whose tracks are short, no track tells what moves on there: its place does. What
was there stands there no longer.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mssegment.records import Floats, Record
from mssegment.sequences.extent import MARGIN, core_box
from mssegment.special import nan_median


class Resting(Record, frozen=True):
    """Where an object stands still in a window.

    Attributes
    ----------
    low, high : tuple of float
        Its least and its greatest x and y, in pixels.
    points : ndarray [n, L, 2]
        Its tracks.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    points: Floats

    @classmethod
    def of(cls, points: Floats) -> Resting:
        """From the tracks [n, L, 2] that stand still, NaN where they are not visible."""
        low, high = core_box(nan_median(points, axis=1))
        return cls((float(low[0]), float(low[1])), (float(high[0]), float(high[1])), points)

    def distance(self, points: Floats) -> float:
        """How far tracks [m, L, 2] that move begin from its middle, 1 at its border.

        Infinite if most of its own tracks are still there when these are seen last.
        """
        seen = np.isfinite(points[..., 0])
        frames = np.flatnonzero(2 * seen.sum(axis=0) >= seen.sum(axis=0).max(initial=0))
        if not seen.any() or 2 * np.isfinite(self.points[:, frames[-1], 0]).sum() > len(
            self.points
        ):
            return np.inf
        place = np.median(points[seen[:, frames[0]], frames[0]], axis=0)
        low, high = np.array(self.low), np.array(self.high)
        half = np.maximum((high - low) / 2, 1.0)
        return float(np.max(np.abs(place - (low + high) / 2) / half))


def moving_on(motions: Mapping[int, Floats], resting: Mapping[int, Resting]) -> dict[int, int]:
    """The objects that move on: by the motion that begins where one stood.

    Parameters
    ----------
    motions : mapping of int to ndarray [m, L, 2]
        The tracks of each motion that is no known object.
    resting : mapping of int to Resting
        The objects that stand still, and move with no known motion.
    """
    near = sorted(
        (distance, motion, known)
        for motion, points in motions.items()
        for known, one in resting.items()
        if (distance := one.distance(points)) <= 1 + MARGIN
    )
    found: dict[int, int] = {}
    for _, motion, known in near:
        if motion not in found and known not in found.values():
            found[motion] = known
    return found
