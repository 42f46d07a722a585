"""Results as files of other tools, read by the readers of these tools."""

from __future__ import annotations

import csv
import io
import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendering_samples import affine_report, picture

from mssegment.cli import invoke
from mssegment.export import EXPORTS, MASK_STYLES, export, mask_files
from mssegment.export.mask_styles import run_lengths
from mssegment.export.names import frame_names
from mssegment.export.png import encode_png, voc_palette
from mssegment.records import Frame, replace
from mssegment.rendering.csv_text import neutral
from mssegment.rendering.tables import format_report


def report_with(**changes):
    report = affine_report(truth=False)
    return replace(report, **changes)


def rows_of(content: bytes) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(content.decode())))


def square_masks(report):
    """A mask per frame: motion 1 on the left, motion 2 in the middle, the rim not known."""
    for index, frame in enumerate(report.frames):
        mask = np.zeros((frame.height, frame.width), dtype=np.uint8)
        mask[20:60, 10 + index : 50 + index] = 1
        mask[80:120, 100:160] = 2
        mask[:2] = 255
        yield mask


def masks_in(style, report=None):
    report = report or report_with()
    return dict(mask_files(report, style, square_masks(report)))


def test_tracks_csv_has_numbers_and_the_ids_of_the_user():
    report = report_with()
    ids = tuple(f"={i}" if i % 2 else str(10**15 + i) for i in range(len(report.labels)))
    report = replace(report, tracks=replace(report.tracks, ids=ids))
    rows = rows_of(export(report, ["tracks"])["tracks.csv"])
    assert len(rows) == report.tracks.visible.sum()
    assert rows[0]["id"] == str(10**15)
    assert rows[2]["id"] == "'=1"
    for row in rows:
        track = ids.index(row["id"].removeprefix("'"))
        assert int(row["motion"]) == report.labels[track]
        assert row["inlier"] == str(int(report.labels[track] > 0))
        x, y = report.tracks.points[track, int(row["frame"])]
        assert abs(float(row["x"]) - x) < 1e-3 > abs(float(row["y"]) - y)
        assert (row["residual_px"] == "") == (report.labels[track] <= 0)


def test_objects_csv_has_boxes_around_the_tracks_and_their_displacement():
    rows = rows_of(export(report_with(), ["objects"])["objects.csv"])
    assert [(row["frame"], row["motion"]) for row in rows] == [
        ("0", "1"),
        ("0", "2"),
        ("1", "1"),
        ("1", "2"),
    ]
    assert rows[0]["dx"] == ""
    assert abs(float(rows[2]["dx"]) - 12) < 0.3 > abs(float(rows[2]["dy"]) - 4)
    assert abs(float(rows[3]["displacement_px"]) - np.hypot(9, 6)) < 0.3
    for row in rows:
        assert float(row["x_min"]) <= float(row["centroid_x"]) <= float(row["x_max"])
        assert float(row["y_min"]) <= float(row["centroid_y"]) <= float(row["y_max"])


def test_the_camera_is_no_object_of_mot_but_marked_in_the_tables():
    report = report_with()
    report = replace(report, segmentation=replace(report.segmentation, camera_motion=1))
    files = export(report, ["mot", "objects"])
    assert {line.split(b",")[1] for line in files["mot.txt"].splitlines()} == {b"2"}
    cameras = {row["motion"]: row["camera"] for row in rows_of(files["objects.csv"])}
    assert cameras == {"1": "1", "2": "0"}


def test_motmetrics_reads_the_boxes(tmp_path):
    motmetrics = pytest.importorskip("motmetrics")
    path = tmp_path / "mot.txt"
    path.write_bytes(export(report_with(), ["mot"])["mot.txt"])
    table = motmetrics.io.loadtxt(str(path), fmt="mot15-2D", min_confidence=0)
    assert sorted(table.index.tolist()) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    rows = rows_of(export(report_with(), ["objects"])["objects.csv"])
    assert abs(table.loc[(1, 1), "X"] - float(rows[0]["x_min"])) < 0.01
    assert (
        abs(table.loc[(2, 2), "Width"] - (float(rows[3]["x_max"]) - float(rows[3]["x_min"]))) < 0.02
    )


