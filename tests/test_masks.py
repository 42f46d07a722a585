"""Dense masks fill the objects of the sample scenes, and obey what tracks say."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import mssegment
from mssegment.masks import UNKNOWN, label_pixels
from mssegment.masks.cut import guided_filter, minimum_cut
from mssegment.masks.dense import with_tracks
from mssegment.masks.fields import motion_field
from mssegment.records import Frame

SAMPLES = Path(__file__).parents[1] / "sample_data"


def jaccard(found, truth):
    """Intersection over union, without the pixels that the truth leaves out."""
    judged = truth[1] if isinstance(truth, tuple) else np.ones_like(found)
    truth = truth[0] if isinstance(truth, tuple) else truth
    return (found & truth & judged).sum() / ((found | truth) & judged).sum()


@pytest.mark.parametrize("scene", ["affine", "factorization"])
def test_masks_of_the_sample_scenes(scene):
    folder = SAMPLES / scene
    names = sorted(folder.glob("frame-*.png"))
    found = mssegment.segment_pictures(names)
    pictures = [cv2.imread(str(name)) for name in names]
    frames = found.source.frames
    masks = label_pixels(found.points, found.labels, frames, lambda index: pictures[index])
    for index, mask in zip(range(2), masks, strict=False):
        truth = cv2.imread(str(folder / f"mask-{index + 1}.png"), cv2.IMREAD_UNCHANGED)
        assert mask.shape == truth.shape
        for label in (1, 2, 3):
            own = (truth == label, truth != 255)
            assert max(jaccard(mask == motion, own) for motion in (1, 2, 3)) > 0.95


def translated_square(rng, shift=(9, -4), world=(0, 0)):
    """A square on a wall of the same texture; both move. Pictures, tracks, labels, true mask."""
    textures = [cv2.GaussianBlur(rng.uniform(0, 255, (200, 260, 3)), (0, 0), 1.5) for _ in range(2)]
    wall, patch = (cv2.normalize(t, None, 0, 255, cv2.NORM_MINMAX) for t in textures)
    pictures = []
    for step in range(2):
        scene = np.roll(wall, (step * world[1], step * world[0]), axis=(0, 1)).copy()
        left, top = 80 + step * shift[0], 60 + step * shift[1]
        scene[top : top + 80, left : left + 100] = patch[:80, :100]
        pictures.append(scene.astype(np.uint8))
    truth = np.zeros((200, 260), dtype=bool)
    truth[60:140, 80:180] = True
    inner = rng.uniform((84, 64), (176, 136), (60, 2))
    around = rng.uniform((2, 2), (250, 190), (400, 2))
    around = around[(np.abs(around - (130, 100)) > (60, 50)).any(axis=1)]
    first = np.concatenate([inner, around])
    steps = np.repeat([shift, world], [len(inner), len(around)], axis=0)
    labels = np.repeat([2, 1], [len(inner), len(around)])
    return pictures, np.stack([first, first + steps], axis=1), labels, truth


FRAMES = [Frame("1.png", 260, 200), Frame("2.png", 260, 200)]


def test_an_object_of_the_texture_of_the_world_is_found_by_its_motion(rng):
    pictures, points, labels, truth = translated_square(rng)
    mask = next(label_pixels(points, labels, FRAMES, pictures.__getitem__, camera_motion=1))
    assert set(np.unique(mask)) == {0, 2}
    assert jaccard(mask == 2, truth) > 0.9


def test_background_tracks_are_the_world_as_a_camera_motion_is(rng):
    pictures, points, labels, _ = translated_square(rng)
    named = next(label_pixels(points, labels, FRAMES, pictures.__getitem__, camera_motion=1))
    static = np.where(labels == 1, -1, labels)
    background = next(label_pixels(points, static, FRAMES, pictures.__getitem__))
    assert (named == background).all()


def test_without_a_world_what_is_far_from_tracks_is_not_known(rng):
    pictures, points, labels, truth = translated_square(rng)
    only = labels == 2
    mask = next(label_pixels(points[only], labels[only], FRAMES, pictures.__getitem__))
    assert set(np.unique(mask)) == {2, UNKNOWN}
    assert (mask[:20] == UNKNOWN).all()
    assert (mask[truth] == 2).mean() > 0.7


def test_without_tracks_nothing_is_known(rng):
    pictures, *_ = translated_square(rng)
    none = np.zeros((0, 2, 2))
    mask = next(label_pixels(none, np.zeros(0, dtype=np.int64), FRAMES, pictures.__getitem__))
    assert (mask == UNKNOWN).all()


def test_without_motions_all_is_the_static_world(rng):
    pictures, points, labels, _ = translated_square(rng)
    static = np.where(labels == 1, -1, 0)
    mask = next(label_pixels(points, static, FRAMES, pictures.__getitem__))
    assert (mask == 0).all()


def test_a_field_follows_its_tracks_and_is_affine_beyond(rng):
    start = rng.uniform((20, 20), (80, 60), (50, 2))
    matrix = np.array([[1.1, 0.1], [-0.05, 0.9]])
    field = motion_field(start, start @ matrix.T + [3, 4], 200, 100)
    x, y = np.meshgrid(np.arange(200), np.arange(100))
    expected = np.stack([x, y], axis=-1) @ matrix.T + [3, 4]
    assert np.abs(field - expected).max() < 1e-3
    assert motion_field(start[:2], start[:2], 9, 9) is None
    line = np.arange(9.0)[:, None] * [1, 2]
    assert motion_field(line, line, 9, 9) is None


def test_minimum_cut_is_the_least_of_all_labellings(rng):
    cost = rng.integers(-5, 6, (3, 3)).astype(float)
    across, down = (
        rng.integers(0, 4, (3, 2)).astype(float),
        rng.integers(0, 4, (2, 3)).astype(float),
    )

    def energy(taken):
        borders = (across * (taken[:, 1:] != taken[:, :-1])).sum()
        return cost[taken].sum() + borders + (down * (taken[1:] != taken[:-1])).sum()

    every = [np.array(bits, dtype=bool).reshape(3, 3) for bits in np.ndindex(*9 * (2,))]
    assert energy(minimum_cut(cost, across, down)) == min(map(energy, every))


def test_guided_filter_keeps_an_edge_of_its_guide_and_the_mean_of_a_plain_area(rng):
    guide = np.zeros((40, 40), dtype=np.float32)
    guide[:, 20:] = 1.0
    values = guide + rng.normal(0, 0.2, guide.shape).astype(np.float32)
    filtered = guided_filter(guide, values, 4, 1e-3)
    assert np.abs(filtered - guide).max() < 0.15
    assert filtered[:, :16].std() < 0.1


def test_regions_need_a_track_and_holes_are_filled():
    labels = np.zeros((20, 20), dtype=np.int64)
    labels[2:10, 2:10] = 1
    labels[5:7, 5:7] = 0
    labels[14:18, 14:18] = 1
    kept = with_tracks(labels, [np.array([[3, 3]])])
    assert (kept[2:10, 2:10] == 1).all()
    assert (kept[14:18, 14:18] == 0).all()


def test_frames_of_two_sizes_have_masks_of_their_own_size(rng):
    pictures, points, labels, truth = translated_square(rng)
    enlarged = cv2.resize(pictures[1], (390, 300))
    points[:, 1] = (points[:, 1] + 0.5) * 1.5 - 0.5
    frames = [FRAMES[0], Frame("2.png", 390, 300)]
    source = [pictures[0], enlarged]
    first, second = label_pixels(points, labels, frames, source.__getitem__, camera_motion=1)
    assert (first.shape, second.shape) == ((200, 260), (300, 390))
    assert jaccard(first == 2, truth) > 0.85


def test_a_plain_world_with_few_tracks_is_not_the_object_nearest_to_it(rng):
    pictures, points, labels, truth = translated_square(rng, world=(0, 0))
    plain = [
        np.where(truth_of(step)[..., None], p, 90).astype(np.uint8)
        for step, p in enumerate(pictures)
    ]
    corners = np.flatnonzero((labels == 1) & (np.abs(points[:, 0] - (130, 100)) > (115, 85)).any(1))
    kept = np.concatenate([np.flatnonzero(labels == 2), corners])
    tracks, own = points[kept], np.where(labels[kept] == 1, -1, labels[kept])
    mask = next(label_pixels(tracks, own, FRAMES, plain.__getitem__))
    assert jaccard(mask == 2, truth) > 0.9


def truth_of(step, shift=(9, -4)):
    """Where the square is in a frame of ``translated_square``."""
    own = np.zeros((200, 260), dtype=bool)
    left, top = 80 + step * shift[0], 60 + step * shift[1]
    own[top : top + 80, left : left + 100] = True
    return own


def walker(rng, count=9):
    """A body that moves, and a leg below it that swings; tracks on the body and the wall only."""
    textures = [cv2.GaussianBlur(rng.uniform(0, 255, (200, 260, 3)), (0, 0), 1.5) for _ in range(2)]
    wall, hide = (cv2.normalize(t, None, 0, 255, cv2.NORM_MINMAX) for t in textures)
    pictures, truths = [], []
    for step in range(count):
        scene, truth = wall.copy(), np.zeros((200, 260), dtype=bool)
        left, swing = 60 + 4 * step, round(14 * np.sin(2 * np.pi * step / 6))
        leg = slice(left + 40 + swing, left + 62 + swing)
        scene[110:150, leg], truth[110:150, leg] = hide[110:150, :22], True
        body = slice(left, left + 100)
        scene[50:110, body], truth[50:110, body] = hide[50:110, 60:160], True
        pictures.append(scene.astype(np.uint8))
        truths.append(truth)
    inner = rng.uniform((64, 54), (156, 106), (60, 2))
    around = rng.uniform((2, 2), (250, 190), (400, 2))
    around = around[(around[:, 1] < 45) | (around[:, 1] > 155)]
    time = np.arange(count)[None, :, None]
    points = np.concatenate([inner[:, None] + time * [4, 0], around[:, None] + time * [0, 0]])
    return pictures, points, np.repeat([2, 1], [len(inner), len(around)]), truths


def test_a_leg_that_swings_belongs_to_the_body(rng):
    pictures, points, labels, truths = walker(rng)
    frames = [Frame(f"{index}.png", 260, 200) for index in range(len(pictures))]
    masks = list(label_pixels(points, labels, frames, pictures.__getitem__, camera_motion=1))
    inner = range(2, 7)  # with frames on both sides; a leg that is the world's leaves 0.86
    assert np.mean([jaccard(masks[index] == 2, truths[index]) for index in inner]) > 0.9
