"""Files of tracks as trackers, spreadsheets and scripts write them: all give the same tracks."""

from __future__ import annotations

import io
import json
import sqlite3
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from mssegment import datasets
from mssegment.errors import DataError
from mssegment.records import Floats

TRACKS, FRAMES = 9, 5


@pytest.fixture
def points(rng: np.random.Generator) -> Floats:
    """Tracks [P, F, 2] that move little, with three decimals."""
    start = rng.uniform(20, 300, (TRACKS, 1, 2))
    steps = rng.normal(0, 1, (TRACKS, FRAMES, 2)) + np.array([3, 1])
    return np.round(start + np.cumsum(steps, axis=1), 3)


def table(points: Floats, names: str, separator: str = ",", number: str = "{:.3f}") -> str:
    rows = [
        separator.join(number.format(v) for v in row) for row in points.reshape(len(points), -1)
    ]
    head = [names.replace(",", separator)] if names else []
    return "\n".join([*head, *rows]) + "\n"


def sightings(points: Floats, names: str, row: str) -> str:
    rows = [
        row.format(p=p, f=f, x=points[p, f, 0], y=points[p, f, 1])
        for f in range(points.shape[1])
        for p in range(len(points))
    ]
    return "\n".join([names, *rows] if names else rows) + "\n"


def savetxt(points: Floats, **options: str) -> str:
    out = io.StringIO()
    np.savetxt(out, points.reshape(len(points), -1), **options)
    return out.getvalue()


MATCHES: dict[str, Callable[[Floats], str | bytes]] = {
    "comma": lambda p: table(p, "x1,y1,x2,y2"),
    "no header": lambda p: table(p, ""),
    "tab": lambda p: table(p, "x1,y1,x2,y2", "\t"),
    "decimal comma": lambda p: table(p, "x1,y1,x2,y2", ";").replace(".", ","),
    "tab, decimal comma": lambda p: table(p, "x1,y1,x2,y2", "\t").replace(".", ","),
    "quoted decimal comma": lambda p: table(p, "x1,y1,x2,y2", '","', "{:.3f}")
    .replace("\n", '"\n"').rstrip('"').replace(".", ",").join(['"', ""]),
    "blanks": lambda p: table(p, "x1,y1,x2,y2", "  "),
    "bars": lambda p: table(p, "x1,y1,x2,y2", " | "),
    "savetxt": lambda p: savetxt(p),
    "savetxt, header": lambda p: savetxt(p, header="x1,y1,x2,y2", delimiter=","),
    "savetxt, header in blanks": lambda p: savetxt(p, header="x1 y1 x2 y2", fmt="%.4f"),
    "sep=": lambda p: "sep=;\n" + table(p, "x1,y1,x2,y2", ";"),
    "utf-16": lambda p: table(p, "x1,y1,x2,y2", "\t").encode("utf-16"),
    "utf-16 without mark": lambda p: table(p, "x1,y1,x2,y2", "\t").encode("utf-16-le"),
    "utf-8 with mark": lambda p: table(p, "X1,Y1,X2,Y2").encode("utf-8-sig"),
    "windows": lambda p: table(p, "x1,y1,x2,y2").replace("\n", "\r\n"),
    "latin-1": lambda p: ("# Länge in Pixeln\n" + table(p, "x1,y1,x2,y2")).encode("latin-1"),
    "uv": lambda p: table(p, "u1,v1,u2,v2"),
    "from 0": lambda p: table(p, "x0,y0,x1,y1"),
    "kornia": lambda p: table(p, "mkpts0_x,mkpts0_y,mkpts1_x,mkpts1_y"),
    "left and right": lambda p: table(p, "x_left,y_left,x_right,y_right"),
    "units": lambda p: table(p, "X1 [px],Y1 [px],X2 [px],Y2 [px]"),
    "primes": lambda p: table(p, "x,y,x',y'"),
    "new": lambda p: table(p, "x,y,x_new,y_new"),
    "x and x2": lambda p: table(p, "x,y,x2,y2"),
    "times": lambda p: table(p, "x_t0,y_t0,x_t1,y_t1"),
    "previous": lambda p: table(p, "prev_x,prev_y,curr_x,curr_y"),
    "trailing separator": lambda p: table(p, "x1,y1,x2,y2").replace("\n", ",\n"),
}  # fmt: skip


