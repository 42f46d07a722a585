"""Where the tracks of a group lie on the object, whenever they are seen.

The frame that moves along with a group shows its tracks at one place each, also those that are not
visible at the same time: what passes behind a post is one piece there, since the parts on both
sides overlap; two objects that follow each other at one speed are two.
"""

from __future__ import annotations

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest
from mssegment.records import Floats, Integers, Record
from mssegment.special import nan_median

LEAST_TRACKS = 3
"""Tracks that say how a group moves from one frame to the next."""
MOMENTS = 8
"""Moments at which it is looked for what lies between tracks."""
DETOUR = 1.1
"""A track lies between two others if the way over it is at most so much longer."""
SPACING_NEIGHBOUR = 3
"""The neighbour whose distance measures how densely an object is covered."""
CONNECTED = 2.0
"""Tracks that are never visible together are connected within so many typical spacings, as in
``rendering.regions.not_isolated``."""


class BodyFrame(Record, frozen=True):
    """The tracks of a group in the frame that moves along with it.

    Attributes
    ----------
    places : ndarray [n, 2]
        The median position of each track, in pixels, less the path of the group.
    spread : ndarray [n]
        The median distance of the track from its place, in pixels.
    episodes : ndarray [n] of int64
        Places of one episode can be compared: between them the path is not known.
    path : ndarray [F, 2]
        Where the group is in each frame, from where it is in the first one of an episode.
    episode : ndarray [F] of int64
        The episode of each frame.
    """

    places: Floats
    spread: Floats
    episodes: Integers
    path: Floats
    episode: Integers

    @classmethod
    def of(cls, points: Floats, shown: Flags) -> BodyFrame:
        """From tracks [n, F, 2] and the frames [n, F] in which they move with the group."""
        frames = points.shape[1]
        path = np.zeros((frames, 2))
        episode = np.zeros(frames, dtype=np.int64)
        for frame in range(1, frames):
            both = shown[:, frame - 1] & shown[:, frame]
            known = both.sum() >= LEAST_TRACKS
            step = points[both, frame] - points[both, frame - 1]
            path[frame] = path[frame - 1] + (np.median(step, axis=0) if known else 0.0)
            episode[frame] = episode[frame - 1] + (not known)
        number = shown.sum(axis=1)
        middle = (np.cumsum(shown, axis=1) == (number[:, None] + 1) // 2).argmax(axis=1)
        seen = shown & (episode == episode[middle][:, None])
        places, spread = np.zeros((len(points), 2)), np.full(len(points), np.inf)
        some = number > 0
        own = np.where(seen[..., None], points - path, np.nan)[some]
        places[some] = nan_median(own, axis=1)
        apart = np.linalg.norm(own - places[some][:, None], axis=2)
        spread[some] = nan_median(apart, axis=1)
        episodes = np.where(some, episode[middle], -1 - np.arange(len(points)))
        return cls(places, spread, episodes, path, episode)


def connections(
    points: Floats, shown: Flags, others: Floats, groups: Integers | None = None
) -> Integers:
    """Pairs of tracks of a group that are neighbours on one object.

    Parameters
    ----------
    points : ndarray [n, F, 2]
        The tracks in pixels.
    shown : ndarray [n, F] of bool
        The frames in which they move with the group.
    others : ndarray [s, F, 2]
        Tracks of the static world or of other groups, NaN where they are not visible.
    groups : ndarray [n] of int64, optional
        Only pairs across groups are wanted.

    Returns
    -------
    ndarray [k, 2] of int64
        Neighbours in the frame that moves along, without another track between them at most of the
        moments that show both.
    """
    body = BodyFrame.of(points, shown)
    spacing = spacing_of(points, shown)
    found = [np.zeros((0, 2), dtype=np.int64)]
    for episode in np.unique(body.episodes):
        rows = np.flatnonzero(body.episodes == episode)
        # what has no certain place connects nothing
        certain = body.spread[rows] <= max(spacing, float(np.median(body.spread[rows])))
        edges = _neighbours(body.places, rows[certain])
        if groups is not None:
            edges = edges[groups[edges[:, 0]] != groups[edges[:, 1]]]
        together, separated = _between(points, shown, others, edges)
        distance = np.linalg.norm(body.places[edges[:, 0]] - body.places[edges[:, 1]], axis=1)
        near = distance <= CONNECTED * spacing
        found.append(edges[np.where(together > 0, 2 * separated < together, near)])
        if groups is not None:
            continue
        _, nearest_one = nearest(body.places[rows[certain]], body.places[rows[~certain]], 1)
        found.append(np.column_stack([rows[certain][nearest_one[:, 0]], rows[~certain]]))
    return np.concatenate(found)


def _neighbours(places: Floats, rows: Integers) -> Integers:
    """Pairs [k, 2] of the ``rows`` whose places are neighbours: edges of a triangulation."""
    corners = _triangles(places[rows])
    if corners is None:
        edges = np.column_stack(np.triu_indices(len(rows), 1))
    else:
        edges = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [0, 2]]])
    return np.unique(np.sort(rows[edges], axis=1), axis=0)


def _triangles(places: Floats) -> Integers | None:
    """The triangles [k, 3] of a Delaunay triangulation; None for few places, or on one line."""
    from scipy.spatial import Delaunay, QhullError

    if len(places) < 4:
        return None
    try:
        return np.asarray(Delaunay(places, qhull_options="QJ Pp").simplices)
    except QhullError:
        return None


def _moments(shown: Flags) -> Integers:
    """Some of the frames that show a track, evenly spread."""
    frames = np.flatnonzero(shown.any(axis=0))
    count = min(len(frames), MOMENTS)
    return np.asarray(frames[np.linspace(0, len(frames) - 1, count).round().astype(int)])


def _between(
    points: Floats, shown: Flags, others: Floats, pairs: Integers
) -> tuple[Integers, Integers]:
    """At how many moments each pair is visible together, and at how many with something between."""
    together = np.zeros(len(pairs), dtype=np.int64)
    separated = np.zeros(len(pairs), dtype=np.int64)
    for frame in _moments(shown):
        both = np.flatnonzero(shown[pairs[:, 0], frame] & shown[pairs[:, 1], frame])
        here = others[np.isfinite(others[:, frame, 0]), frame]
        together[both] += 1
        if not len(both) or not len(here):
            continue
        one, two = points[pairs[both, 0], frame], points[pairs[both, 1], frame]
        low, high = np.minimum(one, two).min(axis=0), np.maximum(one, two).max(axis=0)
        here = here[((here >= low) & (here <= high)).all(axis=1)]
        way = np.linalg.norm(one[:, None] - here, axis=2) + np.linalg.norm(
            two[:, None] - here, axis=2
        )
        apart = np.linalg.norm(one - two, axis=1)
        separated[both] += (way <= DETOUR * apart[:, None]).any(axis=1)
    return together, separated


def spacing_of(points: Floats, shown: Flags) -> float:
    """The typical distance of a track from its third neighbour, in pixels."""
    found = []
    for frame in _moments(shown):
        here = points[shown[:, frame], frame]
        if len(here) > SPACING_NEIGHBOUR:
            apart = np.linalg.norm(here[:, None] - here, axis=2)
            found.append(
                np.median(np.partition(apart, SPACING_NEIGHBOUR, axis=1)[:, SPACING_NEIGHBOUR])
            )
    return float(np.median(found)) if found else 0.0
