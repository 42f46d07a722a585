"""Where the whole of an object is while only a part of it is seen.

What passes behind something is seen in parts, before and behind it, that share no tracks. The whole
moves on as it was last seen: a part that appears inside it and moves like it belongs to it.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.records import Floats, Record, replace
from mssegment.sequences.body_frame import LEAST_TRACKS, BodyFrame
from mssegment.sequences.lifetimes import MOVED
from mssegment.sequences.parts import LARGEST_RELIEF
from mssegment.sequences.reappearance import Sight

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
        """The box of the tracks [n, L, 2] in the frame of a sight, if they begin in ``start``.

        Of all tracks from which the way to that frame is known, also if they are hidden there.
        """
        frame = seen.frame - start
        body = BodyFrame.of(points, np.asarray(np.isfinite(points[..., 0])))
        here = points[:, frame]
        hidden = np.isnan(here[:, 0])
        known = ~hidden | (body.episodes == body.episode[frame])
        low, high = core_box(np.where(hidden[:, None], body.places + body.path[frame], here)[known])
        return cls(seen.frame, (low[0], low[1]), (high[0], high[1]), seen.velocity)

    @property
    def half_size(self) -> tuple[float, float]:
        """Half of its width and of its height."""
        return (self.high[0] - self.low[0]) / 2, (self.high[1] - self.low[1]) / 2

    def updated(self, points: Floats, start: int, now: Whole) -> Whole:
        """The box after it was seen again.

        An object does not become smaller, but for what its own tracks say: where the box does, it
        is partly hidden, and its sides are where they should be by now.

        Parameters
        ----------
        points : ndarray [n, L, 2]
            The tracks of the object in the window that begins with frame ``start``.
        start : int
            The first frame of the window.
        now : Whole
            Their box.
        """
        moved = self._moved(points, start, now.frame)
        scale = _change_of_size(points, self.frame - start, now.frame - start)
        half = (np.array(self.high) - np.array(self.low)) / 2 * scale
        middle = (np.array(self.low) + np.array(self.high)) / 2 + moved
        if self.frame < start:  # it may have stopped, but what is seen of it is inside
            middle = np.clip(middle, np.array(now.high) - half, np.array(now.low) + half)
        hidden = np.array(now.high) - np.array(now.low) < 2 * half
        low = np.where(hidden, middle - half, now.low)
        high = np.where(hidden, middle + half, now.high)
        rests = now.frame > self.frame and float(np.linalg.norm(moved)) < MOVED
        velocity = self.velocity if rests else now.velocity
        return Whole(now.frame, (low[0], low[1]), (high[0], high[1]), velocity)

    def rested(self, frame: int) -> Whole:
        """The box in a later frame, up to which the object stood still."""
        return replace(self, frame=max(frame, self.frame))

    def _moved(self, points: Floats, start: int, now: int) -> Floats:
        """How far the object has moved since it was last seen, up to frame ``now``, in pixels.

        From frame to frame, whichever tracks show it; by its velocity where too few do.
        """
        usual = np.array(self.velocity)
        if now <= self.frame:
            return (now - self.frame) * usual
        first = max(start, self.frame)
        moved = (first - self.frame) * usual
        for frame in range(first - start, now - start):
            steps = points[:, frame + 1] - points[:, frame]
            steps = steps[np.isfinite(steps[:, 0])]
            known = len(steps) >= LEAST_TRACKS
            moved = moved + (np.median(steps, axis=0) if known else usual)
        return moved

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


def core_box(places: Floats) -> tuple[Floats, Floats]:
    """The least and the greatest x and y of places [n, 2], whatever single ones are wrong."""
    low, high = np.quantile(places, [CORE, 1 - CORE], axis=0)
    # a uniform distribution reaches beyond its inner quantiles
    beyond = (high - low) * CORE / (1 - 2 * CORE)
    return low - beyond, high + beyond


def _change_of_size(points: Floats, before: int, now: int) -> float:
    """By how much the tracks [n, L, 2] of an object spread or shrank between two frames.

    1 if fewer than ``LEAST_TRACKS`` tracks are visible in both.
    """
    if not 0 <= before < points.shape[1]:
        return 1.0
    both = np.isfinite(points[:, [before, now]]).all(axis=(1, 2))
    if both.sum() < LEAST_TRACKS:
        return 1.0
    sizes = [
        float(np.median(np.linalg.norm(own - np.median(own, axis=0), axis=1)))
        for own in (points[both, before], points[both, now])
    ]
    return sizes[1] / sizes[0] if min(sizes) > 0 else 1.0
