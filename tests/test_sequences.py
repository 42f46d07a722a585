"""Windows of long sequences, and the identities of motions through them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from mssegment.models import Flags
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Floats, Integers
from mssegment.sequences.extent import Whole
from mssegment.sequences.identities import IdentityTracker
from mssegment.sequences.lifetimes import (
    ONE_WINDOW,
    WindowLimits,
    plan_windows,
    rates_of_endings,
)
from mssegment.sequences.membership import members, without_strangers
from mssegment.sequences.parts import coherent, join_parts, split_apart, without_borders
from mssegment.sequences.reappearance import Sight, reappeared
from mssegment.sequences.rest import Resting, moving_on
from mssegment.sequences.separation import separated
from mssegment.sequences.short_tracks import label_short_tracks
from mssegment.sequences.window_labels import NO_OBJECT, WindowIdentities, WindowLabels

SIZE = (640, 480)


def mortal_tracks(rng: np.random.Generator, frames: int, rate: float, count: int = 60) -> Floats:
    """Tracks that move 3 pixels a frame; each ends with probability ``rate`` and is replaced."""
    rows = []
    for _ in range(count):
        first = 0
        while first < frames:
            life = int(rng.geometric(rate)) + 1
            track = np.full((frames, 2), np.nan)
            steps = np.arange(min(life, frames - first))
            track[first : first + life] = rng.uniform(0, 400, 2) + 3.0 * steps[:, None]
            rows.append(track)
            first += life
    return np.array(rows)


class TestLifetimes:
    def test_windows_cover_all_frames_and_overlap(self) -> None:
        points = mortal_tracks(np.random.default_rng(0), 260, 0.05)
        windows = plan_windows(points, WindowLimits())
        assert windows[0][0] == 0
        assert windows[-1][1] == 260
        for (first, stop), (following, _) in itertools.pairwise(windows):
            assert first < following < stop

    def test_a_sequence_of_100_frames_is_one_window_unless_asked(self) -> None:
        points = mortal_tracks(np.random.default_rng(0), ONE_WINDOW, 0.2)
        assert plan_windows(points, WindowLimits()) == [(0, 100)]
        assert plan_windows(points, WindowLimits(40, 10)) == [(0, 40), (30, 70), (60, 100)]

    def test_windows_are_as_long_as_tracks_last(self) -> None:
        rng = np.random.default_rng(1)
        for rate in (0.03, 0.06, 0.1):
            points = mortal_tracks(rng, 400, rate)
            lengths = [stop - start for start, stop in plan_windows(points, WindowLimits())][:-1]
            assert 0.7 < np.mean(lengths) * rate / 2 < 1.4

    def test_static_tracks_do_not_count(self) -> None:
        points = mortal_tracks(np.random.default_rng(2), 300, 0.06)
        for_ever = np.repeat(np.random.default_rng(3).uniform(0, 400, (500, 1, 2)), 300, axis=1)
        both = np.concatenate([for_ever, points])
        np.testing.assert_array_equal(rates_of_endings(both), rates_of_endings(points))

    def test_the_order_of_the_tracks_does_not_matter(self) -> None:
        rng = np.random.default_rng(4)
        points = mortal_tracks(rng, 300, 0.05)
        mixed = points[rng.permutation(len(points))]
        assert plan_windows(mixed, WindowLimits()) == plan_windows(points, WindowLimits())


class Scene:
    """Objects of 20 tracks each, whose labels in each window are given."""

    def __init__(self, order: Integers | None = None) -> None:
        self.tracker = IdentityTracker(SIZE)
        self.order = order

    def add(
        self, start: int, groups: dict[int, int], camera: int | None = None, length: int = 20
    ) -> WindowIdentities:
        """``groups``: the label of each object; object k has tracks 100 k to 100 k + 19."""
        tracks = np.concatenate([100 * k + np.arange(20) for k in groups])
        labels = np.repeat(list(groups.values()), 20)
        steps = np.arange(start, start + length)
        speed = np.array([[2.0, 0.0], [-2.0, 0.5]])
        points = np.stack(
            [
                np.array([50.0 + 40 * (t // 100), 10.0 + 10 * (t % 20)])
                + steps[:, None] * speed[(t // 100) % 2]
                for t in tracks
            ]
        )
        order = np.arange(len(tracks)) if self.order is None else self.order[: len(tracks)]
        order = order[order < len(tracks)]
        return self.tracker.add(
            WindowLabels(start, tracks[order], points[order], labels[order], camera)
        )


class TestIdentities:
    def test_one_window_has_the_labels_as_identities(self) -> None:
        found = Scene().add(0, {1: 1, 2: 2, 3: 3})
        assert found.motions == (1, 2, 3)

    def test_labels_that_change_places_keep_their_identities(self) -> None:
        scene = Scene()
        assert scene.add(0, {1: 1, 2: 2}).motions == (1, 2)
        assert scene.add(15, {1: 2, 2: 1}).motions == (2, 1)
        assert scene.add(30, {1: 2, 2: 1, 3: 3}).motions == (2, 1, 3)

    def test_an_object_that_rests_keeps_its_identity(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1, 2: 2, 9: BACKGROUND})
        rests = scene.add(15, {1: BACKGROUND, 2: 1, 9: BACKGROUND})
        assert rests.motions == (2,)
        assert rests.resting == (1,)
        assert (rests.tracks[:20] == 1).all()
        assert (rests.tracks[-20:] == 0).all()
        assert scene.add(30, {1: 1, 2: 2, 9: BACKGROUND}).motions == (1, 2)

    @pytest.mark.parametrize(("stuck", "rests"), [(5, ()), (25, (1,))])
    def test_tracks_that_stick_to_a_post_are_not_the_object_at_rest(
        self, stuck: int, rests: tuple[int, ...]
    ) -> None:
        tracker, tracks = IdentityTracker(SIZE), np.arange(25)
        moves, stays = block((100, 100), (2, 0)), block((140, 100), (0, 0))
        tracker.add(WindowLabels(0, tracks, moves, np.ones(25, np.int64)))
        stays[stuck:, 4:] = np.nan  # the others end soon, behind the post
        found = tracker.add(WindowLabels(20, tracks, stays, np.full(25, BACKGROUND)))
        assert found.resting == rests

    def test_objects_that_were_joined_for_a_while_get_their_identities_back(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1, 2: 2})
        together = scene.add(15, {1: 1, 2: 1})
        assert len(together.motions) == 1
        assert scene.add(30, {1: 1, 2: 2}).motions == (1, 2)

    def test_a_split_says_what_it_was_part_of(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1, 2: 1})
        apart = scene.add(15, {1: 1, 2: 2})
        assert apart.motions == (1, 2)
        assert apart.origins == {2: 1}

    def test_a_part_that_still_moves_like_its_object_belongs_to_it(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1, 3: 1})  # objects of odd numbers have one velocity
        assert scene.add(15, {1: 1, 3: 2}).motions == (1, 1)

    def test_an_object_in_parts_stays_one_while_a_part_is_caught(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1, 3: 1})
        assert scene.add(15, {1: 1, 3: 2}).motions == (1, 1)
        points = np.concatenate([block((100, 100), (4, 0)), block((300, 100), (1, 0))])
        tracks = np.concatenate([100 + np.arange(20), 300 + np.arange(20)])
        rows = np.concatenate([np.arange(20), 25 + np.arange(20)])
        window = WindowLabels(30, tracks, points[rows], np.repeat([1, 2], 20))
        assert scene.tracker.add(window).motions == (1, 1)

    def test_a_merge_says_into_what(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1, 2: 2})
        scene.add(15, {1: 1, 2: 2})
        assert scene.add(30, {1: 1, 2: 1}).merged == {2: 1}

    def test_what_moves_less_than_the_tracker_sees_is_no_object(self) -> None:
        for speed, found in ((0.4, (NO_OBJECT,)), (1.0, (1,))):
            points, labels = parts(block((200, 200), (speed, 0)))
            window = WindowLabels(0, np.arange(len(points)), points, labels)
            assert IdentityTracker(SIZE).add(window).motions == found

    def test_the_camera_has_one_identity(self) -> None:
        scene = Scene()
        assert scene.add(0, {1: 1, 2: 2}, camera=1).motions == (0, 1)
        # whatever looks like the camera later, its tracks tell which motion it is
        assert scene.add(15, {1: 1, 2: 2}, camera=2).motions == (0, 1)

    def test_an_object_without_common_tracks_is_new(self) -> None:
        scene = Scene()
        scene.add(0, {1: 1})
        assert scene.add(15, {4: 1}).motions == (2,)

    def test_the_order_of_the_tracks_does_not_matter(self) -> None:
        windows = [{1: 1, 2: 2, 3: 3}, {1: 2, 2: 1, 3: 1}, {2: 1, 3: 2, 4: 3}]
        order = np.random.default_rng(0).permutation(60)
        plain, mixed = Scene(), Scene(order)
        for number, groups in enumerate(windows):
            one, other = (scene.add(15 * number, groups) for scene in (plain, mixed))
            assert one.motions == other.motions
            assert one.merged == other.merged
            np.testing.assert_array_equal(one.tracks[order[: len(one.tracks)]], other.tracks)


class TestReappearance:
    lost = Sight(100, (200.0, 200.0), (4.0, 0.0), seen=60, half_size=(20.0, 20.0))

    @pytest.mark.parametrize(
        ("again", "is_same"),
        [
            (Sight(130, (322.0, 203.0), (4.1, 0.0)), True),
            (Sight(130, (322.0, 203.0), (-4.0, 0.0)), False),  # the other way
            (Sight(130, (500.0, 400.0), (4.1, 0.0)), False),  # elsewhere
            (Sight(130, (262.0, 203.0), (4.1, 0.0)), True),  # it has stopped on its way
            (Sight(130, (150.0, 203.0), (4.1, 0.0)), False),  # behind it
            (Sight(90, (160.0, 200.0), (4.0, 0.0)), False),  # at the same time
            (Sight(190, (560.0, 200.0), (4.0, 0.0)), False),  # later than it was ever seen
        ],
    )
    def test_it_is_where_it_was_going(self, again: Sight, is_same: bool) -> None:
        assert bool(reappeared([self.lost], [again], SIZE)) is is_same

    def test_what_left_the_picture_does_not_come_back(self) -> None:
        leaving = Sight(100, (630.0, 200.0), (4.0, 0.0), seen=60, half_size=(20.0, 20.0))
        assert not reappeared([leaving], [Sight(110, (630.0, 200.0), (4.0, 0.0))], SIZE)


class TestMovingOn:
    """A body that stood where other tracks begin to move."""

    def standing(self, until: int = 10) -> Resting:
        points = block((200, 200), (0, 0))
        points[:, until:] = np.nan
        return Resting.of(points)

    def begins(self, x: float) -> Floats:
        points = block((x, 200), (3, 0))
        points[:, :10] = np.nan
        return points

    def test_what_begins_where_it_stood_is_it(self) -> None:
        assert moving_on({4: self.begins(175)}, {7: self.standing()}) == {4: 7}

    def test_what_begins_elsewhere_is_not(self) -> None:
        assert not moving_on({4: self.begins(300)}, {7: self.standing()})

    def test_what_still_stands_there_does_not_move(self) -> None:
        assert not moving_on({4: self.begins(175)}, {7: self.standing(until=20)})

    def test_one_motion_is_one_object(self) -> None:
        motions = {4: self.begins(175), 5: self.begins(168)}
        assert moving_on(motions, {7: self.standing()}) == {5: 7}


class TestWhole:
    """A body of 40 x 40 pixels that moves by 3 pixels a frame behind a screen."""

    def whole(self) -> Whole:
        seen = Sight(19, (257.0, 200.0), (3.0, 0.0), seen=20)
        return Whole.of(block((200, 200), (3, 0)), 0, seen)

    def test_the_box_is_that_of_the_tracks(self) -> None:
        np.testing.assert_allclose(self.whole().low, (237, 180), atol=6)
        np.testing.assert_allclose(self.whole().high, (277, 220), atol=6)

    @pytest.mark.parametrize(
        ("part", "is_inside"),
        [
            (Sight(39, (330.0, 205.0), (3.0, 0.0)), True),
            (Sight(15, (255.0, 190.0), (3.1, 0.0)), True),  # both sides of the screen at once
            (Sight(39, (330.0, 205.0), (1.0, 0.0)), False),  # slower
            (Sight(39, (260.0, 205.0), (3.0, 0.0)), False),  # where it was, not where it is
        ],
    )
    def test_a_part_is_inside_and_moves_alike(self, part: Sight, is_inside: bool) -> None:
        assert self.whole().holds(part) is is_inside

    def test_what_is_half_hidden_keeps_its_size(self) -> None:
        points = block((200, 200), (3, 0), frames=30)
        later = Whole(29, (267.0, 180.0), (285.0, 220.0), (3.0, 0.0))
        kept = self.whole().updated(points, 0, later)
        np.testing.assert_allclose(kept.low, np.array(self.whole().low) + np.array([30, 0]))
        np.testing.assert_allclose(kept.high, np.array(self.whole().high) + np.array([30, 0]))
        larger = Whole(29, (250.0, 170.0), (310.0, 230.0), (3.0, 0.0))
        assert self.whole().updated(points, 0, larger) == larger

    def test_what_was_seen_before_belongs_to_the_box(self) -> None:
        """The leading half is hidden in the frame of the sight."""
        points = block((200, 200), (3, 0))
        ahead = points[:, 0, 0] > 200
        points[ahead, 15:] = np.nan
        box = Whole.of(points, 0, Sight(19, (247.0, 200.0), (3.0, 0.0), seen=20))
        np.testing.assert_allclose(box.low, (237, 180), atol=6)
        np.testing.assert_allclose(box.high, (277, 220), atol=6)

    def test_what_is_seen_is_inside_wherever_it_has_stopped(self) -> None:
        """It should be 60 pixels further, but a part of it appears 15 pixels from where it was."""
        points = np.full((25, 20, 2), np.nan)
        points[:, 15:] = block((262, 200), (3, 0))[:, :5]
        appears = Whole(59, (267.0, 180.0), (292.0, 220.0), (3.0, 0.0))
        kept = self.whole().updated(points, 40, appears)
        size = np.array(self.whole().high) - self.whole().low
        np.testing.assert_allclose(np.array(kept.high) - kept.low, size)
        np.testing.assert_allclose(kept.low[0], appears.low[0])

    def test_what_rests_keeps_the_velocity_that_it_had(self) -> None:
        points = np.repeat(block((257, 200), (3, 0))[:, :1], 30, axis=1)
        resting = Whole(48, (237.0, 180.0), (277.0, 220.0), (0.0, 0.0))
        assert self.whole().updated(points, 19, resting).velocity == (3.0, 0.0)

    def test_where_it_stood_still_meanwhile_it_is_not_further(self) -> None:
        """No track is seen all the time, as behind a post; from frame to frame some are."""
        time = np.concatenate([np.arange(5), np.full(15, 5), 5 + np.arange(20)])
        path = np.column_stack([257 + 3.0 * time, np.full(40, 200.0)])
        points = path + np.random.default_rng(0).uniform(-20, 20, (60, 1, 2))
        seen = (np.arange(60) % 10)[:, None] * 3
        points[np.abs(np.arange(40) - 5 - seen) > 6] = np.nan
        later = Whole(39, (310.0, 180.0), (315.0, 220.0), (3.0, 0.0))  # hardly seen
        whole = Whole(19, (237.0, 180.0), (277.0, 220.0), (3.0, 0.0))
        kept = whole.updated(points, 19, later)
        np.testing.assert_allclose(kept.low, (237.0 + 3 * time[20], 180.0), atol=0.1)

    def test_what_is_far_away_by_now_is_smaller(self) -> None:
        points = block((200, 200), (3, 0), frames=30)
        centre = points.mean(axis=0)
        nearer = np.linspace(1.5, 0.5, 30)[:, None] / np.linspace(1.5, 0.5, 30)[19]
        points = centre + (points - centre) * nearer
        seen = Sight(29, (287.0, 200.0), (3.0, 0.0), seen=30)
        kept = self.whole().updated(points, 0, Whole.of(points, 0, seen))
        size = np.array(self.whole().high) - self.whole().low
        np.testing.assert_allclose(np.array(kept.high) - kept.low, size * nearer[29], rtol=0.01)


def block(centre: tuple[float, float], velocity: tuple[float, float], frames: int = 20) -> Floats:
    """A grid of 25 tracks, 40 pixels wide."""
    grid = np.stack(np.meshgrid(*2 * [np.linspace(-20, 20, 5)]), axis=-1).reshape(-1, 1, 2)
    return grid + np.array(centre) + np.arange(frames)[:, None] * np.array(velocity)


def parts(*others: Floats) -> tuple[Floats, Integers]:
    """Groups 1, 2, ... among static tracks, a pixel of noise less than a tenth."""
    rng = np.random.default_rng(0)
    static = np.repeat(rng.uniform(0, 600, (400, 1, 2)), others[0].shape[1], axis=1)
    # nothing static is seen through an object
    hidden = np.any(
        [np.abs(static[:, :1] - o.mean(axis=(0, 1))).max(axis=(1, 2)) < 110 for o in others], axis=0
    )
    static = static[~hidden]
    labels = np.concatenate([np.full(25, i + 1) for i in range(len(others))])
    points = np.concatenate([*others, static])
    points = points + rng.normal(0, 0.05, points.shape)
    return points, np.concatenate([labels, np.full(len(static), BACKGROUND)])


def seen(points: Floats) -> Flags:
    """The frames in which tracks are visible."""
    return np.asarray(np.isfinite(points).all(axis=2))


def behind_post(corner: tuple[float, float], velocity: float, frames: int = 40) -> Floats:
    """A body of 80 pixels that passes behind a post from x = 200 to 240: a track ends there."""
    grid = np.stack(np.meshgrid(np.arange(0, 80, 8), np.arange(0, 40, 8)), axis=-1)
    path = np.arange(frames)[:, None] * np.array([velocity, 0.0])
    points = grid.reshape(-1, 1, 2) + np.array(corner) + path
    before, after = points.copy(), points.copy()
    before[points[..., 0] > 200] = np.nan
    after[points[..., 0] < 240] = np.nan
    both = np.concatenate([before, after])
    return both[seen(both).any(axis=1)]


def post(frames: int = 40) -> Floats:
    """The static tracks of a post."""
    grid = np.stack(np.meshgrid(np.arange(204, 240, 8), np.arange(0, 400, 8)), axis=-1)
    return np.repeat(grid.reshape(-1, 1, 2).astype(float), frames, axis=1)


class TestParts:
    def test_what_passes_behind_a_post_is_one_object(self) -> None:
        body, static = behind_post((100.0, 180.0), 3.0), post()
        points = np.concatenate([body, static])
        labels = np.append(np.ones(len(body), int), np.full(len(static), BACKGROUND))
        assert set(split_apart(points, labels, seen(points))[: len(body)]) == {1}
        beyond = np.nanmax(body[..., 0], axis=1) > 240
        labels[: len(body)][beyond] = 2
        assert set(join_parts(points, labels, seen(points))[: len(body)]) == {1}

    def test_two_that_follow_each_other_behind_a_post_are_two(self) -> None:
        first, second = behind_post((100.0, 180.0), 3.0), behind_post((-20.0, 180.0), 3.0)
        wall = np.stack(np.meshgrid(np.arange(0, 400, 8), np.arange(170, 230, 8)), axis=-1)
        wall = np.repeat(wall.reshape(-1, 1, 2).astype(float), 40, axis=1)
        for start in (100, -20):  # what a body covers is not visible
            passed = wall[..., 0] - start - 3.0 * np.arange(40)
            wall[(passed > -4) & (passed < 84) & (np.abs(wall[..., 1] - 196) < 24)] = np.nan
        wall = wall[seen(wall).any(axis=1)]
        static = np.concatenate([wall, post()])
        points = np.concatenate([first, second, static])
        labels = np.append(np.ones(len(first) + len(second), int), np.full(len(static), BACKGROUND))
        found = split_apart(points, labels, seen(points))
        assert len(set(found[: len(first)])) == 1
        assert set(found[: len(first) + len(second)]) == {1, 2}

    def test_parts_that_move_alike_are_one_object(self) -> None:
        points, labels = parts(block((200, 200), (5, 0)), block((260, 200), (5.5, 0)))
        assert set(join_parts(points, labels, seen(points))[:50]) == {1}

    def test_neighbours_that_move_differently_are_two(self) -> None:
        points, labels = parts(block((200, 200), (5, 0)), block((260, 200), (2, 1)))
        np.testing.assert_array_equal(join_parts(points, labels, seen(points)), labels)

    def test_what_has_static_tracks_between_is_two(self) -> None:
        points, labels = parts(block((200, 200), (5, 0)), block((290, 200), (5, 0)))
        between = np.repeat(
            np.array([[[x, y]] for x in range(225, 420, 5) for y in range(180, 222, 4)], float),
            20,
            axis=1,
        )
        more = np.concatenate([points, between])
        found = join_parts(more, np.append(labels, np.full(len(between), BACKGROUND)), seen(more))
        assert set(found[:50]) == {1, 2}

    def test_groups_that_lie_apart_are_two(self) -> None:
        points, labels = parts(block((150, 150), (4, 0)), block((450, 450), (4, 0)))
        together = np.where(labels == 2, 1, labels)
        found = split_apart(points, together, seen(points))
        assert len(set(found[:25])) == len(set(found[25:50])) == 1
        assert set(found[:50]) == {1, 2}

    def test_the_border_of_what_passes_is_no_object(self) -> None:
        border = block((200, 200), (2.5, 0)) * [1, 0] + [0, 228]  # in a line below the body
        points, labels = parts(block((200, 200), (5, 0)), border[:24])
        labels = np.where(np.arange(len(labels)) == 49, BACKGROUND, labels)
        assert set(without_borders(points, labels, seen(points))[25:49]) == {OUTLIER}

    def test_what_moves_as_fast_or_elsewhere_is_no_border(self) -> None:
        for other in (block((200, 300), (2.5, 0)), block((200, 228), (-2.5, 0))):
            points, labels = parts(block((200, 200), (5, 0)), other[:24])
            labels = np.where(np.arange(len(labels)) == 49, BACKGROUND, labels)
            found = without_borders(points, labels, seen(points))
            np.testing.assert_array_equal(found, labels)

    def test_tracks_that_move_one_after_the_other_are_no_object(self) -> None:
        points, labels = parts(block((200, 200), (5, 0)), block((400, 400), (0, 0)))
        for number, track in enumerate(np.flatnonzero(labels == 2)):
            begin = (7 * number) % 20  # dragged along by 6 pixels, each at its own time
            points[track, :, 0] += np.clip(np.arange(20) - begin, 0, 3) * 2
        found = coherent(points, labels, seen(points))
        assert set(found[labels == 2]) == {OUTLIER}
        assert set(found[labels == 1]) == {1}

    def test_objects_that_turn_or_stop_are_coherent(self) -> None:
        angle = 0.05 * np.arange(20)
        turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1)
        turning = np.einsum("fij,pj->pfi", turn.reshape(20, 2, 2), block((0, 0), (0, 0))[:, 0])
        stopping = block((400, 100), (0, 0)) + np.minimum(np.arange(20), 10)[:, None] * 2.0
        points, labels = parts(turning + 300, stopping)
        np.testing.assert_array_equal(coherent(points, labels, seen(points)), labels)


class TestSeparation:
    def test_two_that_were_two_stay_two_when_they_meet(self) -> None:
        points = np.concatenate([block((200, 200), (5, 0)), block((245, 200), (5, 0))])
        labels, usual = np.ones(50, int), np.repeat([3, 4], 25)
        new = np.array([12, 37])  # in the middle of each
        usual[new] = -1
        found, sources = separated(points, labels, usual, {3: {4: 2}})
        np.testing.assert_array_equal(found, np.repeat([1, 2], 25))
        assert sources == (1,)

    @pytest.mark.parametrize("together", [{}, {3: {4: 1}}])
    def test_pieces_that_were_never_seen_apart_for_long_are_one(
        self, together: dict[int, dict[int, int]]
    ) -> None:
        points = np.concatenate([block((200, 200), (5, 0)), block((245, 200), (5, 0))])
        labels, usual = np.ones(50, int), np.repeat([3, 4], 25)
        found, sources = separated(points, labels, usual, together)
        np.testing.assert_array_equal(found, labels)
        assert sources == ()

    def test_a_tracker_remembers_who_was_seen_together(self) -> None:
        scene = Scene()
        for start in (0, 15, 30):
            scene.add(start, {1: 1, 2: 2})
        assert scene.tracker.together == {1: {2: 3}}


class TestMembership:
    def test_a_track_taken_along_is_a_member_only_then(self) -> None:
        points, labels = parts(block((200, 200), (5, 0), frames=40))
        points[3, :25] = points[3, 25]  # at rest, until what passes takes it along
        shown = members(points, labels)
        assert not shown[3, :20].any()
        assert shown[3, 30:].all()
        assert np.delete(shown[:25], 3, axis=0).all()
        points[4, :35] = points[4, 35]
        shown = members(points, labels)
        judged = without_strangers(labels, seen(points), shown)
        assert set(judged[np.array([3, 4])]) == {OUTLIER}
        assert set(np.delete(judged[:25], [3, 4])) == {1}

    def test_what_stops_as_a_whole_is_shown_while_it_stands(self) -> None:
        moving = np.minimum(np.arange(40), 15)[:, None] * np.array([4.0, 0.0])
        points, labels = parts(block((200, 200), (0, 0), frames=40) + moving)
        assert members(points, labels)[:25].all()


def test_short_tracks_are_labelled_like_those_that_move_with_them() -> None:
    points, labels = parts(block((200, 200), (5, 0)), block((300, 300), (0, 4)))
    truth, short = labels.copy(), [3, 30, 60]
    for track in short:
        points[track, 4:] = np.nan
        labels[track] = NOT_JUDGED
    np.testing.assert_array_equal(label_short_tracks(points, labels)[short], truth[short])
    points[3, :4] += np.arange(4)[:, None] * np.array([-7.0, 3.0])  # moves like nothing else
    assert label_short_tracks(points, labels)[3] == NOT_JUDGED
