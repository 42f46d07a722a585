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
    """

    frame: int
    position: tuple[float, float]
    velocity: tuple[float, float]
    seen: int = 0


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
    span = frames[: max(2, len(frames) // 2)] if first else frames[-max(2, len(frames) // 2) :]
    moved = points[:, span[-1]] - points[:, span[0]]
    if not np.isfinite(moved).all(axis=1).any():
        span = frames[:2] if first else frames[-2:]
        moved = points[:, span[-1]] - points[:, span[0]]
    moved = moved[np.isfinite(moved).all(axis=1)]
    if not len(moved):
        return None
    velocity = np.median(moved, axis=0) / (span[-1] - span[0])
    position = np.median(points[visible[:, frame], frame], axis=0)
    return Sight(
        start + frame,
        (float(position[0]), float(position[1])),
        (float(velocity[0]), float(velocity[1])),
    )


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
    >>> lost = [Sight(10, (100.0, 50.0), (4.0, 0.0), seen=30)]
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
    """How likely an object anywhere is as near to the prediction; 1 where it cannot be the same."""
    gap = found.frame - lost.frame
    before, now = np.array(lost.velocity), np.array(found.velocity)
    straight_on = np.array(lost.position) + gap * before
    has_left = bool((straight_on < 0).any() or (straight_on >= size).any())
    change = np.linalg.norm(now - before)
    faster = max(np.linalg.norm(now), np.linalg.norm(before))
    if not 0 < gap <= lost.seen or has_left or change > LARGEST_CHANGE * faster:
        return math.inf
    # the velocity may have changed on the way
    predicted = np.array(lost.position) + gap * (before + now) / 2
    distance = np.linalg.norm(np.array(found.position) - predicted)
    return float(np.pi * distance**2 / (size[0] * size[1]))
