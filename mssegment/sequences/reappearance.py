"""Objects that are hidden for a while: where and how fast they should appear again.

A motion without tracks of its past may be that of an object that was lost. It is where the object
would be at its last velocity, or it is another object that is there by chance. How often chance
would do as well is the expected number of false alarms (Desolneux, Moisan & Morel 2000): the
number of pairs compared, times the share of the picture that is as near to the prediction.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linear_sum_assignment

from mssegment.models import Flags
from mssegment.records import Floats, Record
from mssegment.special import nan_median

MAX_FALSE_ALARMS = 0.1
"""Largest expected number of objects that are taken for another one by chance, in a window."""

LARGEST_CHANGE = 0.5
"""Largest change of the velocity of an object that is hidden, relative to the larger speed."""


class Sight(Record, frozen=True):
    """Where an object is and how it moves, at the first or the last frame that shows it.

    Attributes
    ----------
    frame : int
        The frame.
    position : tuple of float
        The median of the positions of its tracks, in pixels.
    velocity : tuple of float
        The median of their displacements, in pixels a frame.
    seen : int
        For how many frames the object has been seen; a motion is predicted for as long at most.
    half_size : tuple of float
        Half of the width and of the height of its box, in pixels.
    """

    frame: int
    position: tuple[float, float]
    velocity: tuple[float, float]
    seen: int = 0
    half_size: tuple[float, float] = (0.0, 0.0)


def sight(points: Floats, start: int, *, first: bool) -> Sight | None:
    """The first or the last sight of an object, whose tracks are ``points`` [n, L, 2].

    ``start`` is the number of the first of the L frames. None if no frame shows half as many
    tracks as the frame that shows most.
    """
    visible: Flags = np.asarray(np.isfinite(points).all(axis=2))
    shown = visible.sum(axis=0)
    frames = np.flatnonzero((shown > 0) & (shown >= shown.max(initial=0) / 2))
    if len(frames) < 2:
        return None
    frame = int(frames[0] if first else frames[-1])
    velocity = velocity_of(points[:, frames[0] : frames[-1] + 1])
    if velocity is None:
        return None
    position = np.median(points[visible[:, frame], frame], axis=0)
    return Sight(
        start + frame,
        (float(position[0]), float(position[1])),
        (float(velocity[0]), float(velocity[1])),
    )


def velocity_of(points: Floats) -> Floats | None:
    """The velocity of tracks [n, F, 2] while they move, in pixels a frame.

    The median displacements from frame to frame, weighted by their lengths: an object that has
    stopped moves on with the velocity that it had. None if no frame is followed by another one.
    """
    steps = np.diff(points, axis=1)
    known = np.isfinite(steps[..., 0]).any(axis=0)
    if not known.any():
        return None
    step = nan_median(steps[:, known], axis=0)
    length = np.linalg.norm(step, axis=1)
    return np.asarray((length[:, None] * step).sum(axis=0) / max(float(length.sum()), 1e-12))


def reappeared(
    lost: list[Sight], found: list[Sight], size: tuple[int, int]
) -> list[tuple[int, int]]:
    """Pair objects that were lost with those that appear.

    Parameters
    ----------
    lost, found : list of Sight
        The last sights of the ones, the first sights of the others.
    size : tuple of int
        Width and height of the picture.

    Returns
    -------
    list of (int, int)
        Indices into both lists; the expected number of false alarms of each pair is at most
        ``MAX_FALSE_ALARMS``.

    Examples
    --------
    >>> lost = [Sight(10, (100.0, 50.0), (4.0, 0.0), seen=30, half_size=(20.0, 30.0))]
    >>> reappeared(lost, [Sight(30, (178.0, 52.0), (3.9, 0.1))], (640, 480))
    [(0, 0)]
    >>> reappeared(lost, [Sight(30, (500.0, 300.0), (-4.0, 0.0))], (640, 480))
    []
    """
    if not lost or not found:
        return []
    pairs = len(lost) * len(found)
    alarms = np.array([[pairs * _chance(a, b, size) for b in found] for a in lost])
    # what is not allowed costs more than any number of allowed pairs saves
    cost = np.where(alarms <= MAX_FALSE_ALARMS, np.log(np.maximum(alarms, 1e-12)), 0.0)
    rows, columns = linear_sum_assignment(cost)
    return [
        (int(i), int(j))
        for i, j in zip(rows, columns, strict=True)
        if alarms[i, j] <= MAX_FALSE_ALARMS
    ]


def _chance(lost: Sight, found: Sight, size: tuple[int, int]) -> float:
    """How likely an object anywhere, with any velocity, fits as well.

    It may have stopped on its way, anywhere up to where its velocity would have taken it, and a
    part of it may appear. 1 or more where it cannot be the same.
    """
    gap = found.frame - lost.frame
    before, now = np.array(lost.velocity), np.array(found.velocity)
    change = float(np.linalg.norm(now - before))
    faster = max(float(np.linalg.norm(now)), float(np.linalg.norm(before)))
    if not 0 < gap <= lost.seen or change > LARGEST_CHANGE * faster or _has_left(lost, gap, size):
        return math.inf
    # the velocity may have changed on the way
    way = gap * (before + now) / 2
    moved = np.array(found.position) - np.array(lost.position)
    length = float(np.linalg.norm(way))
    share = float(np.clip(moved @ way / max(length**2, 1e-12), 0, 1))
    distance = float(np.linalg.norm(moved - share * way))
    if distance > math.hypot(*lost.half_size):
        return math.inf
    near = (2 * length + np.pi * distance) * distance / (size[0] * size[1])
    return near * (change / max(faster, 1e-12)) ** 2


def _has_left(lost: Sight, gap: int, size: tuple[int, int]) -> bool:
    """Whether an object was leaving the picture when it was seen last."""
    position = np.array(lost.position)
    straight_on = position + gap * np.array(lost.velocity)
    half = np.array(lost.half_size)
    touches = (position - half < 0) & (straight_on < 0)
    touches |= (position + half >= size) & (straight_on >= size)
    return bool(touches.any())