@pytest.mark.parametrize("dialect", MATCHES)
@pytest.mark.parametrize("suffix", ["csv", "txt", "dat"])
def test_matches_in_every_dialect(
    points: Floats, tmp_path: Path, dialect: str, suffix: str
) -> None:
    content = MATCHES[dialect](points[:, :2])
    path = tmp_path / f"matches.{suffix}"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found = datasets.read(path)
    np.testing.assert_allclose(found.tracks.points, points[:, :2], atol=1e-3)
    assert found.tracks.labels is None


SIGHTINGS = {
    "plain": ("track,frame,x,y", "{p},{f},{x},{y}"),
    "napari": ("track_id,t,y,x", "{p},{f},{y},{x}"),
    "trackpy": (",y,x,mass,size,frame,particle", "0,{y},{x},1.5,2,{f},{p}"),
    "trackpy, floats": ("y,x,frame,particle", "{y},{x},{f}.0,{p}.0"),
    "text ids": ("Track,Frame,X,Y", "Track_{p},{f},{x},{y}"),
    "names of files": ("id;image;x;y", "{p};img_{f}.png;{x};{y}"),
    "times": ("id\ttime\tx\ty", "{p}\t0.{f}\t{x}\t{y}"),
    "confidence": ("track,frame,x,y,confidence", "{p},{f},{x},{y},0.9"),
    "text column": ("track,frame,x,y,label", "{p},{f},{x},{y},car"),
    "boxes": ("frame,id,left,top,width,height", "{f},{p},{x},{y},0,0"),
    "two corners": ("frame,id,x1,y1,x2,y2", "{f},{p},{x},{y},{x},{y}"),
    "no header": ("", "{f},{p},{x},{y}"),
    "other names": ("trackNumber,Frame #,coord_x,coord_y", "{p},{f},{x},{y}"),
    "names, decimal commas": ("y\timage\tobj\tx", "{y}\timg_{f}.png\tobj {p}\t{x}"),
    "large ids": ("track,frame,x,y", "900719925474099300{p},{f},{x},{y}"),
}


@pytest.mark.parametrize("dialect", SIGHTINGS)
def test_sightings_in_every_dialect(points: Floats, tmp_path: Path, dialect: str) -> None:
    path = tmp_path / "tracks.csv"
    text = sightings(points, *SIGHTINGS[dialect])
    if "commas" in dialect:
        text = text.replace(".png", "_png").replace(".", ",").replace("_png", ".png")
    path.write_text(text)
    found = datasets.read(path)
    np.testing.assert_allclose(found.tracks.points, points)
    assert found.tracks.labels is None
    assert found.ids is not None
    assert [text[-1] for text in found.ids] == [str(p) for p in range(TRACKS)]


def test_trackmate_has_three_lines_of_headings(points: Floats, tmp_path: Path) -> None:
    row = "ID{p},{p}{f},{p},5.1,{x},{y},0,{f}.0,{f}"
    names = "LABEL,ID,TRACK_ID,QUALITY,POSITION_X,POSITION_Y,POSITION_Z,POSITION_T,FRAME"
    headings = [
        "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame",
        "Label,Spot ID,Track ID,Quality,X,Y,Z,T,Frame",
        ",,,(quality),(pixel),(pixel),(pixel),(sec),",
    ]
    path = tmp_path / "spots.csv"
    body = sightings(points, "\n".join([names, *headings]), row)
    path.write_text(body + "ID99,99,,5.1,1,2,0,0,0\n")
    found = datasets.read(path)
    np.testing.assert_allclose(found.tracks.points, points)
    assert any("1 positions belong to no track" in note for note in found.notes)


def test_trackmate_xml(points: Floats, tmp_path: Path) -> None:
    particles = "".join(
        "<particle nSpots='5'>"
        + "".join(f"<detection t='{f}' x='{x}' y='{y}' z='0'/>" for f, (x, y) in enumerate(track))
        + "</particle>"
        for track in points
    )
    head = "<?xml version='1.0' encoding='UTF-8'?>"
    (tmp_path / "t.xml").write_text(f"{head}\n<Tracks spaceUnits='µm'>{particles}</Tracks>")
    found = datasets.read(tmp_path / "t.xml")
    np.testing.assert_allclose(found.tracks.points, points)
    assert found.notes == ("TrackMate: positions in units of µm",)