def test_npz_has_what_python_needs():
    report = report_with()
    loaded = np.load(io.BytesIO(export(report, ["npz"])["tracks.npz"]), allow_pickle=False)
    assert np.array_equal(loaded["points"], report.tracks.points, equal_nan=True)
    assert np.array_equal(loaded["labels"], report.labels)
    assert loaded["ids"][0] == "1"
    assert loaded["matrices"].shape == (2, 3, 3)
    assert export(report, ["npz"]) == export(report, ["npz"])


def test_davis_masks_keep_indices_and_palette():
    image = pytest.importorskip("PIL.Image")
    files = masks_in("davis")
    assert list(files) == ["masks/1.png", "masks/2.png"]
    expected = list(square_masks(report_with()))[1]
    with image.open(io.BytesIO(files["masks/2.png"])) as opened:
        assert opened.mode == "P"
        assert np.array_equal(np.asarray(opened), expected)
        assert opened.getpalette()[:12] == [0, 0, 0, 128, 0, 0, 0, 128, 0, 128, 128, 0]


def test_colmap_masks_are_named_after_the_picture_and_zero_on_what_moves():
    files = masks_in(
        "colmap", report_with(frames=(Frame("a/1.jpg", 320, 240), Frame("a/2.jpg", 320, 240)))
    )
    assert list(files) == ["masks/1.jpg.png", "masks/2.jpg.png"]
    mask = cv2.imdecode(np.frombuffer(files["masks/1.jpg.png"], np.uint8), cv2.IMREAD_UNCHANGED)
    expected = next(square_masks(report_with()))
    assert ((mask == 0) == ((expected == 1) | (expected == 2))).all()
    assert set(np.unique(mask)) == {0, 255}


def test_colmap_masks_of_a_video_are_those_of_pictures_taken_out_of_it():
    frames = tuple(Frame("a/clip.mp4", 320, 240, index=i) for i in (0, 5))
    files = masks_in("colmap", report_with(frames=frames))
    assert list(files) == ["masks/00000.png.png", "masks/00005.png.png"]


def test_binary_masks_have_a_folder_per_object():
    files = masks_in("binary")
    assert sorted(files) == ["masks/1/1.png", "masks/1/2.png", "masks/2/1.png", "masks/2/2.png"]
    mask = cv2.imdecode(np.frombuffer(files["masks/2/1.png"], np.uint8), cv2.IMREAD_UNCHANGED)
    assert ((mask == 255) == (next(square_masks(report_with())) == 2)).all()


def test_pycocotools_reads_the_objects(tmp_path):
    coco = pytest.importorskip("pycocotools.coco")
    path = tmp_path / "masks.json"
    path.write_bytes(masks_in("coco")["masks.json"])
    read = coco.COCO(str(path))
    expected = list(square_masks(report_with()))
    assert len(read.anns) == 4
    for annotation in read.anns.values():
        own = expected[annotation["image_id"] - 1] == annotation["track_id"]
        assert np.array_equal(read.annToMask(annotation), own)
        assert annotation["area"] == own.sum()


@given(st.lists(st.lists(st.booleans(), min_size=3, max_size=3), min_size=1, max_size=5))
def test_run_lengths_are_those_of_pycocotools(rows):
    own = np.array(rows)
    runs = run_lengths(own)
    assert sum(runs) == own.size
    values = np.repeat(np.arange(len(runs)) % 2, runs)
    assert np.array_equal(values.reshape(own.shape, order="F"), own)


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (40, 33)])
def test_png_is_lossless(shape, rng):
    indices = rng.integers(0, 256, shape).astype(np.uint8)
    for palette in (None, voc_palette()):
        found = cv2.imdecode(
            np.frombuffer(encode_png(indices, palette), np.uint8), cv2.IMREAD_COLOR
        )
        expected = voc_palette()[indices][..., ::-1] if palette is not None else indices[..., None]
        assert (found == expected).all()


