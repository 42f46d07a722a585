"""Corners and matchers: known warps give matches at known places, whatever the brightness."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mssegment.errors import ConfigurationError, DataError, UsageError
from mssegment.imaging import corners as corners_module
from mssegment.imaging import pyramid
from mssegment.imaging.corners import detect, detect_all, harris, select_apart
from mssegment.imaging.frames import open_frames
from mssegment.imaging.matching import MATCHERS, default_matcher, match
from mssegment.imaging.matching.lucas_kanade import Windows, correlations, register
from mssegment.imaging.matching.nearest import mutual
from mssegment.imaging.matching.orientation import dominant_directions
from mssegment.imaging.matching.pyramid_corners import with_pyramid
from mssegment.imaging.pyramid import build_pyramid
from mssegment.records import Floats, Frame

Warp = Callable[[Floats, Floats], tuple[Floats, Floats]]
GREY = np.float32


def shade(x: Floats, y: Floats, seed: int = 3) -> np.ndarray:
    """A smooth random picture at any real position: a sum of waves, so warps are exact."""
    rng = np.random.default_rng(seed)
    count = 160
    length = rng.uniform(6, 40, count)
    angle = rng.uniform(0, 2 * np.pi, count)
    phase = rng.uniform(0, 2 * np.pi, count)
    value = np.zeros(x.shape, GREY)
    for wave, a, p in zip(2 * np.pi / length, angle, phase, strict=True):
        value += np.sin(wave * (np.cos(a) * x + np.sin(a) * y) + p).astype(GREY)
    return (120 + 9 * value).astype(GREY)


def view(linear: Floats, shift: Floats, height: int = 240, width: int = 320) -> np.ndarray:
    """What stood at x in the picture ``view(eye, 0)`` stands at linear (x - c) + c + shift."""
    y, x = np.mgrid[:height, :width].astype(float)
    centre = np.array([width / 2, height / 2])
    back = np.linalg.inv(linear)
    source = (np.stack([x, y], axis=-1) - centre - shift) @ back.T + centre
    return shade(source[..., 0], source[..., 1])


def errors(points: Floats, linear: Floats, shift: Floats) -> Floats:
    centre = np.array([160.0, 120.0])
    expected = (points[:, 0] - centre) @ linear.T + centre + shift
    return np.linalg.norm(points[:, 1] - expected, axis=1)


def turned(degrees: float, scale: float = 1.0) -> Floats:
    a = np.deg2rad(degrees)
    return scale * np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


FIRST = view(np.eye(2), np.zeros(2))
SMALL = (np.array([[1.02, 0.01], [-0.015, 0.99]]), np.array([3.3, -2.6]))
PAIR_MATCHERS = [name for name, matcher in MATCHERS.items() if matcher.max_frames == 2]


@pytest.mark.parametrize("method", MATCHERS)
def test_a_small_warp_is_found_within_a_fifth_of_a_pixel(method: str) -> None:
    pictures = [FIRST, view(*SMALL)]
    tracks = match(pictures, detect_all(pictures), method)
    found = errors(tracks.points, *SMALL)
    assert len(found) > 150
    assert np.mean(found < 0.2) > 0.9
    assert np.median(found) < 0.1


@pytest.mark.parametrize("method", MATCHERS)
@pytest.mark.parametrize(("gain", "offset"), [(0.5, 30), (1.4, -50), (0.15, 5)])
def test_gain_and_offset_change_nothing(method: str, gain: float, offset: float) -> None:
    pictures = [FIRST, view(*SMALL)]
    other = [FIRST, (gain * pictures[1] + offset).astype(GREY)]
    plain = match(pictures, detect_all(pictures), method)
    found = match(other, detect_all(other), method)
    assert len(found.points) >= 0.9 * len(plain.points)
    assert np.mean(errors(found.points, *SMALL) < 0.2) > 0.9


@pytest.mark.parametrize(
    ("linear", "least"),
    [
        (turned(45), 80),
        (turned(130), 80),
        (turned(0, 1.5), 40),
        (turned(20, 0.7), 60),
        (np.array([[1.3, 0.2], [0.0, 0.8]]), 60),
    ],
)
def test_affine_matcher_under_rotation_scale_and_slant(linear: Floats, least: int) -> None:
    shift = np.array([12.0, -7.0])
    pictures = [FIRST, view(linear, shift)]
    tracks = match(pictures, detect_all(pictures), "affine")
    found = errors(tracks.points, linear, shift)
    right = found < 1
    assert right.sum() >= least
    assert right.mean() > 0.95
    assert np.median(found) < 0.15
    assert tracks.affines is not None
    assert np.median(np.abs(tracks.affines[right] - linear).max(axis=(1, 2))) < 0.05


@pytest.mark.parametrize("method", PAIR_MATCHERS)
def test_exchanged_views_give_the_inverse(method: str) -> None:
    pictures = [FIRST, view(*SMALL)]
    corners = detect_all(pictures)
    there = match(pictures, corners, method).points
    back = match(pictures[::-1], corners[::-1], method).points
    inverse = np.linalg.inv(SMALL[0])
    missed = errors(back, inverse, -inverse @ SMALL[1])
    assert np.mean(missed < 0.2) > 0.9
    assert 0.8 < len(back) / len(there) < 1.25


@pytest.mark.parametrize("method", PAIR_MATCHERS)
def test_the_order_of_the_corners_does_not_matter(method: str) -> None:
    pictures = [FIRST, view(*SMALL)]
    corners = detect_all(pictures)
    rng = np.random.default_rng(1)
    mixed = []
    for c in corners:
        order = rng.permutation(len(c.points))
        mixed.append(type(c)(c.points[order], c.responses[order], c.scales[order]))
    one, two = (match(pictures, c, method).points.reshape(-1, 4) for c in (corners, mixed))
    assert len(one) == len(two)
    np.testing.assert_allclose(*(a[np.lexsort(a.T)] for a in (one, two)), atol=1e-3)


def test_unrelated_pictures_hardly_match() -> None:
    y, x = np.mgrid[:240, :320].astype(float)
    pictures = [FIRST, shade(x, y, seed=77)]
    assert len(match(pictures, detect_all(pictures), "affine").points) < 20


def test_repeated_texture_does_not_match_at_random() -> None:
    board = np.kron(np.indices((15, 20)).sum(0) % 2, np.ones((16, 16))) * 160 + 40
    rng = np.random.default_rng(0)
    pictures = [(board + rng.normal(0, 2, board.shape)).astype(GREY) for _ in range(2)]
    corners = detect_all(pictures)
    points = match(pictures, corners, "affine").points
    assert len(points) < 0.25 * len(corners[0].points), "squares cannot be told apart"


def test_corners_are_where_the_corner_is() -> None:
    picture = np.full((60, 80), 40, GREY)
    picture[20:, 30:] = 200  # the edge between pixels 19 and 20, 29 and 30
    found = detect(cv2.GaussianBlur(picture, (0, 0), 1), levels=1)
    strongest = found.points[found.responses.argmax()]
    assert np.abs(strongest - (30.0, 20.0)).max() < 1.0


def test_corners_move_with_the_picture() -> None:
    shift = np.array([4.4, -3.7])
    one, two = (detect(v, levels=1).points for v in (FIRST, view(np.eye(2), shift)))
    gap = np.linalg.norm(one[:, None] + shift - two[None], axis=2).min(axis=1)
    inside = ((one + shift > 5) & (one + shift < (314, 234))).all(axis=1)
    assert np.mean(gap[inside] < 0.35) > 0.65


def test_corners_do_not_depend_on_light() -> None:
    one, two = detect(FIRST), detect((0.5 * FIRST + 40).astype(GREY))
    assert len(one.points) == len(two.points)
    np.testing.assert_allclose(one.points, two.points, atol=0.02)
    np.testing.assert_allclose(two.responses, one.responses / 16, rtol=1e-3)


def test_number_distance_and_levels() -> None:
    found = detect(FIRST, levels=1, limit=50, distance=9.0)
    assert 10 < len(found.points) <= 50
    gap = np.linalg.norm(found.points[:, None] - found.points[None], axis=2)
    assert gap[~np.eye(len(gap), dtype=bool)].min() >= 9 - 2**0.5
    assert (np.diff(found.responses) <= 0).all()
    scales = np.unique(detect(FIRST, levels=4).scales)
    np.testing.assert_allclose(scales, 2 ** (np.arange(4) / 2))
    assert len(np.unique(detect(np.tile(FIRST, (4, 4))).scales)) == 6, "large: more levels"


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 60), st.floats(0.5, 30), st.integers(0, 2**31))
def test_points_are_selected_greedily(count: int, distance: float, seed: int) -> None:
    points = np.random.default_rng(seed).uniform(0, 50, (count, 2))
    kept: list[int] = []
    for i, point in enumerate(points):
        if all(np.linalg.norm(point - points[j]) >= distance for j in kept):
            kept.append(i)
    assert select_apart(points, distance).tolist() == kept
    assert select_apart(points, distance, 3).tolist() == kept[:3]


def test_mutual_against_brute_force() -> None:
    rng = np.random.default_rng(0)
    one, two = (rng.normal(size=(n, 20)).astype(GREY) for n in (300, 170))
    one[:100] = two[:100] + 0.2 * rng.normal(size=(100, 20)).astype(GREY)
    one, two = (a / np.linalg.norm(a, axis=1, keepdims=True) for a in (one, two))
    places = rng.uniform(0, 100, (170, 2))
    table = one @ two.T
    expected = []
    for i, row in enumerate(table):
        j = int(row.argmax())
        elsewhere = np.linalg.norm(places - places[j], axis=1) > 6
        far = 1 - row[elsewhere].max()
        if table[:, j].argmax() == i and row[j] >= 0.3 and 1 - row[j] <= 0.85**2 * far:
            expected.append((i, j))
    pairs = mutual(one, two, 0.3, ratio=0.85, places=places, apart=6.0)
    assert list(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True)) == expected
    assert len(mutual(one[:0], two, 0.3).first) == 0


def test_registration_finds_the_affine_from_a_rough_start() -> None:
    linear, shift = turned(8, 1.1), np.array([2.0, 1.0])
    second = view(linear, shift)
    corners = detect(FIRST, levels=1, limit=80, distance=12).points
    inside = corners[((corners > 50) & (corners < (270, 190))).all(axis=1)]
    centre = np.array([160.0, 120.0])
    truth = (inside - centre) @ linear.T + centre + shift
    start = truth + np.random.default_rng(2).normal(0, 1.0, truth.shape)
    zero = np.zeros(len(inside), np.intp)
    windows = Windows(inside, start, np.tile(np.eye(2), (len(inside), 1, 1)), zero, zero)
    done = register(build_pyramid(FIRST, 1), build_pyramid(second, 1), windows)
    miss = np.linalg.norm(done.second - truth, axis=1)
    assert np.mean(miss < 0.1) > 0.8
    assert np.mean(done.correlation > 0.99) > 0.8
    assert np.median(np.abs(done.affines - linear)) < 0.01


def test_windows_of_several_levels_are_registered_as_if_each_were_alone() -> None:
    rng = np.random.default_rng(5)
    centres = rng.uniform((60, 60), (260, 180), (24, 2))
    levels, others = rng.integers(0, 3, (2, 24))
    affines = np.eye(2) + rng.normal(0, 0.03, (24, 2, 2))
    windows = Windows(centres, centres + rng.normal(3, 1, (24, 2)), affines, levels, others)
    one, two = build_pyramid(FIRST, 3), build_pyramid(view(*SMALL), 3)
    together, alike = register(one, two, windows), correlations(one, two, windows)
    for row in range(24):
        alone = register(one, two, windows[np.array([row])])
        np.testing.assert_allclose(together.second[row], alone.second[0], atol=1e-2)
        np.testing.assert_allclose(together.correlation[row], alone.correlation[0], atol=1e-3)
        assert correlations(one, two, windows[np.array([row])])[0] == pytest.approx(
            alike[row], abs=1e-4
        )
    same = Windows(centres, centres, np.tile(np.eye(2), (24, 1, 1)), levels, levels)
    np.testing.assert_allclose(correlations(one, one, same), 1.0, atol=1e-3)


def test_tracks_through_a_sequence() -> None:
    steps = [np.array([1.7, -0.9]) * i for i in range(5)]
    pictures = [view(np.eye(2), s) for s in steps]
    tracks = match(pictures, detect_all(pictures))
    assert tracks.points.shape[1] == 5
    assert tracks.visible.all()
    assert len(tracks.points) > 100
    moved = tracks.points - tracks.points[:, :1] - np.array(steps)
    assert np.mean(np.abs(moved).max(axis=(1, 2)) < 0.2) > 0.9


def test_long_sequences_renew_tracks_and_forget_short_ones() -> None:
    wide = view(np.eye(2), np.zeros(2), 160, 460)
    pictures = [wide[:, 14 * i : 14 * i + 260] for i in range(14)]
    corners = detect_all(pictures)
    tracks = match(pictures, corners)
    seen = tracks.visible
    assert not seen[:, 0].all(), "tracks begin later too"
    assert not seen[:, -1].all(), "and end earlier, as the picture moves on"
    assert seen.sum(axis=1).min() >= 3
    runs = np.diff(np.pad(seen, ((0, 0), (1, 1))).astype(int), axis=1)
    assert ((runs == 1).sum(axis=1) == 1).all(), "a track is seen without gaps"
    assert np.isnan(tracks.points[~seen]).all()
    assert match(pictures, corners, min_length=10).visible.sum(axis=1).min() >= 10
    whole = match(pictures, corners, renew=False, min_length=2)
    assert whole.visible[:, 0].all()


def test_tracks_through_a_fading_light() -> None:
    steps = [np.array([1.5, 0.7]) * i for i in range(6)]
    pictures = [(view(np.eye(2), s) * 0.75**i + 6 * i).astype(GREY) for i, s in enumerate(steps)]
    tracks = match(pictures, detect_all(pictures))
    moved = tracks.points - tracks.points[:, :1] - np.array(steps)
    assert len(tracks.points) > 100
    assert np.mean(np.abs(moved).max(axis=(1, 2)) < 0.25) > 0.9


@pytest.mark.parametrize("method", MATCHERS)
@pytest.mark.parametrize("shape", [(12, 12), (24, 30), (9, 200), (64, 48)])
def test_tiny_pictures_behave(method: str, shape: tuple[int, int]) -> None:
    pictures = [FIRST[: shape[0], : shape[1]], FIRST[1 : shape[0] + 1, 1 : shape[1] + 1]]
    try:
        corners = detect_all(pictures)
    except DataError:
        return  # too small for a corner
    tracks = match(pictures, corners, method)
    assert np.isfinite(tracks.points).all()
    assert tracks.points.shape[1:] == (2, 2)


@pytest.mark.parametrize("method", MATCHERS)
def test_the_same_picture_twice(method: str) -> None:
    tracks = match([FIRST, FIRST], detect_all([FIRST, FIRST]), method)
    assert len(tracks.points) > 100
    np.testing.assert_allclose(tracks.points[:, 1], tracks.points[:, 0], atol=0.05)


@pytest.mark.parametrize("value", [0, 80, 255])
def test_blank_pictures_are_named(value: int) -> None:
    blank = np.full((100, 120), value, GREY)
    frames = [Frame("a.png", 320, 240), Frame("plain.png", 120, 100)]
    with pytest.raises(DataError) as failure:
        detect_all([FIRST, blank], frames)
    assert "plain.png: no corners (120x100" in str(failure.value)
    ramp = np.tile(np.linspace(0, 255, 120, dtype=GREY), (100, 1))
    with pytest.raises(DataError):
        detect_all([ramp, ramp])


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 50), st.integers(1, 50), st.sampled_from([0, 1, 90]))
def test_noise_of_any_size_is_no_surprise(seed: int, height: int, width: int, size: int) -> None:
    rng = np.random.default_rng(seed)
    pictures = [(128 + size * rng.normal(size=(height, width))).astype(GREY) for _ in range(2)]
    try:
        corners = detect_all(pictures)
    except DataError:
        return
    for method in MATCHERS:
        assert np.isfinite(match(pictures, corners, method).points).all()


def test_wrong_calls() -> None:
    corners = detect_all([FIRST] * 3)
    for method in PAIR_MATCHERS:
        with pytest.raises(UsageError, match=f"{method}: 3 frames, expected at most 2; use flow"):
            match([FIRST] * 3, corners, method)
    with pytest.raises(UsageError, match="expected auto, affine"):
        match([FIRST] * 2, corners[:2], "surf")
    for pictures in ([FIRST], [FIRST] * 3):
        with pytest.raises(UsageError, match="the corners of each"):
            match(pictures, corners[:2])
    with pytest.raises(
        ConfigurationError, match=r"min_length: .* affine has no .*match.method flow$"
    ):
        match([FIRST] * 2, corners[:2], min_length=3)


@pytest.mark.parametrize("name", MATCHERS)
def test_a_matcher_lists_its_options(name: str) -> None:
    pictures = [FIRST, view(*SMALL)]
    corners = detect_all(pictures)
    matcher = MATCHERS[name]
    assert matcher.name == name
    assert matcher.description
    assert matcher.options
    defaults = matcher.function.__kwdefaults__
    tracks = match(pictures, corners, name, **defaults)
    np.testing.assert_array_equal(tracks.points, match(pictures, corners, name).points)
    with pytest.raises(ConfigurationError, match=f"match.colour: the matcher {name} has no"):
        match(pictures, corners, name, colour=1)


def test_every_number_of_frames_has_one_default_that_takes_it() -> None:
    for frames in (2, 3, 8, 9, 1000):
        chosen = [m for m in MATCHERS.values() if m.is_default_for(frames)]
        assert [m.name for m in chosen] == [default_matcher(frames)]
        assert chosen[0].max_frames is None or frames <= chosen[0].max_frames
    assert default_matcher(2) == "affine"
    assert default_matcher(3) == "flow"


def test_names_and_descriptions_load_no_opencv_and_no_matcher() -> None:
    code = (
        "import sys; from mssegment.imaging.matching import MATCHERS, default_matcher;"
        "[(m.name, m.description) for m in MATCHERS.values()]; default_matcher(2);"
        "print('cv2' in sys.modules, *(m.module in sys.modules for m in MATCHERS.values()))"
    )
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, capture_output=True, text=True, check=True)
    assert set(process.stdout.split()) == {"False"}


@pytest.mark.data
def test_more_right_matches_than_sift_on_real_pairs(data_folder: Path) -> None:
    frontend = pytest.importorskip("benchmarks.frontend")
    files = sorted((data_folder / "adelaidermf/motion").glob("*.mat"))
    if not files:
        pytest.skip("no AdelaideRMF pairs in the data folder")
    methods = {"sift": frontend.sift, "affine": lambda p: frontend.ours(p, "affine")}
    rows = [frontend.measure(path, methods, 1) for path in files[:4]]
    ours, theirs = ([row[name] for row in rows] for name in ("affine", "sift"))
    assert sum(r["right"] for r in ours) > 2 * sum(r["right"] for r in theirs)
    assert np.mean([r["share"] for r in ours]) > 0.9


@pytest.mark.data
def test_real_video_gives_tracks_that_move_and_tracks_that_stand(data_folder: Path) -> None:
    video = data_folder / "video/car_traffic_small.mp4"
    pictures = open_frames([str(video)], 100, 115, 3).greys()
    points = match(pictures, detect_all(pictures)).points
    moved = points[:, -1] - points[:, 0]
    against_the_road = np.linalg.norm(moved - np.median(moved, axis=0), axis=1)
    assert (against_the_road < 2).sum() > 100
    assert (against_the_road > 6).sum() > 10


def test_even_corners_leave_no_part_of_the_picture_out(rng: np.random.Generator) -> None:
    picture = cv2.GaussianBlur(rng.normal(0, 200, (240, 320)).astype(np.float32), (0, 0), 1.5)
    picture[:, 160:] *= 0.2
    strongest = detect(picture, levels=1, limit=100, distance=5).points
    even = detect(picture, levels=1, limit=100, distance=5, even=True).points
    assert len(strongest) == len(even) == 100
    assert (strongest[:, 0] > 165).mean() < 0.1
    assert 0.3 < (even[:, 0] > 165).mean() < 0.7
    left_out = set(map(tuple, detect(picture, levels=1, limit=5000, distance=5).points))
    assert set(map(tuple, even)) <= left_out


def test_large_pictures_in_strips_are_what_they_are_whole(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    grey = cv2.GaussianBlur(rng.uniform(0, 255, (150, 97)).astype(np.float32), (0, 0), 1.2)
    corners = detect(grey, levels=3, limit=400)
    whole = harris(grey), dominant_directions(with_pyramid(grey, corners))
    monkeypatch.setattr(pyramid, "STRIP_PIXELS", 97 * 23)
    monkeypatch.setattr(corners_module, "HARRIS_PIXELS", 97 * 23)
    assert len(list(pyramid.strips(grey.shape, 9))) == 7
    np.testing.assert_array_equal(harris(grey), whole[0])
    for strip, expected in zip(
        dominant_directions(with_pyramid(grey, corners)), whole[1], strict=True
    ):
        np.testing.assert_array_equal(strip, expected)
