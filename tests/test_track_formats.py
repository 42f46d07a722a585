"""Further formats of tracks, laid out as the programs that write them do: all give the tracks."""

from __future__ import annotations

import json
import sqlite3
import struct
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
import scipy.io

from mssegment import datasets, pipeline
from mssegment.errors import DataError
from mssegment.imaging.frames import open_frames
from mssegment.records import Floats

TRACKS, FRAMES = 12, 6
Flags = npt.NDArray[np.bool_]


@pytest.fixture
def points(rng: np.random.Generator) -> Floats:
    """Tracks [P, F, 2] that move little, with two decimals; some positions are not seen."""
    start = rng.uniform(40, 300, (TRACKS, 1, 2))
    steps = rng.normal(0, 1, (TRACKS, FRAMES, 2)) + np.array([3, 1])
    found = np.round(start + np.cumsum(steps, axis=1), 2)
    found[rng.uniform(size=(TRACKS, FRAMES)) < 0.15] = np.nan
    return found


def seen(points: Floats) -> Flags:
    return np.asarray(np.isfinite(points).all(axis=-1))


def rows(points: Floats) -> list[tuple[int, int, float, float]]:
    visible = seen(points)
    return [
        (p, f, *points[p, f].tolist())
        for p in range(len(points))
        for f in range(points.shape[1])
        if visible[p, f]
    ]


def lines(points: Floats, form: str, head: str = "") -> str:
    body = [form.format(p=p, f=f, x=x, y=y, r=x + 10, b=y + 20) for p, f, x, y in rows(points)]
    return "\n".join([*([head] if head else []), *body]) + "\n"


def boxes(points: Floats, form: str, head: str = "") -> str:
    """Boxes of 10 x 20 pixels around the positions."""
    return lines(points - [5, 10], form, head)


# --- tables ---------------------------------------------------------------------------------------

