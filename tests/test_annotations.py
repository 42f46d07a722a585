"""Labels of pixels in the forms of other tools: the same objects in all of them."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from mssegment.annotations import frames_of, read_annotations, scaled
from mssegment.annotations.coco import decode_runs
from mssegment.errors import DataError
from mssegment.ground_truth import read_truth
from mssegment.records import Frame, Tracks

H, W = 30, 40


def mask() -> np.ndarray:
    """Object 1 at the top left, object 2 at the right."""
    picture = np.zeros((H, W), np.uint8)
    picture[4:15, 5:16] = 1
    picture[12:26, 22:36] = 2
    return picture


OUTLINES = {1: [[5, 4], [16, 4], [16, 15], [5, 15]], 2: [[22, 12], [36, 12], [36, 26], [22, 26]]}


def runs(binary: np.ndarray) -> list[int]:
    flat = binary.T.ravel()
    edges = np.flatnonzero(np.diff(np.r_[0, flat.astype(int), 1 - int(flat[-1])])).tolist()
    return np.diff([0, *edges]).tolist()


def labelme(shapes: list[dict[str, object]], name: str = "frame-1.png") -> str:
    return json.dumps(
        {"version": "5", "shapes": shapes, "imagePath": name, "imageHeight": H, "imageWidth": W}
    )


def coco(kind: str) -> str:
    annotations = []
    for label, outline in OUTLINES.items():
        flat = [float(v) for point in outline for v in point]
        code = {"size": [H, W], "counts": runs(mask() == label)}
        annotations.append(
            {
                "id": label,
                "image_id": 7,
                "category_id": label,
                "segmentation": [flat] if kind == "polygon" else code,
                "iscrowd": 0,
            }
        )
    images = [{"id": 7, "file_name": "frame-1.png", "width": W, "height": H}]
    categories = [{"id": 1, "name": "car"}, {"id": 2, "name": "bus"}]
    return json.dumps({"images": images, "annotations": annotations, "categories": categories})


def points_of(outline: list[list[int]]) -> str:
    return ";".join(f"{x}.0,{y}.0" for x, y in outline)


CVAT_IMAGES = (
    f'<?xml version="1.0"?><annotations><image id="0" name="frame-1.png" width="{W}" height="{H}">'
    f'<box label="car" xtl="5" ytl="4" xbr="16" ybr="15" z_order="0"/>'
    f'<polygon label="bus" points="{points_of(OUTLINES[2])}" z_order="1"/>'
    '<points label="nose" points="3,3"/></image></annotations>'
)
CVAT_VIDEO = (
    f"<annotations><meta><task><original_size><width>{W}</width><height>{H}</height>"
    "</original_size></task></meta>"
    + "".join(
        f'<track id="{label}" label="car">'
        f'<polygon frame="0" outside="0" points="{points_of(outline)}"/>'
        f'<polygon frame="1" outside="1" points="{points_of(outline)}"/></track>'
        for label, outline in OUTLINES.items()
    )
    + "</annotations>"
)
SHAPES = {
    "labelme": labelme(
        [
            {"label": "car", "points": OUTLINES[1], "shape_type": "polygon"},
            {"label": "bus", "points": [[22, 12], [36, 26]], "shape_type": "rectangle"},
            {"label": "pole", "points": [[1, 1], [2, 2]], "shape_type": "line"},
        ]
    ),
    "labelme, one label twice": labelme(
        [{"label": "car", "points": o, "group_id": None} for o in OUTLINES.values()]
    ),
    "labelme, numbers": labelme([{"label": str(n), "points": o} for n, o in OUTLINES.items()]),
    "coco polygons": coco("polygon"),
    "coco runs": coco("runs"),
    "cvat images": CVAT_IMAGES,
    "cvat video": CVAT_VIDEO,
}


@pytest.mark.parametrize("kind", SHAPES)
def test_shapes_become_the_mask(tmp_path: Path, kind: str) -> None:
    path = tmp_path / ("labels.xml" if kind.startswith("cvat") else "labels.json")
    path.write_text(SHAPES[kind])
    (found,) = read_annotations([str(path)]).frames
    np.testing.assert_array_equal(found.mask, mask())


def test_compressed_runs_of_pycocotools() -> None:
    masks = pytest.importorskip("pycocotools.mask")
    rng = np.random.default_rng(0)
    for _ in range(20):
        shape = rng.integers(3, 60, 2)
        binary = (cv2.blur(rng.random(shape), (5, 5)) > 0.5).astype(np.uint8)
        code = masks.encode(np.asfortranarray(binary))
        own = {"size": code["size"], "counts": code["counts"].decode()}
        np.testing.assert_array_equal(decode_runs(own, "x"), binary)
        plain = {"size": list(shape), "counts": runs(binary)}
        np.testing.assert_array_equal(decode_runs(plain, "x"), binary)


def test_objects_keep_their_number_through_the_frames(tmp_path: Path) -> None:
    for i, order in enumerate(([1, 2], [2, 1])):
        shapes = [{"label": f"object {n}", "points": OUTLINES[n], "group_id": 3} for n in order]
        (tmp_path / f"{i}.json").write_text(labelme(shapes, f"frame-{i}.png"))
    found = read_annotations([str(tmp_path)])
    assert [np.unique(own.mask[5:10, 6:14]).tolist() for own in found.frames] == [[1], [1]]
    assert found.notes == ("labelled objects: 1 object 1, 2 object 2",)


def test_ignored_regions_and_background(tmp_path: Path) -> None:
    shapes = [{"label": "ignore", "points": OUTLINES[1]}, {"label": "car", "points": OUTLINES[2]}]
    (tmp_path / "a.json").write_text(labelme(shapes))
    (found,) = read_annotations([str(tmp_path / "a.json")]).frames
    assert found.mask[8, 8] == 255
    assert found.mask[20, 30] == 1


def save(path: Path, picture: np.ndarray) -> str:
    assert cv2.imwrite(str(path), picture)
    return str(path)


def stored(kind: str, path: Path) -> str:
    labels = mask()
    if kind == "grey":
        return save(path, labels)
    if kind == "16 bits":
        return save(path, labels.astype(np.uint16))
    if kind == "colours":
        return save(path, np.array([[0, 0, 0], [142, 0, 0], [60, 20, 220]], np.uint8)[labels])
    if kind == "grey in colour":
        return save(path, np.dstack([labels] * 3))
    image = pytest.importorskip("PIL.Image")
    picture = image.fromarray(labels, "P" if kind == "palette" else "L")
    palette = [0, 0, 0, 128, 0, 0, 0, 128, 0] + [9, 9, 9] * 253
    if kind == "palette":
        picture.putpalette(palette)
        picture.save(path)
    else:
        picture = image.fromarray(labels, "P")
        picture.putpalette(palette[:12])
        picture.save(path, bits=int(kind[0]))
    return str(path)


@pytest.mark.parametrize(
    "kind", ["grey", "16 bits", "colours", "grey in colour", "palette", "2 bits", "4 bits"]
)
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_masks_of_every_kind(tmp_path: Path, kind: str) -> None:
    (found,) = read_annotations([stored(kind, tmp_path / "mask.png")]).frames
    np.testing.assert_array_equal(found.mask, mask())


def test_masks_as_arrays(tmp_path: Path) -> None:
    np.save(tmp_path / "labels.npy", mask().astype(np.int32))
    np.save(tmp_path / "objects.npy", np.stack([mask() == 1, mask() == 2]))
    for name in ("labels", "objects"):
        (found,) = read_annotations([str(tmp_path / f"{name}.npy")]).frames
        np.testing.assert_array_equal(found.mask, mask())


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.zeros((2, 3, 4)), r"an array 2x3x4 of float64; expected labels \[height, width\]"),
        (np.zeros((3, 4, 3), np.uint8), "an array 3x4x3 of uint8"),
        (np.full((3, 4), -1), "an array 3x4 of int64"),
        (np.full((3, 4), 10**6), "found 1000000; expected labels up to 65535"),
        (np.zeros((0, 4), np.uint8), "an array 0x4 of uint8"),
        (np.zeros((0, 3, 4), bool), "an array 0x3x4 of bool"),
        (np.array([[{}]]), "not a readable numpy file"),
    ],
)
def test_arrays_that_are_no_masks(tmp_path: Path, array: np.ndarray, words: str) -> None:
    np.save(tmp_path / "m.npy", array)
    with pytest.raises(DataError, match=words):
        read_annotations([str(tmp_path / "m.npy")])


@pytest.mark.parametrize("depth", [1, 8, 16])
def test_black_and_white_is_one_object(tmp_path: Path, depth: int) -> None:
    object_ = mask() == 1
    if depth == 1:
        image = pytest.importorskip("PIL.Image")
        image.fromarray(object_).save(tmp_path / "m.png")
    else:
        white = np.iinfo(f"uint{depth}").max
        save(tmp_path / "m.png", (object_ * white).astype(f"uint{depth}"))
    found = read_annotations([str(tmp_path / "m.png")])
    np.testing.assert_array_equal(found.frames[0].mask, object_)
    assert "is object 1" in found.notes[0]


def test_ignored_pixels_stay_where_there_are_objects(tmp_path: Path) -> None:
    labels = mask()
    labels[:3] = 255
    paths = [
        save(tmp_path / "1.png", labels),
        save(tmp_path / "2.png", np.where(labels > 2, 255, 0)),
    ]
    found = read_annotations(paths)
    assert found.notes == ()
    assert set(np.unique(found.frames[1].mask)) == {0, 255}


def frame(path: str, index: int | None = None) -> Frame:
    return Frame(path, W, H, "", index)


FRAMES = {
    "names": [frame(f"bear/{i:05d}.jpg") for i in range(3)],
    "numbers": [frame(f"frame-{i}.png") for i in (4, 5, 6)],
    "video": [frame("clip.mp4", i) for i in range(3)],
}


@pytest.mark.parametrize(
    ("masks", "frames", "places"),
    [
        (["00001.png", "00002.png"], "names", [1, 2]),
        (["mask-6.png", "mask-4.png"], "numbers", [2, 0]),
        (["frame-5.png"], "numbers", [1]),
        (["00002.png"], "video", [2]),
        (["a.png", "b.png", "c.png"], "numbers", [0, 1, 2]),
        (["1.png", "2.png", "3.png"], "video", [0, 1, 2]),
        (["scene7.png"], "numbers", [0]),
    ],
)
def test_masks_find_their_frame(
    tmp_path: Path, masks: list[str], frames: str, places: list[int]
) -> None:
    paths = [save(tmp_path / name, mask()) for name in masks]
    found, _ = frames_of(read_annotations(paths).frames, FRAMES[frames], paths)
    assert {Path(own.name).name: place for place, own in found.items()} == dict(
        zip(masks, places, strict=True)
    )


def test_a_folder_as_in_davis(tmp_path: Path) -> None:
    folder = tmp_path / "Annotations" / "bear"
    folder.mkdir(parents=True)
    for i in range(6):
        save(folder / f"{i:05d}.png", mask())
    tracks = Tracks(np.full((1, 3, 2), [8.0, 8.0]))
    truth = read_truth([str(folder)], tracks, FRAMES["names"], 3.0)
    assert sorted(truth.masks) == [0, 1, 2]
    assert truth.labels.tolist() == [1]
    assert "3 of 6 masks belong to no frame (no frame has this name)" in truth.notes
    with pytest.raises(DataError, match=r"no masks in this folder; name one of its .*\(bear\)"):
        read_annotations([str(folder.parent)])


def test_masks_of_another_size(tmp_path: Path) -> None:
    half = save(tmp_path / "half.png", mask()[::2, ::2])
    (found,) = read_annotations([half]).frames
    large, was_scaled = scaled(found, FRAMES["video"][0])
    assert was_scaled
    assert (large != mask()).mean() < 0.1
    assert set(np.unique(large)) == {0, 1, 2}
    save(tmp_path / "other.png", mask()[:10])
    (found,) = read_annotations([str(tmp_path / "other.png")]).frames
    with pytest.raises(DataError, match="the mask is 40x10; expected 40x30"):
        scaled(found, FRAMES["video"][0])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.json", "{", "not JSON"),
        ("a.json", "{}", "no labels in this file; expected labelme JSON, COCO JSON, CVAT XML"),
        ("a.json", labelme([]), "no shapes in these labels"),
        ("a.json", labelme([{"label": "a", "points": [[0, 1e9], [1, 2], [2, 3]]}]), "leaves every"),
        ("a.json", '{"images": [{}], "annotations": []}', "damaged COCO labels"),
        ("a.json", coco("runs").replace('"counts": [', '"counts": [1, '), "run-length"),
        ("a.xml", "<annotations>", "not XML"),
        ("a.xml", "<!DOCTYPE a><annotations/>", "DOCTYPE"),
        ("a.xml", CVAT_IMAGES.replace('width="40"', 'width="x"'), "damaged CVAT labels"),
        ("a.png", "text", "cut short or damaged"),
        ("a.svg", "<svg/>", "not a mask image"),
    ],
)
def test_what_holds_no_labels_is_said(tmp_path: Path, name: str, content: str, words: str) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DataError, match=words) as caught:
        read_annotations([str(path)])
    assert "\n" not in str(caught.value)


# --- further tools --------------------------------------------------------------------------------


def via(picture: str = "frame-1.png") -> dict[str, object]:
    regions = [
        {
            "shape_attributes": {
                "name": "polygon",
                "all_points_x": [x for x, _ in OUTLINES[1]],
                "all_points_y": [y for _, y in OUTLINES[1]],
            },
            "region_attributes": {"type": "car"},
        },
        {
            "shape_attributes": {"name": "rect", "x": 22, "y": 12, "width": 14, "height": 14},
            "region_attributes": {"type": {"bus": True}},
        },
    ]
    return {f"{picture}123": {"filename": picture, "size": 123, "regions": regions}}


def via_csv() -> str:
    (entry,) = via().values()
    assert isinstance(entry, dict)
    text = "filename,file_size,file_attributes,region_count,region_id,region_shape_attributes,"
    text += "region_attributes\n"
    for i, region in enumerate(entry["regions"]):
        cells = [json.dumps(region[name]) for name in ("shape_attributes", "region_attributes")]
        quoted = ",".join('"' + cell.replace('"', '""') + '"' for cell in cells)
        text += f'frame-1.png,123,"{{}}",2,{i},{quoted}\n'
    return text


def yolo(kind: str) -> str:
    lines = []
    for label, outline in OUTLINES.items():
        points = np.array(outline) / [W, H]
        low, high = points.min(axis=0), points.max(axis=0)
        values = points if kind == "polygons" else np.concatenate([(low + high) / 2, high - low])
        lines.append(f"{label} " + " ".join(f"{value:.6f}" for value in values.ravel()))
    return "\n".join(lines) + "\n"


def mots() -> str:
    coder = pytest.importorskip("pycocotools.mask")
    lines = []
    for label in OUTLINES:
        code = coder.encode(np.asfortranarray(mask() == label))
        lines.append(f"0 {1000 + label} 1 {H} {W} {code['counts'].decode()}")
    return "\n".join(lines) + "\n"


def labelme_mask() -> str:
    shapes = []
    for label in OUTLINES:
        binary = (mask() == label).astype(np.uint8) * 255
        rows, columns = np.nonzero(binary)
        top, left, bottom, right = rows.min(), columns.min(), rows.max(), columns.max()
        encoded = cv2.imencode(".png", binary[top : bottom + 1, left : right + 1])[1].tobytes()
        shapes.append(
            {
                "label": str(label),
                "shape_type": "mask",
                "points": [[int(left), int(top)], [int(right), int(bottom)]],
                "mask": base64.b64encode(encoded).decode(),
            }
        )
    return labelme(shapes)


VOC = (
    f"<annotation><filename>frame-1.png</filename><size><width>{W}</width><height>{H}</height>"
    "</size>"
    + "".join(
        f"<object><name>{label}</name><bndbox><xmin>{o[0][0]}</xmin><ymin>{o[0][1]}</ymin>"
        f"<xmax>{o[2][0]}</xmax><ymax>{o[2][1]}</ymax></bndbox></object>"
        for label, o in OUTLINES.items()
    )
    + "</annotation>"
)
# a square that is turned by a right angle is the same square
CVAT_TURNED = CVAT_IMAGES.replace('ybr="15"', 'ybr="15" rotation="90"')
TOOLS: dict[str, tuple[str, Callable[[], str]]] = {
    "cvat, turned": ("c.xml", lambda: CVAT_TURNED),
    "via": ("v.json", lambda: json.dumps(via())),
    "via, a project": ("v.json", lambda: json.dumps({"_via_img_metadata": via()})),
    "via, csv": ("v.csv", via_csv),
    "yolo": ("frame-1.txt", lambda: yolo("polygons")),
    "yolo, boxes": ("frame-1.txt", lambda: yolo("boxes")),
    "mots": ("0002.txt", mots),
    "labelme, masks": ("l.json", labelme_mask),
    "voc": ("frame-1.xml", lambda: VOC),
}


@pytest.mark.parametrize("kind", TOOLS)
def test_labels_of_further_tools(tmp_path: Path, kind: str) -> None:
    """Also through the labels of tracks: text is not taken for a table of points."""
    name, content = TOOLS[kind]
    (tmp_path / name).write_text(content())
    frames = [Frame("a/frame-1.png", W, H, ""), Frame("a/frame-2.png", W, H, "")]
    found = read_annotations([str(tmp_path / name)], frames).frames
    np.testing.assert_array_equal(found[0].mask, mask())
    assert list(frames_of(found, frames, [])[0]) == [0]
    read_annotations([str(tmp_path / name)])  # before there are frames, for a check
    places = np.array([[8.0, 9.0], [30.0, 20.0], [2.0, 2.0]])
    tracks = Tracks(np.stack([places, places], axis=1))
    truth = read_truth([str(tmp_path / name)], tracks, frames, 3.0)
    assert truth.labels.tolist() == [1, 2, 0]


def test_an_ellipse_of_cvat(tmp_path: Path) -> None:
    (tmp_path / "c.xml").write_text(
        '<annotations><image id="0" name="a" width="40" height="30">'
        '<ellipse label="a" cx="20" cy="15" rx="10" ry="4" rotation="90"/></image></annotations>'
    )
    (found,) = read_annotations([str(tmp_path / "c.xml")]).frames
    y, x = np.mgrid[:30, :40] + 0.5
    inside = ((x - 20) / 4) ** 2 + ((y - 15) / 10) ** 2 < 1
    assert ((found.mask > 0) != inside).mean() < 0.01


def test_a_folder_of_yolo(tmp_path: Path) -> None:
    (tmp_path / "classes.txt").write_text("car\nbus\n")
    (tmp_path / "frame-1.txt").write_text(yolo("polygons"))
    (tmp_path / "frame-2.txt").write_text("")  # nothing in this picture
    frames = [Frame("a/frame-1.png", W, H, ""), Frame("a/frame-2.png", W, H, "")]
    found = read_annotations([str(tmp_path)], frames)
    assert [Path(own.name).name for own in found.frames] == ["frame-1.txt"]
    np.testing.assert_array_equal(found.frames[0].mask, mask())


def test_masks_of_several_frames_in_one_array(tmp_path: Path) -> None:
    stack = np.stack([mask(), mask()[::-1]])
    np.save(tmp_path / "a.npy", stack)
    np.savez(tmp_path / "b.npz", masks=stack[:, None], scores=np.ones(2))
    for name in ("a.npy", "b.npz"):
        found = read_annotations([str(tmp_path / name)]).frames
        assert [own.number for own in found] == [0, 1]
        np.testing.assert_array_equal(found[1].mask, stack[1])
    np.savez(tmp_path / "c.npz", one=stack, two=stack)
    with pytest.raises(DataError, match=r"several arrays .one, two.; expected one"):
        read_annotations([str(tmp_path / "c.npz")])


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("v.json", json.dumps(via()).replace("all_points_y", "y"), "a damaged polygon"),
        ("v.csv", "filename,region_shape_attributes,region_attributes\na,{,\n", "labels of VIA"),
        ("y.txt", "0 0.1 0.2 0.3 0.4 0.5 0.6 0.7\n", "line 1: 7 numbers after the class"),
        ("m.txt", f"1 1 1 {H} {W} WSV:2\nx\n", "line 1: a damaged run-length code"),
        ("v.xml", "<annotation><object><name>a</name></object></annotation>", "labels of VOC"),
        ("l.json", labelme([{"label": "a", "shape_type": "mask", "points": [[0, 0]]}]), "mask"),
        ("t.txt", "hello\n", "no labels in this file|found columns"),
    ],
)
def test_damaged_labels_of_further_tools(
    tmp_path: Path, name: str, content: str, words: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DataError, match=words) as caught:
        read_annotations([str(tmp_path / name)])
    assert "\n" not in str(caught.value)