@pytest.mark.parametrize("animals", [False, True])
def test_deeplabcut(points: Floats, tmp_path: Path, animals: bool) -> None:
    head = [["scorer"], ["bodyparts"], ["coords"]]
    for p in range(TRACKS):
        for row, names in zip(
            head, (["net"] * 3, [f"part {p}"] * 3, ["x", "y", "likelihood"]), strict=True
        ):
            row += names
    if animals:
        head.insert(1, ["individuals", *["mouse"] * 3 * TRACKS])
    body = [
        [str(f), *(str(v) for p in range(TRACKS) for v in (*points[p, f], 0.1 if p == f else 0.9))]
        for f in range(FRAMES)
    ]
    (tmp_path / "d.csv").write_text("\n".join(",".join(row) for row in [*head, *body]))
    found = datasets.read(tmp_path / "d.csv")
    lost = np.isnan(found.tracks.points).all(axis=-1)
    assert np.argwhere(lost).tolist() == [[i, i] for i in range(FRAMES)]
    np.testing.assert_allclose(found.tracks.points[~lost], points[~lost])
    assert found.ids is not None
    assert found.ids[3] == ("mouse part 3" if animals else "part 3")


def test_motchallenge_boxes_are_their_centres(points: Floats, tmp_path: Path) -> None:
    path = tmp_path / "gt.txt"
    rows = sightings(points, "", "{f},{p},{x},{y},10,20,1,-1,-1,-1")
    path.write_text(rows + f"0,{TRACKS},5,5,10,20,0,-1,-1,-1\n")
    found = datasets.read(path)
    np.testing.assert_allclose(found.tracks.points, points + np.array([5, 10]))
    assert "1 boxes are marked as not considered: left out" in found.notes


def test_every_view_of_a_wide_table_is_used(points: Floats, tmp_path: Path) -> None:
    names = ",".join(f"x{f},y{f}" for f in range(1, FRAMES + 1))
    (tmp_path / "wide.csv").write_text(table(points, names))
    np.testing.assert_array_equal(datasets.read(tmp_path / "wide.csv").tracks.points, points)
    (tmp_path / "bare.csv").write_text(table(points, ""))
    np.testing.assert_array_equal(datasets.read(tmp_path / "bare.csv").tracks.points, points)


def test_what_is_not_visible_is_nan(points: Floats, tmp_path: Path) -> None:
    path = tmp_path / "tracks.csv"
    plain = sightings(points, "track,frame,x,y,visible", "{p},{f},{x},{y},1").splitlines()
    plain[1] = "0,0,9999,-9999,0"
    plain[2] = "1,0,nan,nan,1"
    plain[3] = "2,0,,,1"
    path.write_text("\n".join(plain))
    found = datasets.read(path)
    lost = np.isnan(found.tracks.points).all(axis=-1)
    assert np.argwhere(lost).tolist() == [[0, 0], [1, 0], [2, 0]]
    assert any(note.startswith("1 of 45 positions are not visible") for note in found.notes)


def test_matches_with_a_missing_view_keep_their_line(tmp_path: Path) -> None:
    path = tmp_path / "m.csv"
    path.write_text("x1,y1,x2,y2,score\n1,2,3,4,.5\n5,6,,,.1\n7,8,9,10,.2\n")
    found = datasets.read(path)
    assert np.isnan(found.tracks.points[1, 1]).all()
    assert len(found.tracks.points) == 3
    assert "column ignored: score" in found.notes


@pytest.mark.parametrize(("given", "read"), [("-1", 0), ("", 0), ("2", 2), ("2.0", 2)])
def test_labels_as_clustering_programs_write_them(tmp_path: Path, given: str, read: int) -> None:
    path = tmp_path / "m.csv"
    path.write_text(f"x1,y1,x2,y2,label\n1,2,3,4,{given}\n5,6,7,8,1\n")
    labels = datasets.read(path).tracks.labels
    assert labels is not None
    assert labels.tolist() == [read, 1]