@given(
    st.lists(
        st.sampled_from(["a/1.png", "a/2.png", "b/1.png", "a/1.jpg", "../x/1.png", "/r/1.png"]),
        min_size=2,
        max_size=5,
        unique=True,
    )
)
def test_every_frame_has_a_file_of_its_own_below_the_folder(paths):
    frames = [Frame(path, 9, 9) for path in paths]
    for suffix in (False, True):
        names = frame_names(frames, suffix=suffix)
        assert len(set(names)) == len(paths)
        assert all(name and not name.startswith("/") and ".." not in name for name in names)


@given(st.text(max_size=6))
def test_no_text_is_a_formula(text):
    safe = str(neutral(text))
    assert safe.removeprefix("'") == text or safe == text
    if safe.startswith(("=", "+", "-", "@")) and safe != "-":
        float(safe)


def test_a_table_as_csv_holds_numbers_alone():
    lines = format_report(report_with(), "csv").splitlines()
    assert lines[1].startswith("1,30,")


def test_run_writes_what_is_asked_for(tmp_path):
    for index in range(2):
        cv2.imwrite(str(tmp_path / f"{index}.png"), noise(index))
    names = [str(tmp_path / f"{index}.png") for index in range(2)]
    out = tmp_path / "out"
    of_tracks = [name for name, each in EXPORTS.items() if each.of_pictures]
    asked = [part for name in of_tracks for part in ("--export", name)]
    assert invoke(["run", *names, "--out", str(out), "--masks", "-q", *asked]) == 0
    for name in (
        "tracks.csv",
        "objects.csv",
        "mot.txt",
        "tracks.npz",
        "masks/0.png",
        "masks/1.png",
    ):
        assert (out / name).is_file(), name
    document = str(out / "segmentation.json")
    other = tmp_path / "other"
    for style in MASK_STYLES:
        command = ["report", document, "--masks", "--mask-style", style, "--out", str(other), "-q"]
        assert invoke([*command, "--force"]) == 0
    assert json.loads((other / "masks.json").read_text())["images"][1]["file_name"] == "1.png"


def noise(index):
    """A patch that moves over a wall that does not."""
    rng = np.random.default_rng(1)
    wall, patch = (
        cv2.GaussianBlur(rng.uniform(0, 255, s), (0, 0), 1.5) for s in ((160, 200), (60, 70))
    )
    scene = cv2.normalize(wall, None, 0, 255, cv2.NORM_MINMAX)
    scene[50:110, 60 + 8 * index : 130 + 8 * index] = cv2.normalize(
        patch, None, 0, 255, cv2.NORM_MINMAX
    )
    return scene.astype(np.uint8)


def test_files_without_a_folder_are_refused(tmp_path, capsys):
    document = tmp_path / "segmentation.json"
    document.write_text("{}")
    for option in (["--masks"], ["--export", "mot"], ["--video"]):
        assert invoke(["report", str(document), *option]) == 2
        assert "name a folder for them with --out DIR" in capsys.readouterr().err


def test_masks_without_pictures_are_refused():
    from mssegment.errors import DataError

    report = replace(report_with(), pictures=lambda index: None)
    with pytest.raises(DataError, match="masks need the picture of every frame"):
        dict(mask_files(report))
    assert picture(0).shape == (240, 320, 3)


def test_masks_of_tracks_without_pictures_are_refused_before_the_work(tmp_path, capsys):
    table = tmp_path / "m.csv"
    table.write_text("x1,y1,x2,y2\n" + "".join(f"{i},{i * i % 97},{i + 5},9\n" for i in range(60)))
    out = tmp_path / "out"
    assert invoke(["run", str(table), "--masks", "--out", str(out)]) == 2
    assert "no pictures of these tracks; name those" in capsys.readouterr().err
    assert not out.exists()