TABLES: dict[str, Callable[[Floats], str]] = {
    "pandas repeats an index": lambda p: lines(
        p, "{f},{y},{x},{p},{f}", "frame,y,x,particle,frame"
    ),
    "title above the table": lambda p: lines(
        p, "{x},{y},{f},{p},", "Position\n=====\n\nPosition X,Position Y,Time,TrackID,"
    ),
    "ImageJ": lambda p: lines(p, "1\t{p}\t{f}\t{x}\t{y}", " \tTrack n°\tSlice n°\tX\tY"),
    "features": lambda p: lines(
        p, "140{f},{p},{x},{y}", "#timestamp [ns],feature_id,u [px],v [px]"
    ),
    "boujou": lambda p: lines(p, "Target_{p:02}  {f}  {x}  {y}", "# boujou\n#track_id view x y"),
    "names without a header": lambda p: lines(p, "Tracker{p:02} {f} {x} {y} 15"),
    "KITTI": lambda p: boxes(p, "{f} {p} Car 0 0 -1.8 {x} {y} {r} {b} 1.5 1.6 3.9 -4 1.8 13 -2")
    + "0 -1 DontCare -1 -1 -10 1 2 3 4 -1 -1 -1 -9 -9 -9 -1\n",
    "KITTI, scores": lambda p: boxes(p, "{f} {p} Van 0 0 -1 {x} {y} {r} {b} 1 1 3 -4 1 13 -2 .9"),
    "Stanford drones": lambda p: boxes(p, '{p} {x} {y} {r} {b} {f} 0 0 1 "Biker"')
    + f'0 1 2 3 4 {FRAMES - 1} 1 0 0 "Biker"\n' * bool(np.isnan(p[0, -1, 0])),
    "AI City": lambda p: boxes(p, "41 {p} {f} {x} {y} 10 20 -1 -1"),
    "MOT, six columns": lambda p: boxes(p, "{f},{p},{x},{y},10,20"),
    "MOT, percent": lambda p: boxes(p, "{f},{p},{x},{y},10,20,87.5,-1,-1,-1"),
    "MOT, names": lambda p: boxes(
        p, "{f},{p},{x},{y},10,20,1,-1,-1,-1",
        "frame,id,bb_left,bb_top,bb_width,bb_height,conf,x,y,z",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", TABLES)
def test_tables(points: Floats, tmp_path: Path, kind: str) -> None:
    (tmp_path / "t.txt").write_text(TABLES[kind](points))
    found = datasets.read(tmp_path / "t.txt").tracks.points
    np.testing.assert_allclose(found, points, atol=1e-9)


def test_a_size_beside_x_and_y_is_said(points: Floats, tmp_path: Path) -> None:
    names = "frame,id,x,y,width,height"
    (tmp_path / "t.csv").write_text(lines(points, "{f},{p},{x},{y},10,20", names))
    found = datasets.read(tmp_path / "t.csv")
    np.testing.assert_allclose(found.tracks.points, points)
    assert any("not as the corner of a box" in note for note in found.notes)


def test_columns_of_one_name_that_differ_are_refused(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("track,frame,x,y,x\n0,0,1,2,3\n0,1,1,2,4\n")
    with pytest.raises(DataError, match="two columns have the same name 'x'"):
        datasets.read(tmp_path / "t.csv")


@pytest.mark.parametrize(
    "row", ["{f},-1,{x},{y},10,20,59.3,-1,-1,-1", "{f},-1,{x},{y},10,20", "{f} {p} 9 9 9 9 9 9 9"]
)
def test_boxes_without_tracks_are_no_matches(points: Floats, tmp_path: Path, row: str) -> None:
    (tmp_path / "det.txt").write_text(boxes(points, row))
    with pytest.raises(DataError, match=r"belong to no track|without names"):
        datasets.read(tmp_path / "det.txt")


def test_several_points_of_each_object(points: Floats, tmp_path: Path) -> None:
    """SLEAP's CSV: a row per animal and frame."""
    nodes = TRACKS // 2
    head = ["track", "frame_idx", "instance.score"]
    head += [f"n{k}.{what}" for k in range(nodes) for what in ("x", "y", "score")]
    table = [",".join(head)]
    for f in range(FRAMES):
        for animal in range(2):
            own = points[animal * nodes : (animal + 1) * nodes, f]
            cells = [f"{x},{y},0.8" if np.isfinite(x) else ",," for x, y in own]
            table.append(",".join([f"track_{animal}", str(f), "0.9", *cells]))
    (tmp_path / "t.csv").write_text("\n".join(table))
    found = datasets.read(tmp_path / "t.csv")
    np.testing.assert_allclose(found.tracks.points, points)
    assert found.ids is not None
    assert found.ids[0] == "track_0 n0"
    (tmp_path / "t.csv").write_text("\n".join([*table, table[-1]]))
    with pytest.raises(DataError, match="track_1 has a second row in frame 5"):
        datasets.read(tmp_path / "t.csv")


def test_labelled_pictures_of_deeplabcut(points: Floats, tmp_path: Path) -> None:
    head = [
        ["scorer", "", "", *["me"] * (2 * TRACKS)],
        ["bodyparts", "", "", *[f"p{p}" for p in range(TRACKS) for _ in "xy"]],
        ["coords", "", "", *list("xy") * TRACKS],
    ]
    body = [
        ["labeled-data", "clip", f"img{f}.png", *map(str, points[:, f].ravel())]
        for f in range(FRAMES)
    ]
    (tmp_path / "t.csv").write_text("\n".join(",".join(row) for row in [*head, *body]))
    np.testing.assert_allclose(datasets.read(tmp_path / "t.csv").tracks.points, points)


def test_half_a_point_of_deeplabcut_is_said(tmp_path: Path) -> None:
    text = "scorer,me,me,me,me\nbodyparts,a,a,b,b\ncoords,x,y,x,likelihood\n0,1,2,3,4\n1,1,2,3,4\n"
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(DataError, match="b has x without y"):
        datasets.read(tmp_path / "t.csv")


# --- texts in blocks ------------------------------------------------------------------------------


def brox(points: Floats, between: str, labels: list[int]) -> str:
    text = f"{FRAMES}\n{TRACKS}\n"
    for p, label in enumerate(labels):
        own = [f"{x} {y} {f}" for q, f, x, y in rows(points) if q == p]
        text += "\n".join([f"{label}{between}{len(own)}", *own]) + "\n"
    return text


def blocks(points: Floats, head: str, track: str, row: str, end: str = "") -> str:
    text = head
    for p in range(TRACKS):
        own = [row.format(f=f, x=x, y=y) for q, f, x, y in rows(points) if q == p]
        text += track.format(p=p, n=len(own)) + "".join(own)
    return text + end


def klt(points: Floats) -> str:
    rule = "-" * 30
    text = f"A comment.\n\n{rule}\nKLT Feature Table\n{rule}\n\nnFrames = {FRAMES}\n\n"
    text += "feature |   frame\n--------+------\n        |  0  1\n--------+---\n"
    for p, own in enumerate(points):
        cells = [f"({x:5.2f},{y:5.2f})=   0" if x > 0 else "( -1.0, -1.0)=  -3" for x, y in own]
        text += f"{p:7d} | {' '.join(cells)}\n"
    return text


LAYOUTS: dict[str, Callable[[Floats], str]] = {
    "Brox": lambda p: brox(p, " ", [1, 2] * (TRACKS // 2)),
    "FBMS": lambda p: brox(p, "\n", [0] * TRACKS),
    "3DEqualizer": lambda p: blocks(p, f"{TRACKS}\n", "Point {p}\n0\n{n}\n", "{f} {x} {y}\n"),
    "MTrackJ": lambda p: blocks(
        p, "MTrackJ 1.5.1 Data File\nAssembly 1 FF0000\nCluster 1 FF0000\n",
        "Track {p} FF0000 true\n", "Point 1 {x} {y} 1.0 {f}.0 1.0\n", "End of MTrackJ Data File\n",
    ),
    "After Effects": lambda p: blocks(
        p, "Adobe After Effects 8.0 Keyframe Data\n\n\tUnits Per Second\t25\n\n",
        "\nMotion Trackers\tTracker #1\tPoint #{p}\n\tFrame\tX pixels\tY pixels\t\n",
        "\t{f}\t{x}\t{y}\t\n", "\nEnd of Keyframe Data\n",
    ),
    "KLT": klt,
}  # fmt: skip


@pytest.mark.parametrize("kind", LAYOUTS)
def test_texts_in_blocks(points: Floats, tmp_path: Path, kind: str) -> None:
    (tmp_path / "t.dat").write_text(LAYOUTS[kind](points))
    found = datasets.read(tmp_path / "t.dat").tracks
    np.testing.assert_allclose(found.points, points)
    assert (found.labels is None) == (kind != "Brox")
    if kind == "Brox":
        assert found.labels is not None
        assert found.labels.tolist() == [1, 2] * (TRACKS // 2)


def said_of(path: Path) -> str:
    """What is said of a file that cannot be read; empty if it can be."""
    try:
        datasets.read(path)
    except DataError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("kind", LAYOUTS)
def test_damaged_blocks_are_one_line(points: Floats, tmp_path: Path, kind: str) -> None:
    """Cut anywhere, or with a word in the place of a number: tracks, or one line on the file."""
    whole = LAYOUTS[kind](points)
    path = tmp_path / "t.dat"
    rng = np.random.default_rng(0)
    for place in rng.integers(20, len(whole), 40):
        for text in (whole[:place], whole[:place] + "abc" + whole[place + 3 :]):
            path.write_text(text)
            said = said_of(path)
            assert said == "" or said.startswith(str(path))
            assert "\n" not in said


def colmap_text(points: Floats) -> str:
    text = "# Image list with two lines of data per image:\n"
    text += "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[]\n"
    for f in range(FRAMES):
        own = [f"{x + 0.5} {y + 0.5} {p + 1}" for p, g, x, y in rows(points) if g == f]
        text += f"{9 - f} 1 0 0 0 1 2 3 1 im {f}.jpg\n{' '.join([*own, '1.5 2.5 -1'])}\n"
    return text


def colmap_binary(points: Floats) -> bytes:
    content = struct.pack("<Q", FRAMES)
    for f in range(FRAMES):
        own = [(x + 0.5, y + 0.5, p + 1) for p, g, x, y in rows(points) if g == f]
        content += struct.pack("<I7dI", 9 - f, *[1.0] * 7, 1) + f"im {f}.jpg".encode() + b"\0"
        content += struct.pack("<Q", len(own)) + b"".join(struct.pack("<ddq", *one) for one in own)
    return content


def test_sparse_models_of_colmap(points: Floats, tmp_path: Path) -> None:
    (tmp_path / "images.txt").write_text(colmap_text(points))
    (tmp_path / "images.bin").write_bytes(colmap_binary(points))
    for name in ("images.txt", "images.bin"):
        found = datasets.read(tmp_path / name)
        np.testing.assert_allclose(found.tracks.points, points, atol=1e-9)
        assert "im 0.jpg ... im 5.jpg" in found.notes[0]
    whole = colmap_binary(points)
    for cut in (10, 70, 200, len(whole) - 3):
        (tmp_path / "images.bin").write_bytes(whole[:cut])
        with pytest.raises(DataError, match="damaged COLMAP model"):
            datasets.read(tmp_path / "images.bin")
    (tmp_path / "points3D.bin").write_bytes(whole)
    with pytest.raises(DataError, match=r"points3D.bin of a COLMAP model .*give its images.bin"):
        datasets.read(tmp_path / "points3D.bin")


# --- pairs of images ------------------------------------------------------------------------------


def colmap_database(path: Path, points: Floats) -> None:
    with sqlite3.connect(path) as base:
        base.execute("create table images (image_id int, name text)")
        for table in ("keypoints", "matches"):
            key = "image_id" if table == "keypoints" else "pair_id"
            base.execute(f"create table {table} ({key} int, rows int, cols int, data blob)")
        both = np.repeat(np.arange(len(points), dtype=np.uint32)[:, None], 2, axis=1)
        for f in range(3):
            base.execute("insert into images values (?, ?)", (f + 1, f"cam/{f}.jpg"))
            data = (points[:, f] + 0.5).astype(np.float32).tobytes()
            base.execute("insert into keypoints values (?, ?, 2, ?)", (f + 1, len(points), data))
        for f in (2, 3):
            row = (2147483647 + f, len(points), both.tobytes())
            base.execute("insert into matches values (?, ?, 2, ?)", row)


WAYS = ["cam/0.jpg,cam/2.jpg", "cam/0.jpg/cam/2.jpg", "cam-0.jpg cam-2.jpg", "0,2", "cam/0,cam/2"]


@pytest.mark.parametrize(
    ("kind", "way"),
    [
        *(("colmap", way) for way in [*WAYS, "cam/2.jpg,cam/0.jpg"]),
        ("hloc", "cam/0.jpg,cam/2.jpg"),
        ("hloc", "cam/2.jpg,cam/0.jpg"),
        ("hloc before 2021", "cam-0.jpg cam-2.jpg"),
        ("dense", "cam/2.jpg,cam/0.jpg"),
        ("kornia", "cam/0.jpg/cam/2.jpg"),
    ],
)
def test_one_of_several_pairs(
    tmp_path: Path, rng: np.random.Generator, way: str, kind: str
) -> None:
    points = rng.uniform(40, 300, (TRACKS, 3, 2))
    path = tmp_path / "matches.h5"
    if kind == "colmap":
        path = tmp_path / "base.db"
        colmap_database(path, points)
    else:
        h5py = pytest.importorskip("h5py")
        one_file = {"kornia": "{}", "hloc before 2021": "{}/keypoints"}.get(kind, "{}/keypoints")
        if kind != "dense":
            with h5py.File(tmp_path / "features.h5", "w") as file:
                for f in range(3):
                    name = f"cam-{f}.jpg" if kind == "kornia" else f"cam/{f}.jpg"
                    file[one_file.format(name)] = points[:, f].astype(np.float32)
        with h5py.File(path, "w") as file:
            for f in (1, 2):
                pair = f"cam-0.jpg/cam-{f}.jpg"
                if kind == "hloc":
                    file[f"{pair}/matches0"] = np.arange(TRACKS, dtype=np.int16)
                elif kind == "hloc before 2021":
                    file[f"cam-0.jpg_cam-{f}.jpg/matches0"] = np.arange(TRACKS, dtype=np.int16)
                elif kind == "kornia":
                    file[pair] = np.repeat(np.arange(TRACKS)[:, None], 2, axis=1)
                else:
                    file[f"{pair}/keypoints0"], file[f"{pair}/keypoints1"] = (
                        points[:, 0],
                        points[:, f],
                    )
    if way == "0,2" and kind == "colmap":
        way = "1,3"  # the numbers of the images
    elif way == "0,2":
        way = "cam-0,cam-2"
    found = datasets.read(f"{path}#{way}").tracks.points
    order = [2, 0] if way.startswith("cam/2") else [0, 2]
    np.testing.assert_allclose(found, points[:, order], atol=1e-4)
    with pytest.raises(DataError, match=r"choose one: '.*#cam.0.jpg,cam.1.jpg'"):
        datasets.read(path)
    with pytest.raises(DataError, match=r"no matches of 'cam/0.jpg,cam/9.jpg', but of 2 pairs"):
        datasets.read(f"{path}#cam/0.jpg,cam/9.jpg")


def test_keypoints_alone_are_no_matches(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "features.h5", "w") as file:
        file["db/a.jpg/keypoints"] = np.zeros((3, 2))
    with pytest.raises(DataError, match="keypoints without matches; give the file with the match"):
        datasets.read(tmp_path / "features.h5")


# --- arrays and flow ------------------------------------------------------------------------------


def sleap(points: Floats) -> Floats:
    return points.reshape(2, TRACKS // 2, FRAMES, 2)


ARRAYS: dict[str, Callable[[Floats], dict[str, npt.NDArray[np.generic]]]] = {
    "flags of visibility": lambda p: {
        "": np.concatenate([np.nan_to_num(p, nan=5.0), seen(p)[..., None]], -1).swapaxes(0, 1)[None]
    },
    "two arrays of visibility": lambda p: {
        "trajs_2d": np.nan_to_num(p).swapaxes(0, 1), "valids": np.ones((FRAMES, TRACKS), bool),
        "visibs": seen(p).T, "trajs_3d": np.zeros((FRAMES, TRACKS, 3)),
    },
    "PIPs": lambda p: {"trajs_e": np.nan_to_num(p).swapaxes(0, 1)[None], "vis_e": seen(p).T[None]},
    "coordinates first": lambda p: {"tracks": p.transpose(2, 0, 1)},
    "coordinates first, then time": lambda p: {"tracks": p.transpose(2, 1, 0)},
    "coordinates second": lambda p: {"tracks": p.transpose(1, 2, 0)},
    "matrices": lambda p: {"X": p[..., 0], "Y": p[..., 1]},
    "objects, points": lambda p: {"tracks": sleap(p).transpose(2, 0, 1, 3)},
    "SLEAP": lambda p: {"tracks": sleap(p).transpose(0, 3, 1, 2), "node_names": np.array(["a"])},
    "napari, with z": lambda p: {"": np.array([(i, f, 0, y, x) for i, f, x, y in rows(p)])},
}  # fmt: skip


@pytest.mark.parametrize("kind", ARRAYS)
def test_layouts_of_arrays(points: Floats, tmp_path: Path, kind: str) -> None:
    arrays = ARRAYS[kind](points)
    path = tmp_path / "t.npz"
    if "" in arrays:
        path = tmp_path / "t.npy"
        np.save(path, arrays[""])
    else:
        np.savez(path, **arrays)  # type: ignore[arg-type]
    np.testing.assert_allclose(datasets.read(path).tracks.points, points)


def test_vectors_are_bounded_before_they_are_text(tmp_path: Path) -> None:
    long = np.zeros(3_000_000, np.uint8)
    np.savez_compressed(tmp_path / "t.npz", x1=long, y1=long, x2=long, y2=long)
    with pytest.raises(DataError, match="4 vectors of 3000000 values"):
        datasets.read(tmp_path / "t.npz")


def test_times_in_nanoseconds_are_read_in_order(tmp_path: Path) -> None:
    times = [1_733_061_600_000_000_000 + step for step in (0, 33_333_333, 66_666_667)]
    lines = [f"{i},{t},{10 * i + k},{k}" for i in range(3) for k, t in enumerate(times)]
    (tmp_path / "t.csv").write_text("\n".join(["track,frame,x,y", *reversed(lines)]))
    found = pipeline.import_tracks(str(tmp_path / "t.csv"))
    assert [frame.index for frame in found.frames] == [0, 1, 2]
    np.testing.assert_array_equal(found.tracks.points[1], [[10, 0], [11, 1], [12, 2]])
    assert any("holds times" in note for note in found.history[-1].notes)


def test_half_a_position_in_rows_of_an_array_is_none(tmp_path: Path) -> None:
    values = np.random.default_rng(0).uniform(1, 300, (20, 4))
    values[3, 1] = np.nan
    np.save(tmp_path / "t.npy", values)
    found = pipeline.import_tracks(str(tmp_path / "t.npy")).tracks.points
    assert np.isnan(found[3, 0]).all()
    assert np.isfinite(found).all(axis=2).sum() == 39


def test_cells_of_matlab(points: Floats, tmp_path: Path) -> None:
    cells = np.empty((TRACKS, 1), dtype=object)
    for p in range(TRACKS):
        own = [(f + 1, x, y) for q, f, x, y in rows(points) if q == p]
        cells[p, 0] = np.array(own)
    scipy.io.savemat(tmp_path / "t.mat", {"tracks": cells})
    np.testing.assert_allclose(datasets.read(tmp_path / "t.mat").tracks.points, points)


@pytest.mark.parametrize("kind", ["flo", "array", "first", "named"])
def test_optical_flow_is_read_on_a_grid(tmp_path: Path, kind: str) -> None:
    """Not as tracks: the rows and columns of a field of displacements are pixels."""
    y, x = np.mgrid[:120, :160]
    flow = np.stack([3 + 0.01 * x, -2 + 0.02 * y], axis=-1).astype(np.float32)
    flow[:10] = 1e10 if kind == "flo" else np.nan  # not known
    path = tmp_path / {"flo": "f.flo", "named": "f.npz"}.get(kind, "f.npy")
    if kind == "flo":
        path.write_bytes(struct.pack("<fii", 202021.25, 160, 120) + flow.tobytes())
    elif kind == "named":
        np.savez(path, flow_up=flow.transpose(2, 0, 1)[None], image1=np.zeros((120, 160)))
    else:
        np.save(path, flow if kind == "array" else flow.transpose(2, 0, 1))
    found = datasets.read(path)
    first, second = found.tracks.points[:, 0], found.tracks.points[:, 1]
    np.testing.assert_allclose(second - first, [3, -2] + first * [0.01, 0.02], atol=1e-5)
    assert 1500 < len(first) < 4100
    assert first[:, 1].min() >= 10
    assert (found.frames[0].width, found.frames[0].height) == (160, 120)


def test_tracks_of_as_many_frames_are_no_flow(tmp_path: Path, rng: np.random.Generator) -> None:
    tracks = rng.uniform(0, 640, (80, 1, 2)) + np.cumsum(rng.normal(0, 1, (80, 70, 2)), axis=1)
    np.save(tmp_path / "t.npy", tracks.astype(np.float32))
    assert datasets.read(tmp_path / "t.npy").tracks.points.shape == (80, 70, 2)


def test_a_damaged_flow_says_its_size(tmp_path: Path) -> None:
    (tmp_path / "f.flo").write_bytes(struct.pack("<fii", 202021.25, 160, 120) + bytes(99))
    with pytest.raises(DataError, match=r"111 bytes for 160x120 pixels; expected 153612"):
        datasets.read(tmp_path / "f.flo")


# --- OpenCV, JSON, XML ----------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
@pytest.mark.parametrize("names", [("points1", "points2"), ("p0", "p1"), ("src", "dst")])
def test_storage_of_opencv(
    tmp_path: Path, rng: np.random.Generator, suffix: str, names: tuple[str, str]
) -> None:
    points = rng.uniform(40, 300, (TRACKS, 2, 2)).astype(np.float32)
    path = tmp_path / f"t.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for view, name in enumerate(names):
        own = points[:, view]
        storage.write(name, own if name == "src" else own.reshape(-1, 1, 2))
    storage.release()
    np.testing.assert_allclose(datasets.read(path).tracks.points, points, rtol=1e-6)


def test_keypoints_of_opencv(tmp_path: Path, rng: np.random.Generator) -> None:
    points = np.round(rng.uniform(40, 300, (TRACKS, 2, 2)), 2)
    text = "%YAML:1.0\n---\n"
    for view in range(2):
        text += f"keypoints{view + 1}:\n"
        text += "".join(f"   - [ {x}, {y}, 7., -1., 0.01, 0, -1 ]\n" for x, y in points[:, view])
    text += "matches:\n" + "".join(f"   - [ {p}, {p}, 0, 12.5 ]\n" for p in range(3, TRACKS))
    (tmp_path / "t.yml").write_text(text)
    np.testing.assert_allclose(datasets.read(tmp_path / "t.yml").tracks.points, points[3:])


def records(points: Floats) -> list[dict[str, object]]:
    return [{"frame": f, "track_id": p, "x": x, "y": y} for p, f, x, y in rows(points)]


def by_frame(points: Floats, own: Callable[[float, float], dict[str, object]]) -> list[object]:
    return [
        {"frame": f, "objects": [{"id": p, **own(x, y)} for p, g, x, y in rows(points) if g == f]}
        for f in range(FRAMES)
    ]


def coco(points: Floats) -> object:
    return {
        "images": [{"id": 7 * f, "file_name": f"{f}.jpg"} for f in range(FRAMES)],
        "annotations": [
            {"id": i, "image_id": 7 * f, "track_id": p, "bbox": [x - 5, y - 5, 10, 10]}
            for i, (p, f, x, y) in enumerate(rows(points))
        ],
    }


def keypoints(points: Floats) -> object:
    filled = np.concatenate([np.nan_to_num(points), seen(points)[..., None] * 0.9], axis=-1)
    return [
        {"image_id": f"{f}.jpg", "idx": 1, "keypoints": filled[:, f].ravel().tolist(), "score": 3}
        for f in range(FRAMES)
    ]


JSON: dict[str, Callable[[Floats], object]] = {
    "split": lambda p: {"columns": ["track", "frame", "x", "y"], "data": rows(p)},
    "columns": lambda p: {
        name: {str(i): row[j] for i, row in enumerate(rows(p))}
        for j, name in enumerate(("track", "frame", "x", "y"))
    },
    "frames": lambda p: {"fps": 25, "frames": by_frame(p, lambda x, y: {"x": x, "y": y})},
    "boxes": lambda p: by_frame(p, lambda x, y: {"bbox": [x - 5, y - 5, 10, 10], "score": 0.9}),
    "corners": lambda p: by_frame(p, lambda x, y: {"xyxy": [x - 5, y - 5, x + 5, y + 5]}),
    "points": lambda p: by_frame(p, lambda x, y: {"center": {"x": x, "y": y}}),
    "by track": lambda p: {
        str(t): [[f, x, y] for q, f, x, y in rows(p) if q == t] for t in range(TRACKS)
    },
    "COCO": coco,
    "AlphaPose": keypoints,
}  # fmt: skip


@pytest.mark.parametrize("kind", JSON)
def test_tables_in_json(points: Floats, tmp_path: Path, kind: str) -> None:
    (tmp_path / "t.json").write_text(json.dumps(JSON[kind](points)))
    np.testing.assert_allclose(datasets.read(tmp_path / "t.json").tracks.points, points)


def test_json_lines_of_boxes(points: Floats, tmp_path: Path) -> None:
    text = [json.dumps({"frame": f, "id": p, "box": [x, y, 0, 0]}) for p, f, x, y in rows(points)]
    (tmp_path / "t.jsonl").write_text("\n".join(text))
    np.testing.assert_allclose(datasets.read(tmp_path / "t.jsonl").tracks.points, points)


def test_the_own_files_of_trackmate(points: Floats, tmp_path: Path) -> None:
    spots, tracks = "", ""
    for p, f, x, y in rows(points):
        place = f'POSITION_X="{x}" POSITION_Y="{y}" FRAME="{f}"'
        spots += f'<SpotsInFrame frame="{f}"><Spot ID="{100 * p + f}" {place}/></SpotsInFrame>'
    for p in range(TRACKS):
        own = [100 * p + f for q, f, _, _ in rows(points) if q == p]
        edges = [f'<Edge SPOT_SOURCE_ID="{a}" SPOT_TARGET_ID="{b}"/>' for a, b in pairwise(own)]
        tracks += f'<Track TRACK_ID="{p}">{"".join(edges)}</Track>'
    kept = "".join(f'<TrackID TRACK_ID="{p}"/>' for p in range(1, TRACKS))
    (tmp_path / "t.xml").write_text(
        f'<TrackMate version="7"><Model spatialunits="pixel"><AllSpots>{spots}</AllSpots>'
        f"<AllTracks>{tracks}</AllTracks><FilteredTracks>{kept}</FilteredTracks></Model></TrackMate>"
    )
    np.testing.assert_allclose(datasets.read(tmp_path / "t.xml").tracks.points, points[1:])


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\x1f\x8b\x08", "compressed by gzip, which is not read; unpack it first"),
        (b"ARROW1\0\0", "a Feather file"),
        (b"(dp0\nS'a'\n", "a Python pickle"),
        (b"version https://git-lfs.github.com/spec/v1\n", "a pointer of Git LFS"),
        (b'{"version": 1.3, "people": []}', "OpenPose.* nobody has an identity"),
        (b"# 3D point list\n#   POINT3D_ID, X, Y, Z, R\n1 2 3 4\n", "without their pictures"),
        (b"a.jpg b.jpg\n0 1\n", "indices of matches for COLMAP, without their keypoints"),
        (b"set cut_paste_input [stack 0]\nTracker4 {\n", "a script of Nuke"),
    ],
)
def test_what_is_not_read_says_what_it_is(tmp_path: Path, content: bytes, words: str) -> None:
    (tmp_path / "t.dat").write_bytes(content)
    with pytest.raises(DataError, match=words) as caught:
        datasets.read(tmp_path / "t.dat")
    assert "\n" not in str(caught.value)


def test_names_of_any_length_are_looked_at_quickly(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text(f"{'a' * 30_000},{'x_' * 9_000}\n1,2\n")
    start = time.process_time()
    with pytest.raises(DataError, match="a table with the columns"):
        datasets.read(tmp_path / "t.csv")
    (tmp_path / "t.csv").write_text("KLT Feature Table\n0 | " + "(" * 30_000)
    with pytest.raises(DataError, match="no positions"):
        datasets.read(tmp_path / "t.csv")
    assert time.process_time() - start < 2


def test_half_a_position_is_none(tmp_path: Path, rng: np.random.Generator) -> None:
    """Damaged numbers: a document has both coordinates of a position, or neither."""
    points = rng.uniform(40, 300, (TRACKS, 6, 2))
    points[2, 1, 0] = np.nan
    content = struct.pack("<Q", FRAMES)
    for f in range(FRAMES):
        content += struct.pack("<I7dI", f, *[1.0] * 7, 1) + f"{f}.jpg".encode() + b"\0"
        content += struct.pack("<Q", TRACKS)
        content += b"".join(struct.pack("<ddq", *points[p, f], p) for p in range(TRACKS))
    (tmp_path / "images.bin").write_bytes(content)
    colmap_database(tmp_path / "base.db", points)
    for name, frame in (("images.bin", 1), ("base.db#1,2", 1)):
        found = datasets.read(f"{tmp_path}/{name}").tracks.points
        assert np.isnan(found[2, frame]).all()
        assert np.isnan(found).any(axis=-1).sum() == 1


def test_the_own_files_of_results_are_read(tmp_path: Path, points: Floats) -> None:
    """``tracks.npz``, whose labels are found ones, with -1 for the background."""
    np.savez(
        tmp_path / "tracks.npz",
        points=points,
        visibility=seen(points),
        labels=np.full(TRACKS, -1),
        residuals=np.zeros((TRACKS, FRAMES)),
        matrices=np.zeros((2, 3, 3)),
    )
    found = datasets.read(tmp_path / "tracks.npz").tracks
    np.testing.assert_allclose(found.points, points)
    assert found.labels is None


def test_large_storage_of_opencv_is_read_quickly(tmp_path: Path, rng: np.random.Generator) -> None:
    points = rng.uniform(40, 300, (60_000, 2, 2)).astype(np.float32)
    path = tmp_path / "t.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("points1", points[:, 0])
    storage.write("points2", points[:, 1])
    storage.release()
    start = time.process_time()
    np.testing.assert_allclose(datasets.read(path).tracks.points, points, rtol=1e-6)
    assert time.process_time() - start < 3
    path.write_text("%YAML:1.0\n" + "".join(f"a{i}: {i}\n" for i in range(110_000)))
    with pytest.raises(DataError, match=r"more than the limit of 100,000 .limits.yaml_values"):
        datasets.read(path)


def test_deep_storage_is_one_line(tmp_path: Path) -> None:
    deep = "<a>" * 5000 + "1" + "</a>" * 5000
    (tmp_path / "t.xml").write_text(f"<opencv_storage>{deep}</opencv_storage>")
    with pytest.raises(DataError, match="nested too deeply"):
        datasets.read(tmp_path / "t.xml")


def test_units_of_the_picture_are_pixels_where_its_size_is_known(
    points: Floats, tmp_path: Path
) -> None:
    sizes = np.array([[500, 400]] * FRAMES)
    shares = (points + 0.5) / sizes
    assert 0 < np.nanmin(shares) < np.nanmax(shares) < 1
    np.save(tmp_path / "t.npy", shares)
    for f, (width, height) in enumerate(sizes.tolist()):
        cv2.imwrite(str(tmp_path / f"{f}.png"), np.zeros((height, width), np.uint8))
    path = str(tmp_path / "t.npy")
    found = pipeline.import_tracks(path, open_frames([str(tmp_path / "*.png")]))
    np.testing.assert_allclose(found.tracks.points, points, atol=1e-9)
    assert any("in units of the image: multiplied" in note for note in found.history[-1].notes)
    with pytest.raises(DataError, match="name the pictures with --images"):
        pipeline.import_tracks(path)


def test_y_upwards_is_turned_on_the_pictures(points: Floats, tmp_path: Path) -> None:
    """3DEqualizer counts from the lower left corner of the picture."""
    upwards = np.stack([points[..., 0] + 0.5, 400 - (points[..., 1] + 0.5)], axis=-1).round(2)
    (tmp_path / "t.txt").write_text(LAYOUTS["3DEqualizer"](upwards))
    for f in range(FRAMES):
        cv2.imwrite(str(tmp_path / f"{f}.png"), np.zeros((400, 500), np.uint8))
    path = str(tmp_path / "t.txt")
    found = pipeline.import_tracks(path, open_frames([str(tmp_path / "*.png")]))
    np.testing.assert_allclose(found.tracks.points, points, atol=1e-6)
    alone = pipeline.import_tracks(path)
    np.testing.assert_allclose(alone.tracks.points, upwards)
    assert any("upside down" in note for note in alone.history[-1].notes)