def test_pixel_grids_without_a_header_are_matches(tmp_path: Path) -> None:
    x, y = np.meshgrid(np.arange(12), np.arange(10))
    first = np.stack([x, y], axis=-1).reshape(-1, 2)
    second = first + np.array([3, 2])
    np.savetxt(tmp_path / "flow.txt", np.hstack([first, second]), fmt="%d")
    assert datasets.read(tmp_path / "flow.txt").tracks.points.shape == (120, 2, 2)


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize("batch", [False, True])
@pytest.mark.parametrize("named", [False, True])
def test_arrays_of_neural_trackers(
    points: Floats, tmp_path: Path, swap: bool, batch: bool, named: bool
) -> None:
    array = points.swapaxes(0, 1) if swap else points
    visible = np.ones(points.shape[:2], bool)
    visible[2, 1] = False
    flags = visible.T if swap else visible
    if batch:
        array, flags = array[None], flags[None]
    names = ("pred_tracks", "pred_visibility") if named else ("xy", "visible")
    path = tmp_path / "tracks.npz"
    np.savez(path, **{names[0]: array.astype(np.float32), names[1]: flags}, fps=25)
    found = datasets.read(path)
    expected = np.where(visible[..., None], points, np.nan)
    np.testing.assert_allclose(found.tracks.points, expected, atol=1e-4)
    np.savez(path, **{names[0]: array, "occluded": ~flags})
    np.testing.assert_allclose(datasets.read(path).tracks.points, expected)


def test_a_grid_of_queries_is_not_taken_for_time(tmp_path: Path) -> None:
    """The tracks of a regular grid lie closer to each other than a fast one is to itself."""
    y, x = np.mgrid[0:200:4, 0:300:4]
    start = np.stack([x, y], axis=-1).reshape(-1, 1, 2)
    fast = start + np.arange(12)[:, None] * [9, 5]
    for array in (fast, fast.swapaxes(0, 1)):
        np.save(tmp_path / "t.npy", array)
        np.testing.assert_array_equal(datasets.read(tmp_path / "t.npy").tracks.points, fast)


def test_other_containers_of_arrays(points: Floats, tmp_path: Path) -> None:
    np.save(tmp_path / "t.npy", points)
    (tmp_path / "t.json").write_text(json.dumps(points.tolist()))
    scipy.io.savemat(tmp_path / "t.mat", {"tracks": points})
    scipy.io.savemat(tmp_path / "struct.mat", {"data": {"tracks": points, "note": "mine"}})
    for name in ("t.npy", "t.json", "t.mat", "struct.mat"):
        np.testing.assert_array_equal(datasets.read(tmp_path / name).tracks.points, points)
    rows = [
        [p, f, *points[p, f, ::-1]] for p in range(TRACKS) for f in range(FRAMES)
    ]  # fmt: skip
    np.save(tmp_path / "napari.npy", np.array(rows))
    np.testing.assert_array_equal(datasets.read(tmp_path / "napari.npy").tracks.points, points)


def test_null_in_json_is_not_visible(points: Floats, tmp_path: Path) -> None:
    nested = points.tolist()
    nested[1][2] = None
    nested[3][0] = [None, None]
    (tmp_path / "t.json").write_text(json.dumps(nested))
    lost = np.isnan(datasets.read(tmp_path / "t.json").tracks.points).all(axis=-1)
    assert np.argwhere(lost).tolist() == [[1, 2], [3, 0]]


def test_vectors_by_the_names_of_columns(points: Floats, tmp_path: Path) -> None:
    names = ("x1", "y1", "x2", "y2")
    vectors = dict(zip(names, points[:, :2].reshape(-1, 4).T, strict=True))
    scipy.io.savemat(tmp_path / "v.mat", {"table": vectors})
    np.savez(tmp_path / "v.npz", **vectors)
    records = [dict(zip(names, row, strict=True)) for row in points[:, :2].reshape(-1, 4).tolist()]
    (tmp_path / "v.json").write_text(json.dumps(records))
    (tmp_path / "v.jsonl").write_text("\n".join(map(json.dumps, records)))
    for name in ("v.mat", "v.npz", "v.json", "v.jsonl"):
        np.testing.assert_array_equal(datasets.read(tmp_path / name).tracks.points, points[:, :2])


