"""Where the whole of an object is while only a part of it is seen.

What passes behind something is seen in parts, before and behind it, that share no tracks. The whole
moves on as it was last seen: a part that appears inside it and moves like it belongs to it.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.records import Floats, Record
from mssegment.sequences.parts import LARGEST_RELIEF
from mssegment.sequences.reappearance import Sight

HIDDEN_SHARE = 0.7
"""An object whose box has become smaller than this share, from one window to the next, is partly
hidden."""
MARGIN = 0.5
"""How far beyond its border a part of an object may appear, in halves of the sides of its box: what
appears first is at the border, and the velocity is not known exactly."""
CORE = 0.1
"""Share of the tracks beyond each side of a box, so that single wrong ones do not widen it."""


class Whole(Record, frozen=True):
    """The box of a whole object: when, where, and how it moves.

    Attributes
    ----------
    frame : int
        When it was last seen as a whole.
    low, high : tuple of float
        Its least and its greatest x and y, in pixels.
    velocity : tuple of float
        In pixels a frame.
    """

    frame: int
    low: tuple[float, float]
    high: tuple[float, float]
    velocity: tuple[float, float]

    @classmethod
    def of(cls, points: Floats, start: int, seen: Sight) -> Whole:
        """The box of the tracks [n, L, 2] in the frame of a sight, if they begin in ``start``."""
        here = points[:, seen.frame - start]
        here = here[np.isfinite(here).all(axis=1)]
        low, high = np.quantile(here, [CORE, 1 - CORE], axis=0)
        # a uniform distribution reaches beyond its inner quantiles
        beyond = (high - low) * CORE / (1 - 2 * CORE)
        low, high = low - beyond, high + beyond
        return cls(seen.frame, (low[0], low[1]), (high[0], high[1]), seen.velocity)

    @property
    def area(self) -> float:
        """The area of the box in pixels."""
        return (self.high[0] - self.low[0]) * (self.high[1] - self.low[1])

    def updated(self, now: Whole) -> Whole:
        """The box after it was seen again: the new one, or this one where it is partly hidden."""
        if now.area >= HIDDEN_SHARE * self.area:
            return now
        moved = (now.frame - self.frame) * np.array(self.velocity)
        low, high = np.array(self.low) + moved, np.array(self.high) + moved
        return Whole(now.frame, (low[0], low[1]), (high[0], high[1]), now.velocity)

    def distance(self, part: Sight) -> float:
        """How far a part that appears is from the middle of where the object should be.

        In halves of the sides of its box: 1 at its border. Infinite if it moves otherwise.
        """
        gap = part.frame - self.frame
        velocity, own = np.array(self.velocity), np.array(part.velocity)
        speed = float(np.linalg.norm(velocity))
        if not speed or np.linalg.norm(own - velocity) > LARGEST_RELIEF * speed:
            return math.inf
        low, high = np.array(self.low), np.array(self.high)
        place = np.array(part.position) - gap * velocity
        return float(np.max(np.abs(place - (low + high) / 2) / np.maximum((high - low) / 2, 1.0)))

    def holds(self, part: Sight) -> bool:
        """Whether a part that appears is inside, where the object should be, and moves like it."""
        return self.distance(part) <= 1 + MARGIN
