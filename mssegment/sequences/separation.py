"""Objects that were two and now move as one: they meet, or follow each other closely.

What moves alike and touches looks like one object, but it is two if it was two before. Tracks that
go on from an object keep to it, and new ones belong to the nearest of those.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers
from mssegment.sequences.parts import LEAST_OBJECT

LEAST_TOGETHER = 2
"""Windows in which two objects have been seen apart: in one window an object may be in pieces."""


def separated(
    points: Floats,
    labels: Integers,
    usual: Integers,
    together: dict[int, dict[int, int]],
) -> tuple[Integers, tuple[int, ...]]:
    """Separate the motions in which objects go on that have been two.

    Parameters
    ----------
    points : ndarray [P, L, 2]
        Tracks in pixels, NaN where a point is not visible.
    labels : ndarray [P] of int64
        1..m for a motion.
    usual : ndarray [P] of int64
        The object that each track was of most often; -1 for new ones, 0 for the static world.
    together : dict
        In how many windows two objects have been seen: by the smaller and the larger number.

    Returns
    -------
    labels : ndarray [P] of int64
        1..n, n >= m.
    sources : tuple of int
        For each label above m, the label that it was separated from.
    """
    found, sources = labels.copy(), []
    count = int(labels.max(initial=0))
    motions = {
        known: _motion_of(labels, usual == known) for known in np.unique(usual[usual > 0]).tolist()
    }
    for label in range(1, count + 1):
        own = labels == label
        objects = _apart(
            [k for k, motion in motions.items() if motion == label], own, usual, together
        )
        for known in objects[1:]:
            sources.append(label)
            nearest = _nearest_object(points, own, usual, objects)
            found[own & (nearest == known)] = count + len(sources)
    return found, tuple(sources)


def _motion_of(labels: Integers, of_object: Flags) -> int:
    """The motion that most tracks of an object are of now; 0 for none."""
    now = labels[of_object & (labels > 0)]
    return int(np.bincount(now).argmax()) if 2 * len(now) >= max(of_object.sum(), 1) else 0


def _apart(
    objects: list[int], own: Flags, usual: Integers, together: dict[int, dict[int, int]]
) -> list[int]:
    """The objects in a motion that have all been seen apart, that of most tracks first."""
    size = {known: int((own & (usual == known)).sum()) for known in objects}
    found: list[int] = []
    for known in sorted(objects, key=lambda k: (-size[k], k)):
        seen = [together.get(min(k, known), {}).get(max(k, known), 0) for k in found]
        if size[known] >= LEAST_OBJECT and all(count >= LEAST_TOGETHER for count in seen):
            found.append(known)
    return found


def _nearest_object(points: Floats, own: Flags, usual: Integers, objects: list[int]) -> Integers:
    """The object of each track of a motion: its own, or that of the track nearest to it."""
    found = np.where(own, usual, -1)
    known = np.flatnonzero(own & np.isin(usual, objects))
    visible = np.asarray(np.isfinite(points[..., 0]))
    for row in np.flatnonzero(own & ~np.isin(usual, objects)):
        frames = np.flatnonzero(visible[row])
        frame = frames[len(frames) // 2]
        others = known[visible[known, frame]]
        found[row] = objects[0]
        if len(others):
            apart = np.linalg.norm(points[others, frame] - points[row, frame], axis=1)
            found[row] = usual[others[apart.argmin()]]
    return found
