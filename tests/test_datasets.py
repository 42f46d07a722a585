"""Readers: the published files as they are, the CSV formats, and files that are broken."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mssegment import datasets
from mssegment.datasets import DATASETS
from mssegment.datasets.hopkins155 import group_of
from mssegment.errors import DataError
from mssegment.records import IGNORED

GROUPS = {
    "1R2RC": "checkerboard-2",
    "1RT2RTCRT_A_g13": "checkerboard-2",
    "2T3RCTP": "checkerboard-2",
    "three-cars": "checkerboard-2",
    "cars2_06_g23": "traffic-2",
    "truck1": "traffic-2",
    "kanatani1": "traffic-2",
    "kanatani2": "traffic-2",
    "kanatani3": "articulated-2",
    "two_cranes": "articulated-2",
    "arm": "articulated-2",
    "people2": "articulated-2",
    "head": "articulated-2",
    "articulated_g12": "articulated-2",
}


def hopkins_variables(rng: np.random.Generator, tracks: int = 9, frames: int = 4) -> dict:
    y = np.ones((3, tracks, frames))
    y[:2] = rng.uniform(0, 200, (2, tracks, frames))
    labels = np.arange(tracks)[:, None] % 2 + 1
    return {"y": y, "s": labels, "width": 320, "height": 240, "K": np.eye(3)}


@pytest.mark.parametrize(("name", "group"), GROUPS.items())
def test_hopkins_groups_follow_the_names(name: str, group: str) -> None:
    assert group_of(name, 2) == group


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("hopkins155", {"checkerboard-2": 42, "checkerboard-3": 14, "traffic-2": 14}),
        ("adelaidermf", {"motion": 10, "plane": 9}),
        ("kt3dmoseg", {"kt3dmoseg": 11}),
    ],
)
def test_every_published_file_is_read(data_folder: Path, name: str, counts: dict) -> None:
    found = [DATASETS[name].read(path) for path in DATASETS[name].files(data_folder / name)]
    for group, count in counts.items():
        assert sum(entry.group == group for entry in found) >= count
    for entry in found:
        tracks = entry.tracks
        assert tracks.labels is not None
        assert tracks.points.shape[:2] == (len(tracks.labels), len(entry.frames))
        assert entry.motions >= 1
        size = entry.frames[0].width, entry.frames[0].height
        seen = tracks.points[tracks.visible]
        assert (seen > -2).all()
        assert (seen < np.add(size, 2)).all()


@pytest.mark.data
@pytest.mark.parametrize("name", ["hopkins155", "adelaidermf", "kt3dmoseg"])
def test_content_tells_the_format(data_folder: Path, name: str) -> None:
    path = DATASETS[name].files(data_folder / name)[0]
    assert datasets.recognise(path).name == name


@pytest.mark.data
def test_a_pair_of_adelaidermf_equals_its_csv(data_folder: Path) -> None:
    pair = datasets.read(data_folder / "adelaidermf" / "motion" / "breadcube.mat")
    table = datasets.read(data_folder / "pairs" / "breadcube" / "labels.csv")
    np.testing.assert_allclose(pair.tracks.points, table.tracks.points, atol=1e-3)
    np.testing.assert_array_equal(pair.tracks.labels, table.tracks.labels)
    assert [picture.shape for picture in pair.pictures] == [(480, 640, 3)] * 2


def test_hopkins_file_round_trip(tmp_path: Path, rng: np.random.Generator) -> None:
    variables = hopkins_variables(rng)
    variables["y"][2, 3, 1] = 0
    scipy.io.savemat(tmp_path / "cars1_truth.mat", variables)
    entry = datasets.read(tmp_path / "cars1_truth.mat")
    assert (entry.name, entry.group, entry.motions) == ("cars1", "traffic-2", 2)
    assert np.isnan(entry.tracks.points[3, 1]).all()
    assert entry.tracks.visible.sum() == 9 * 4 - 1
    np.testing.assert_array_equal(entry.tracks.points[0, 2], variables["y"][:2, 0, 2])
    assert (entry.frames[2].width, entry.frames[2].height, entry.frames[2].index) == (320, 240, 2)


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"s": np.ones((4, 1))}, "4 labels for 9 tracks"),
        ({"s": np.full((9, 1), 0.5)}, "0.5"),
        ({"y": np.ones((2, 9, 4))}, "2 x 9 x 4"),
        ({"y": np.full((3, 9, 4), np.inf)}, "infinit"),
        ({"width": 0}, "width"),
        ({"width": "wide"}, "width"),
    ],
)
def test_broken_hopkins_files_say_what_is_wrong(
    tmp_path: Path, rng: np.random.Generator, change: dict, word: str
) -> None:
    path = tmp_path / "cars1_truth.mat"
    scipy.io.savemat(path, hopkins_variables(rng) | change)
    with pytest.raises(DataError, match=word) as caught:
        DATASETS["hopkins155"].read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None
)
@given(cut=st.integers(128, 1200), noise=st.binary(max_size=40))
def test_damaged_matlab_files_never_escape_as_another_error(
    tmp_path: Path, cut: int, noise: bytes
) -> None:
    whole = tmp_path / "whole.mat"
    scipy.io.savemat(whole, hopkins_variables(np.random.default_rng(0)), do_compression=True)
    path = tmp_path / "broken_truth.mat"
    content = whole.read_bytes()
    path.write_bytes(content[:cut] + noise + content[cut + len(noise) : -1])
    with contextlib.suppress(DataError):
        datasets.read(path)


def test_matches_as_csv(tmp_path: Path) -> None:
    path = tmp_path / "pair.csv"
    path.write_text("x1,y1,x2,y2,label\n1,2,3,4,1\n5,6,7,8,0\n")
    entry = datasets.read(path)
    np.testing.assert_array_equal(entry.tracks.points[1], [[5, 6], [7, 8]])
    assert entry.tracks.labels is not None
    assert entry.tracks.labels.tolist() == [1, 0]
    assert (entry.frames[0].width, entry.frames[0].height) == (8, 9)


def test_sightings_as_csv_keep_the_gaps(tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text("track,frame,x,y\n7,10,1,2\n7,12,3,4\n9,12,5,6\n")
    entry = datasets.read(path)
    assert entry.tracks.labels is None
    assert [frame.index for frame in entry.frames] == [10, 12]
    assert np.isnan(entry.tracks.points[1, 0]).all()
    np.testing.assert_array_equal(entry.tracks.points[0], [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", "empty"),
        ("a,b\n1,2\n", "x1,y1,x2,y2"),
        ("x1,y1,x2,y2\n1,2,3\n", "line 2: 3 fields"),
        ("x1,y1,x2,y2\n1,2,3,inf\n", "line 2: 'inf'"),
        ("x1,y1,x2,y2\n1,2,3,four\n", "'four' in column 'y2'"),
        ("x1,y1,x2,y2\n", "0 tracks"),
        ("x1,x1,x2,y2\n1,2,3,4\n", "two columns have the same name"),
        ("track,frame,x,y\n1,1,2,3\n1,1,2,3\n", "two positions"),
        ("track,frame,x,y,visible\n1,1,2,3,1\n1,2,2,3,7\n", "line 3: '7' in column 'visible'"),
        ("track,frame,x,y,label\n1,1,2,3,1\n1,2,2,3,2\n", "two labels"),
        ("x1,y1,x2,y2,label\n1,2,3,4,-2\n", "found -2"),
    ],
)
def test_broken_csv_says_what_is_wrong(tmp_path: Path, text: str, word: str) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text(text)
    with pytest.raises(DataError, match=word):
        datasets.read(path)


def test_files_that_are_not_there(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        datasets.read(tmp_path / "nothing.mat")
    with pytest.raises(DataError, match="no file of Hopkins155"):
        DATASETS["hopkins155"].files(tmp_path)
    with pytest.raises(DataError, match="not a folder"):
        DATASETS["hopkins155"].files(tmp_path / "nowhere")
    with pytest.raises(DataError, match="unknown data set"):
        datasets.read(tmp_path, "hopkins")


def test_masks_vote_frame_by_frame() -> None:
    masks = {0: np.zeros((4, 6), np.uint8), 2: np.zeros((4, 6), np.uint8)}
    masks[0][:, 3:] = 2
    masks[2][:, 3:] = 2
    masks[2][3] = 255
    x = np.array([[4, 4, 4], [0, 0, 4], [4, 4, 4], [0, 0, 0], [9, 9, 9]], float)
    y = np.array([[1, 1, 1], [1, 1, 1], [1, 1, 3], [3, 3, 3], [1, 1, 1]], float)
    points = np.stack([x, y], axis=-1)
    points[3, 0] = np.nan
    labels = datasets.labels_from_masks(points, masks)
    # agreed; disagreed; the ignored frame does not vote; only ignored; outside of both pictures.
    assert labels.tolist() == [2, 0, 2, IGNORED, IGNORED]


def test_masks_must_fit_the_tracks() -> None:
    points = np.ones((1, 2, 2))
    with pytest.raises(DataError, match="mask of frame 3"):
        datasets.labels_from_masks(points, {2: np.zeros((4, 4), np.uint8)})
    with pytest.raises(DataError, match="one channel"):
        datasets.labels_from_masks(points, {0: np.zeros((4, 4, 3), np.uint8)})


def test_located_labels_take_the_nearest_within_the_radius() -> None:
    places = np.array([[10.0, 10.0, 20.0, 20.0], [12.0, 10.0, 40.0, 20.0]])
    points = np.array([[[10, 10], [20, 21]], [[12, 10], [30, 20]], [[12, 11], [40, 20]]], float)
    labels = datasets.labels_from_points(points, places, np.array([1, 2]), radius=3.0)
    assert labels.tolist() == [1, IGNORED, 2]
    first = datasets.labels_from_points(points, places[:, :2], np.array([1, 2]), radius=3.0)
    assert first.tolist() == [1, 2, 2]


def test_located_labels_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "labels.csv"
    path.write_text("x,y,label\n1,2,3\n")
    places, labels = datasets.read_located_labels(path)
    assert places.tolist() == [[1, 2]]
    assert labels.tolist() == [3]
    path.write_text("x,y\n1,2\n")
    with pytest.raises(DataError, match="x,y,label"):
        datasets.read_located_labels(path)


def test_a_label_beyond_every_picture_is_a_mistake(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("x,y,label\n1e300,5,1\n100,100,2\n")
    with pytest.raises(DataError, match=r"a label is at 1e\+300; expected pixels"):
        datasets.read_located_labels(path)


@pytest.mark.parametrize(
    "text",
    [
        "\ufeffX1; Y1;x2;Y2;Label\r\n\r\n1,5;2;3;4;1\r\n",
        "x1\ty1\tx2\ty2\tlabel\n1.5\t2\t3\t4\t1\n",
        "x1,y1,x2,y2,label\n , \n1.5,2,3,4,1\n",
    ],
)
def test_csv_as_spreadsheets_write_it(tmp_path: Path, text: str) -> None:
    path = tmp_path / "tracks.csv"
    path.write_text(text, encoding="utf-8")
    found = datasets.read(path).tracks
    assert found.points.tolist() == [[[1.5, 2.0], [3.0, 4.0]]]
    assert found.labels is not None
    assert found.labels.tolist() == [1]