@pytest.mark.parametrize("matches", ["pairs", "partners", "rows"])
def test_lightglue_and_superglue(
    points: Floats, tmp_path: Path, rng: np.random.Generator, matches: str
) -> None:
    order = rng.permutation(TRACKS)
    first, second = points[:, 0], points[order, 1]
    partner = np.argsort(order)
    kept = np.arange(TRACKS) if matches == "rows" else np.arange(0, TRACKS, 2)
    content = {"keypoints0": first, "keypoints1": second}
    if matches == "rows":
        content["keypoints1"] = points[:, 1]
    elif matches == "pairs":
        content["matches"] = np.stack([kept, partner[kept]], axis=1)
    else:
        content["matches0"] = np.where(np.arange(TRACKS) % 2, -1, partner)
    np.savez(tmp_path / "pair.npz", **content)
    found = datasets.read(tmp_path / "pair.npz")
    np.testing.assert_array_equal(found.tracks.points, points[kept, :2])
    assert found.ids == tuple(map(str, kept))


def colmap_database(path: Path, points: Floats, names: list[str]) -> None:
    """A database as COLMAP 3.x lays it out."""
    database = sqlite3.connect(path)
    database.execute("create table images (image_id integer, name text, camera_id integer)")
    for name in ("keypoints", "matches", "two_view_geometries"):
        key = "image_id" if name == "keypoints" else "pair_id"
        database.execute(
            f"create table {name} ({key} integer, rows integer, cols integer, data blob)"
        )
    for image, name in enumerate(names, 1):
        database.execute("insert into images values (?, ?, 1)", (image, name))
        own = np.zeros((len(points), 6), np.float32)
        own[:, :2] = points[:, image - 1] + 0.5
        row = (image, *own.shape, own.tobytes())
        database.execute("insert into keypoints values (?, ?, ?, ?)", row)
    for second in range(2, len(names) + 1):
        pairs = np.repeat(np.arange(len(points), dtype=np.uint32)[:, None], 2, axis=1)
        row = (2147483647 + second, *pairs.shape, pairs.tobytes())
        database.execute("insert into matches values (?, ?, ?, ?)", row)
    database.commit()
    database.close()


def test_colmap_database(points: Floats, tmp_path: Path) -> None:
    colmap_database(tmp_path / "two.db", points, ["a.jpg", "b.jpg"])
    found = datasets.read(tmp_path / "two.db")
    np.testing.assert_allclose(found.tracks.points, points[:, :2], atol=1e-4)
    colmap_database(tmp_path / "three.db", points, ["a.jpg", "b.jpg", "c.jpg"])
    with pytest.raises(DataError, match=r"2 pairs of images .*choose one: '.*three.db#a.jpg,b"):
        datasets.read(tmp_path / "three.db")
    found = datasets.read(f"{tmp_path / 'three.db'}#a.jpg,c.jpg")
    np.testing.assert_allclose(found.tracks.points, points[:, [0, 2]], atol=1e-4)


def test_hdf5_of_hloc_and_matlab(points: Floats, tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "features.h5", "w") as file:
        for f, name in enumerate(("db/1.jpg", "query/2.jpg")):
            file[f"{name}/keypoints"] = points[:, f].astype(np.float32)
    with h5py.File(tmp_path / "matches.h5", "w") as file:
        partner = np.where(np.arange(TRACKS) == 4, -1, np.arange(TRACKS))
        file["db-1.jpg/query-2.jpg/matches0"] = partner.astype(np.int16)
    found = datasets.read(tmp_path / "matches.h5")
    kept = np.delete(np.arange(TRACKS), 4)
    np.testing.assert_allclose(found.tracks.points, points[kept, :2], atol=1e-4)
    with h5py.File(tmp_path / "plain.h5", "w") as file:
        file["tracks"] = points
    np.testing.assert_array_equal(datasets.read(tmp_path / "plain.h5").tracks.points, points)
    path = tmp_path / "v73.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["tracks"] = points.T
    path.write_bytes(b"MATLAB 7.3 MAT-file".ljust(512, b"\0") + path.read_bytes()[512:])
    np.testing.assert_array_equal(datasets.read(path).tracks.points, points)


