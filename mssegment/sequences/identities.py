"""Identities: which motions of the windows of a sequence are one object.

A motion continues the object whose tracks it shares. The assignment of motions to objects is the
one-to-one assignment with the most shared tracks, every track voting for what it has been in all
earlier windows; so an object that was joined to another one for a while, or stood still, gets its
identity back. A motion that shares too little is new, split from another one, or a hidden object
that appears again (``reappearance``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from mssegment.records import BACKGROUND, OUTLIER, Floats, Integers, State, field, replace
from mssegment.sequences.extent import Whole
from mssegment.sequences.history import STATIC_WORLD, TrackHistory, vote_table
from mssegment.sequences.parts import LEAST_OBJECT, TRACKED_WINDOW, move_alike
from mssegment.sequences.reappearance import Sight, reappeared, sight
from mssegment.sequences.rest import Resting, moving_on
from mssegment.sequences.separation import separated
from mssegment.sequences.window_labels import (
    LEAST_VOTES,
    NO_OBJECT,
    Votes,
    WindowIdentities,
    WindowLabels,
    identities_of_tracks,
    merged_into,
    net_displacement,
    parent_of,
    travel,
)

LEAST_SHARE = 0.5
"""Least share of common tracks among those of the object that go on and those of the motion that
are not new: the geometric mean of both shares. Half of the tracks are then the same."""


class IdentityTracker(State):
    """Joins windows, in their order.

    Attributes
    ----------
    size : tuple of int
        Width and height of the picture.
    history : TrackHistory
        What the tracks have been.
    objects : int
        The number of objects so far; they are numbered from 1.
    lost, last_sights : dict
        The last sight of each object that is not in the last window, and of those that are.
    first_frames : dict
        The first frame of the first window of each of them.
    sizes : dict
        How many tracks of each object a frame showed when it was last seen to move.
    wholes : dict
        The box of each object.
    together : dict
        In how many windows two of them were seen, by the smaller and the larger number.
    in_parts : set
        Those that were seen in several parts in the last window.
    """

    size: tuple[int, int]
    history: TrackHistory = field(default_factory=TrackHistory.empty)
    objects: int = 0
    lost: dict[int, Sight] = field(default_factory=dict)
    last_sights: dict[int, Sight] = field(default_factory=dict)
    first_frames: dict[int, int] = field(default_factory=dict)
    sizes: dict[int, float] = field(default_factory=dict)
    wholes: dict[int, Whole] = field(default_factory=dict)
    together: dict[int, dict[int, int]] = field(default_factory=dict)
    in_parts: set[int] = field(default_factory=set)

    def separated(self, window: WindowLabels) -> tuple[Integers, tuple[int, ...]]:
        """The labels of the next window, objects that have been two apart (``separation``)."""
        usual = self.history.usual(window.tracks)
        return separated(window.points, window.labels, usual, self.together)

    def add(self, window: WindowLabels, paused: Iterable[int] = ()) -> WindowIdentities:
        """The identities of the next window; ``paused`` tracks are not in it, but in later ones."""
        own = [np.flatnonzero(window.labels == j + 1) for j in range(window.motions)]
        votes = [self.history.votes(window.tracks[rows]) for rows in own]
        camera = self._camera(window, votes)
        dragged = self._dragged(window, own, votes)
        moving = [j for j in range(window.motions) if j != camera and j not in dragged]
        identity = dict.fromkeys(moving, 0) | dict.fromkeys(dragged, NO_OBJECT)
        if camera is not None:
            identity[camera] = STATIC_WORLD
        usual = self.history.usual(window.tracks)
        continued = self._continued([votes[j] for j in moving], usual)
        identity |= {moving[row]: known for row, known in continued.items()}
        new = [j for j in moving if not identity[j]]
        first = {j: sight(window.points[own[j]], window.start, first=True) for j in new}
        identity |= self._parts(first, self._wholes_now(window, own, identity))
        identity |= self._split_off(window, own, identity, votes)
        still = self._still(window, own, identity, usual)
        unknown = {j: window.points[own[j]] for j in new if not identity[j]}
        resting_places = {
            known: Resting.of(window.points[rows])
            for known, rows in still.items()
            if known not in identity.values()
        }
        identity |= moving_on(unknown, resting_places)
        hidden = {j: one for j, one in first.items() if not identity[j]}
        again = self._again(hidden, {*identity.values(), *still})
        identity |= again
        identity |= self._parts(
            {j: one for j, one in hidden.items() if j not in again},
            self._wholes_now(window, own, again),
        )
        origins = {}
        static_camera = bool((window.labels == BACKGROUND).any())
        for j in new:
            is_small = len(own[j]) < LEAST_OBJECT or travel(window.points[own[j]]) < TRACKED_WINDOW
            if not identity[j] and static_camera and is_small:
                identity[j] = NO_OBJECT
            elif not identity[j]:
                self.objects += 1
                identity[j] = self.objects
                parent = parent_of(votes[j])
                if parent is not None:
                    origins[self.objects] = parent
        present = set(identity.values())
        resting = tuple(known for known in still if known not in present)
        tracks = identities_of_tracks(
            window, own, identity, {known: still[known] for known in resting}
        )
        merged = merged_into(window, tracks, usual, present | set(resting))
        self._remember(window, own, identity, resting, merged)
        self.history.record(window.tracks, tracks, paused)
        if window.stuck is not None:
            self.history.forget(window.tracks[window.stuck])
        return WindowIdentities(
            tuple(identity[j] for j in range(window.motions)), tracks, resting, origins, merged
        )

    def _camera(self, window: WindowLabels, votes: Sequence[Votes]) -> int | None:
        """The index of the motion of the static world: that of most tracks that were of it.

        Before a static camera there is none; without such tracks, the one that looks like it.
        """
        if (window.labels == BACKGROUND).any():
            return None
        share = [own.get(STATIC_WORLD, 0.0) for own in votes]
        if sum(share) >= LEAST_VOTES:
            return int(np.argmax(share))
        return None if window.camera_motion is None else window.camera_motion - 1

    def _dragged(
        self, window: WindowLabels, own: list[Integers], votes: Sequence[Votes]
    ) -> set[int]:
        """The motions that are no objects: tracks of the static world, dragged along a little.

        A tracker compares windows of the picture; what passes takes along the tracks whose window
        it covers, at most as far as that is wide.
        """
        if not (window.labels == BACKGROUND).any():
            return set()
        found = set()
        for j, rows in enumerate(own):
            moved = net_displacement(window.points[rows])
            was_static = 2 * votes[j].get(STATIC_WORLD, 0.0) > len(rows)
            if was_static and moved < TRACKED_WINDOW:
                found.add(j)
        return found

    def _continued(self, votes: Sequence[Votes], usual: Integers) -> dict[int, int]:
        """The known objects that motions continue: by row of ``votes``."""
        known = np.array(
            sorted({i for own in votes for i in own if i != STATIC_WORLD}), dtype=np.int64
        )
        if not len(known):
            return {}
        table = vote_table(votes, known)
        going_on = np.array([(usual == identity).sum() for identity in known])
        not_new = np.array([sum(own.values()) for own in votes])
        share = table / np.sqrt(np.maximum(going_on * not_new[:, None], 1e-9))
        allowed = (table >= LEAST_VOTES) & (share >= LEAST_SHARE)
        rows, columns = linear_sum_assignment(-np.where(allowed, table, 0.0))
        return {int(i): int(known[k]) for i, k in zip(rows, columns, strict=True) if allowed[i, k]}

    def _wholes_now(
        self, window: WindowLabels, own: list[Integers], identity: Mapping[int, int]
    ) -> dict[int, list[Whole]]:
        """The boxes of all objects: as they were, and as they are if they go on."""
        found = {known: [whole] for known, whole in self.wholes.items()}
        for j, known in identity.items():
            if known in found:
                points = window.points[own[j]]
                last = sight(points, window.start, first=False)
                if last is not None:
                    found[known].append(self._whole(known, points, window.start, last))
        return found

    def _whole(self, known: int, points: Floats, start: int, last: Sight) -> Whole:
        """The box of an object after a window, from its tracks and its last sight in it."""
        box, before = Whole.of(points, start, last), self.wholes.get(known)
        return box if before is None else before.updated(points, start, box)

    def _parts(
        self, first: Mapping[int, Sight | None], wholes: Mapping[int, list[Whole]]
    ) -> dict[int, int]:
        """The motions that appear inside an object, where that should be, and move like it."""
        found = {}
        for j, one in first.items():
            own = [
                (whole.distance(one), identity)
                for identity, boxes in wholes.items()
                for whole in boxes
                if one is not None
                and abs(one.frame - whole.frame) <= self.seen_for(identity, whole.frame)
                and whole.holds(one)
            ]
            if own:
                found[j] = min(own)[1]
        return found

    def _split_off(
        self,
        window: WindowLabels,
        own: list[Integers],
        identity: Mapping[int, int],
        votes: Sequence[Votes],
    ) -> dict[int, int]:
        """The motions that were part of an object, and still move like it."""
        found = {}
        for j in (j for j, known in identity.items() if not known):
            parent = parent_of(votes[j])
            rest = [k for k, known in identity.items() if known == parent]
            if parent is not None and rest:
                others = np.concatenate([own[k] for k in rest])
                if parent in self.in_parts or move_alike(
                    window.points[own[j]], window.points[others]
                ):
                    found[j] = parent
        return found

    def seen_for(self, identity: int, frame: int) -> int:
        """For how many frames an object has been seen."""
        return frame - self.first_frames.get(identity, frame)

    def _again(self, first: dict[int, Sight | None], present: set[int]) -> dict[int, int]:
        """The hidden objects that appear again, by motion."""
        motions = [j for j, one in first.items() if one is not None]
        sights = {**self.lost, **self.last_sights}
        lost = [identity for identity in sorted(sights) if identity not in present]
        pairs = reappeared(
            [sights[identity] for identity in lost],
            [one for one in first.values() if one is not None],
            self.size,
        )
        return {motions[j]: lost[i] for i, j in pairs}

    def _still(
        self,
        window: WindowLabels,
        own: list[Integers],
        identity: Mapping[int, int],
        usual: Integers,
    ) -> dict[int, Integers]:
        """The tracks that stand still, of the objects of which most do that go on.

        They are of the static world, or of nothing that moves as one. Most frames show half as many
        as have shown the object: tracks that stick to what an object passes behind, when it has
        gone, are fewer.
        """
        static = window.labels == BACKGROUND
        for j, rows in enumerate(own):
            if identity[j] == STATIC_WORLD:
                static[rows] = True
        still_or_none = static | (window.labels == OUTLIER)
        if window.stuck is not None:
            still_or_none &= ~window.stuck
        found = {}
        # one whose size is not known has been lost, or was merged
        for known in (k for k in np.unique(usual).tolist() if k in self.sizes):
            of_object = usual == known
            still = np.flatnonzero(of_object & still_or_none)
            shown = np.median(np.isfinite(window.points[still, :, 0]).sum(axis=0))
            is_most = len(still) >= max(LEAST_VOTES, of_object.sum() / 2)
            if is_most and shown >= self.sizes[known] / 2:
                found[known] = still
        return found

    def _remember(
        self,
        window: WindowLabels,
        own: list[Integers],
        identity: dict[int, int],
        resting: tuple[int, ...],
        merged: Mapping[int, int],
    ) -> None:
        """Update the last sights. An object that was merged is not hidden: its tracks go on."""
        seen: dict[int, Integers] = {}
        for j, rows in enumerate(own):
            if identity[j] > STATIC_WORLD:  # an object may be seen in several parts
                seen[identity[j]] = np.append(seen.get(identity[j], rows[:0]), rows)
        self.lost |= {k: v for k, v in self.last_sights.items() if k not in seen}
        self.lost = {k: v for k, v in self.lost.items() if window.start - v.frame <= v.seen}
        for known in (*seen, *resting, *merged):
            self.lost.pop(known, None)
        kept = {k: v for k, v in self.last_sights.items() if k in resting}
        for known, rows in seen.items():
            last = sight(window.points[rows], window.start, first=False)
            if last is not None:
                first = self.first_frames.setdefault(known, window.start)
                kept[known] = replace(last, seen=last.frame - first)
                shown = np.isfinite(window.points[rows, :, 0]).sum(axis=0)
                size = float(np.median(shown[shown > 0]))
                # what is half hidden has not become smaller
                self.sizes[known] = max(size, self.sizes.get(known, 0.0) / 2)
                whole = self._whole(known, window.points[rows], window.start, last)
                self.wholes[known] = whole
                kept[known] = replace(
                    kept[known], half_size=whole.half_size, velocity=whole.velocity
                )
        end = window.start + window.points.shape[1] - 1
        for known in resting:
            if known in self.wholes:
                self.wholes[known] = self.wholes[known].rested(end)
        for one in seen:
            for other in (k for k in seen if k > one):
                pairs = self.together.setdefault(one, {})
                pairs[other] = pairs.get(other, 0) + 1
        identities = list(identity.values())
        self.in_parts = {known for known in seen if identities.count(known) > 1}
        self.last_sights = kept
        known_still = {**kept, **self.lost}
        self.first_frames = {k: v for k, v in self.first_frames.items() if k in known_still}
        self.sizes = {k: v for k, v in self.sizes.items() if k in known_still}
        self.wholes = {k: v for k, v in self.wholes.items() if k in known_still}
        self.together = {
            k: {other: n for other, n in v.items() if other in known_still}
            for k, v in self.together.items()
            if k in known_still
        }
