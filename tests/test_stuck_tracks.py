"""Tracks that stick to what an object passes behind, and tracks of an object that no group has."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.models import Flags
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Floats, Integers
from mssegment.sequences.adoption import adopted
from mssegment.sequences.identities import IdentityTracker
from mssegment.sequences.membership import left_behind, members
from mssegment.sequences.reappearance import velocity_of
from mssegment.sequences.window_labels import WindowLabels

FRAMES = 40
SIZE = (640, 480)


def body(speed: float = 3.0, frames: int = FRAMES, left: float = 100.0) -> Floats:
    """A grid of 36 tracks, 60 pixels wide, that moves to the right, with noise of a 20th pixel."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0, 60, 6)]), axis=-1).reshape(-1, 1, 2)
    path = np.array([left, 200.0]) + np.arange(frames)[:, None] * np.array([speed, 0.0])
    noise = np.random.default_rng(0).normal(0, 0.05, (36, frames, 2))
    return np.asarray(grid + path + noise)


def hidden_behind(points: Floats, edge: float, stuck: Integers) -> Floats:
    """The same behind a post that begins at ``edge``; the ``stuck`` tracks stay there."""
    behind = points[..., 0] > edge
    found = np.where(behind[..., None], np.nan, points)
    for track in stuck:
        first = int(behind[track].argmax())
        found[track, first:] = points[track, first]
    return found


def visible(points: Floats) -> Flags:
    """The frames in which tracks are visible."""
    return np.asarray(np.isfinite(points[..., 0]))


class TestStuck:
    """A body passes behind a post; some of its tracks stick to the border."""

    stuck = np.array([4, 10, 21, 35])

    def window(self) -> tuple[Floats, Integers, Flags]:
        points = hidden_behind(body(frames=60), 190.0, self.stuck)
        labels = np.ones(36, dtype=np.int64)
        return points, labels, members(points, labels)

    def test_they_do_not_show_it_when_it_has_gone(self) -> None:
        points, _, shown = self.window()
        # the last track is hidden in frame 30
        assert not shown[:, 36:].any()
        others = np.delete(np.arange(36), self.stuck)
        np.testing.assert_array_equal(shown[others], visible(points)[others])

    def test_they_are_left_behind(self) -> None:
        points, labels, shown = self.window()
        found = left_behind(labels, visible(points), shown)
        assert set(np.flatnonzero(found)) == set(self.stuck.tolist())

    def test_a_body_that_stops_is_not_left_behind(self) -> None:
        points = body(frames=60)
        points[:, 30:] = points[:, 30:31]
        labels = np.ones(36, dtype=np.int64)
        shown = members(points, labels)
        assert shown.all()
        assert not left_behind(labels, visible(points), shown).any()

    @pytest.mark.parametrize("is_known", [False, True])
    def test_they_are_no_object_at_rest(self, is_known: bool) -> None:
        points, labels, shown = self.window()
        stuck = left_behind(labels, visible(points), shown) if is_known else None
        tracker = IdentityTracker(SIZE)
        first = np.where(shown[..., None] | np.array(not is_known), points, np.nan)
        tracker.add(WindowLabels(0, np.arange(36), first, labels, stuck=stuck))
        # all but the stuck ones have ended; these are more than half of what a frame has shown
        tracker.sizes[1] = 6.0
        still = np.repeat(points[self.stuck, -1:], 40, axis=1)
        static = np.full(4, BACKGROUND)
        then = tracker.add(WindowLabels(40, self.stuck, still, static))
        assert then.resting == (() if is_known else (1,))


class TestAdopted:
    """A body in the middle of which some tracks are of no group."""

    free = np.array([14, 20])

    def window(self, *others: Floats) -> tuple[Floats, Integers, Flags]:
        points = np.concatenate([body(), *others])
        labels = np.full(len(points), OUTLIER, dtype=np.int64)
        labels[:36] = 1
        labels[self.free] = [OUTLIER, NOT_JUDGED]
        return points, labels, members(points, labels)

    def test_tracks_that_lie_on_it_and_move_with_it_are_its(self) -> None:
        points, labels, shown = self.window()
        points[14, 10:] += [1.5, -1.0]  # it has slipped
        points[20, :30] = np.nan
        assert set(adopted(points, labels, shown)) == {1}

    def test_what_stands_still_or_lies_elsewhere_is_not(self) -> None:
        at_rest = np.repeat(body()[:3, 20:21] + [5.0, 5.0], FRAMES, axis=1)
        elsewhere = body()[:3] + np.array([0.0, 200.0])
        other_way = body(-3.0, left=200.0)[:3]
        points, labels, shown = self.window(at_rest, elsewhere, other_way)
        found = adopted(points, labels, shown)
        assert set(found[:36]) == {1}
        assert set(found[36:]) == {OUTLIER}

    def test_the_static_world_stays_static(self) -> None:
        points, labels, shown = self.window(body()[:3])
        labels[36:] = BACKGROUND
        assert set(adopted(points, labels, shown)[36:]) == {BACKGROUND}


def test_the_velocity_of_what_stops_is_that_which_it_had() -> None:
    points = body(3.0)
    points[:, 20:] = points[:, 20:21]
    velocity = velocity_of(points)
    assert velocity is not None
    np.testing.assert_allclose(velocity, [3.0, 0.0], atol=0.05)
    assert velocity_of(np.full((3, 5, 2), np.nan)) is None