def test_tracks_of_opencv(tmp_path: Path, rng: np.random.Generator) -> None:
    """What ``cv2.calcOpticalFlowPyrLK`` returns, saved as users do, with its status."""
    first = cv2.GaussianBlur(rng.integers(0, 255, (120, 160), dtype=np.uint8), (0, 0), 1.5)
    second = np.roll(first, (2, 3), axis=(0, 1))
    corners = cv2.goodFeaturesToTrack(first, 40, 0.01, 8)
    moved, status, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, None)
    path = tmp_path / "klt.npz"
    np.savez(path, tracks=np.concatenate([corners, moved], axis=1), valid=status.repeat(2, axis=1))
    found = datasets.read(path).tracks.points
    assert found.shape == (len(corners), 2, 2)
    inside = np.abs(np.nan_to_num(found[:, 1] - found[:, 0]) - [3, 2]).max(axis=1) < 0.2
    assert inside.mean() > 0.8


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("t.csv", b"a,b\n1,2\n", "a table with the columns a, b; expected x1,y1,x2,y2"),
        ("t.txt", b"1 2 3\n4 5 6\n", "3 columns without names; expected a first line"),
        ("t.json", b'{"boxes": [1, 2]}', "holds boxes .list.; expected an array of tracks"),
        ("t.json", b"[1, 2", "not JSON"),
        ("t.json", b'{"schema": "mssegment/tracks/1"}', "an mssegment document"),
        ("t.bin", b"abc\0\1\2", "a binary file of an unknown kind"),
        ("t.npz", b"PK\x03\x04broken", "damaged archive"),
        ("t.npy", b"\x93NUMPY\1\0", "damaged numpy file"),
        ("t.db", b"SQLite format 3\0" + bytes(100), "database"),
        ("t.csv", b"", "empty"),
        ("t.csv", b"x1,y1,x2,y2\n", "0 tracks over 2 frames"),
        ("t.xml", b"<a><b></a>", "not XML"),
        ("t.html", b"<!DOCTYPE html><p>", "HTML"),
        (
            "t.pkl",
            b"\x80\x04\x95abc",
            "a Python pickle .which may run any code.,",
        ),
        ("t.parquet", b"PAR1abc", "a Parquet file, which is not read"),
        ("det.txt", b"1,-1,5,6,10,20,0.9\n1,-1,8,6,10,20,0.8\n", "belong to no track"),
    ],
)
def test_what_cannot_be_read_says_what_it_is(
    tmp_path: Path, name: str, content: bytes, words: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(DataError, match=words) as caught:
        datasets.read(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", tracks=np.array([{"x": 1}], dtype=object))
    with pytest.raises(DataError, match="expected an array"):
        datasets.read(tmp_path / "t.npz")
    np.save(tmp_path / "t.npy", np.array([{"x": 1}], dtype=object))
    with pytest.raises(DataError, match="pickled"):
        datasets.read(tmp_path / "t.npy")


def test_several_arrays_must_be_named(points: Floats, tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", one=points, two=points + 1)
    with pytest.raises(DataError, match=r"choose one: '.*t.npz#one'"):
        datasets.read(tmp_path / "t.npz")
    found = datasets.read(f"{tmp_path / 't.npz'}#two")
    np.testing.assert_array_equal(found.tracks.points, points + 1)


# --- a row per frame, a list of tracks, a measurement matrix, further pairs of arrays -------------


def timeline(points: Floats, name: str, time: str = "") -> str:
    head = [time] * bool(time) + [
        name.format(p=p, axis=a) for p in range(len(points)) for a in "XY"
    ]
    rows = [
        [str(0.04 * f)] * bool(time) + [f"{v:.3f}" for v in points[:, f].ravel()]
        for f in range(points.shape[1])
    ]
    return "\n".join(";".join(row) for row in [head, *rows]) + "\n"


@pytest.mark.parametrize(
    ("name", "time"),
    [
        ("P{p} {axis}", "Time"),
        ("{axis}{p}", "t"),
        ("{axis}_marker{p}", "frame"),
        ("pt{p}_{axis}", "t"),
    ],
)
def test_a_row_per_frame(points: Floats, tmp_path: Path, name: str, time: str) -> None:
    (tmp_path / "t.csv").write_text(timeline(points, name, time))
    found = datasets.read(tmp_path / "t.csv")
    np.testing.assert_allclose(found.tracks.points, points)
    assert found.notes[0] == f"read as a row per frame: {FRAMES} frames of {TRACKS} points"


def test_named_points_need_no_times_and_may_be_unlikely(points: Floats, tmp_path: Path) -> None:
    parts = ("nose", "left ear", "tail")
    head = ",".join(f"{part} x,{part} y,{part} likelihood" for part in parts)
    rows = [
        ",".join(f"{x},{y},{0.2 if p == f else 0.9}" for p, (x, y) in enumerate(points[:3, f]))
        for f in range(FRAMES)
    ]
    (tmp_path / "t.csv").write_text("\n".join([head, *rows]))
    found = datasets.read(tmp_path / "t.csv")
    assert found.ids == ("nose", "left_ear", "tail")
    lost = np.isnan(found.tracks.points).any(axis=-1)
    assert np.argwhere(lost).tolist() == [[0, 0], [1, 1], [2, 2]]
    np.testing.assert_allclose(found.tracks.points[~lost], points[:3][~lost])


def test_views_beside_a_time_are_still_one_match_per_line(points: Floats, tmp_path: Path) -> None:
    rows = [f"{p},{','.join(map(str, points[p, :2].ravel()))}" for p in range(TRACKS)]
    (tmp_path / "m.csv").write_text("\n".join(["time,x1,y1,x2,y2", *rows]))
    np.testing.assert_allclose(datasets.read(tmp_path / "m.csv").tracks.points, points[:, :2])


def test_a_time_that_stands_twice_is_no_row_per_frame(points: Floats, tmp_path: Path) -> None:
    text = timeline(points, "P{p} {axis}", "Time").splitlines()
    (tmp_path / "t.csv").write_text("\n".join([*text, text[2]]))
    with pytest.raises(DataError, match=r"t\.csv: line 7: time 0\.04 a second time"):
        datasets.read(tmp_path / "t.csv")
    rows = [f"a.png,{','.join(map(str, points[p, :3].ravel()))}" for p in range(TRACKS)]
    (tmp_path / "t.csv").write_text("\n".join(["file,x1,y1,x2,y2,x3,y3", *rows]))
    with pytest.raises(DataError, match=r"line 3: file a\.png a second time"):
        datasets.read(tmp_path / "t.csv")


LISTS: dict[str, Callable[[Floats], object]] = {
    "frames": lambda p: {
        "tracks": [
            {"id": i, "frames": list(range(FRAMES)), "points": own}
            for i, own in enumerate(p.tolist())
        ]
    },
    "no frames": lambda p: [{"points": own} for own in p.tolist()],
    "objects": lambda p: {
        "tracks": [{"path": [{"x": x, "y": y} for x, y in own]} for own in p.tolist()]
    },
    "frames inside": lambda p: [
        {"id": i, "points": [{"frame": f, "x": x, "y": y} for f, (x, y) in enumerate(own)]}
        for i, own in enumerate(p.tolist())
    ],
    "x and y": lambda p: {
        "objects": [{"x": own[:, 0].tolist(), "y": own[:, 1].tolist()} for own in p]
    },
}


@pytest.mark.parametrize("name", LISTS)
def test_a_list_of_tracks(points: Floats, tmp_path: Path, name: str) -> None:
    (tmp_path / "t.json").write_text(json.dumps(LISTS[name](points)))
    np.testing.assert_allclose(datasets.read(tmp_path / "t.json").tracks.points, points)


def test_positions_of_a_list_may_be_missing(tmp_path: Path) -> None:
    """As a whole, or one of its coordinates."""
    listed = [[1.0, 2.0], None, [3.0, None], [4.0, 5.0]]
    (tmp_path / "t.json").write_text(json.dumps([{"points": listed}, {"points": [[1.0, 2.0]] * 4}]))
    (found, _) = datasets.read(tmp_path / "t.json").tracks.points
    np.testing.assert_array_equal(np.isnan(found).all(axis=1), [False, True, True, False])
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), [False, True, True, False])


def test_tracks_of_a_list_that_begin_late_are_not_seen_before(
    points: Floats, tmp_path: Path
) -> None:
    tracks = [{"start": i % 3, "points": points[i, i % 3 :].tolist()} for i in range(TRACKS)]
    (tmp_path / "t.json").write_text(json.dumps({"tracks": tracks}))
    found = datasets.read(tmp_path / "t.json").tracks.points
    for i in range(TRACKS):
        assert np.isnan(found[i, : i % 3]).all()
        np.testing.assert_allclose(found[i, i % 3 :], points[i, i % 3 :])


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"points": [[1, 2, 3], [4, 5, 6]]}, "track 2: 3 numbers in a position"),
        ({"points": [[1, "a"], [2, 3]]}, r"track 2: expected positions \[x, y\]"),
        ({"points": [[1, 2], [3]]}, r"track 2: expected positions \[x, y\]"),
        ({"points": [[1, 2], [3, 4]], "frames": [1]}, "track 2: 2 positions and 1 frames"),
        ({"points": [[1, 2], [3, 4]], "frames": [1, 1]}, "track 2: a frame stands twice"),
        ({"points": [[1, 2], [3, 4]], "start": "soon"}, "track 2: start is 'soon'"),
    ],
)
def test_a_list_of_tracks_that_is_wrong(entry: object, said: str, tmp_path: Path) -> None:
    good = {"points": [[1.0, 2.0], [3.0, 4.0]]}
    (tmp_path / "t.json").write_text(json.dumps({"tracks": [good, entry]}))
    with pytest.raises(DataError, match=said):
        datasets.read(tmp_path / "t.json")


@pytest.mark.parametrize("halves", [False, True])
def test_a_measurement_matrix(points: Floats, tmp_path: Path, halves: bool) -> None:
    order = (2, 1, 0) if halves else (1, 2, 0)
    scipy.io.savemat(tmp_path / "w.mat", {"W": points.transpose(order).reshape(2 * FRAMES, -1)})
    found = datasets.read(tmp_path / "w.mat")
    np.testing.assert_allclose(found.tracks.points, points)
    assert ("then all of y" in found.notes[0]) == halves


@pytest.mark.parametrize(
    "names", [("x1", "x2"), ("kptsA", "kptsB"), ("src", "dst"), ("P_left", "P_right")]
)
@pytest.mark.parametrize("layout", ["rows", "columns", "homogeneous"])
def test_two_arrays_of_positions_are_matches(
    points: Floats, tmp_path: Path, names: tuple[str, str], layout: str
) -> None:
    both = [points[:, 0], points[:, 1]]
    if layout == "homogeneous":
        both = [np.column_stack([own, np.ones(TRACKS)]) for own in both]
    if layout != "rows":
        both = [own.T for own in both]
    np.savez(tmp_path / "m.npz", **dict(zip(names, both, strict=True)))
    np.testing.assert_allclose(datasets.read(tmp_path / "m.npz").tracks.points, points[:, :2])


def test_pairs_of_arrays_that_are_no_positions_are_no_matches(tmp_path: Path) -> None:
    """Pictures, descriptors, and points in space."""
    space = np.arange(30.0).reshape(10, 3)
    for shape in ((48, 64), (256, 20)):
        np.savez(tmp_path / "m.npz", image0=np.ones(shape), image1=np.ones(shape))
        with pytest.raises(DataError, match="holds image0"):
            datasets.read(tmp_path / "m.npz")
    np.savez(tmp_path / "m.npz", x1=space, x2=space + 1)
    with pytest.raises(DataError, match="holds x1"):
        datasets.read(tmp_path / "m.npz")


def test_weights_beside_tracks_are_no_measurement_matrix(points: Floats, tmp_path: Path) -> None:
    np.savez(tmp_path / "t.npz", tracks=points[:8], W=np.ones((8, FRAMES)))
    np.testing.assert_allclose(datasets.read(tmp_path / "t.npz").tracks.points, points[:8])
