"""Whole files of every kind, which ``benchmarks.fuzz`` damages and the tests of bad inputs use."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from benchmarks.fuzz_tracks import write_track_files
from mssegment.cli import invoke


def whole_files(folder: Path) -> None:
    """Write whole files of every kind into a folder, by the program itself where it can."""
    rng = np.random.default_rng(0)
    first = rng.uniform(20, 180, (60, 2))
    second = np.where(np.arange(60)[:, None] < 30, first + 6, 1.04 * first - 9)
    _write_tables(folder, first, second)
    _write_pictures(folder, rng)
    _write_labels(folder)
    _write_cameras(folder)
    for arguments in (
        ["import", "m.csv", "-o", "tracks.json"],
        ["import", "s.csv", "-o", "long.json"],
        ["detect", "1.png", "2.png", "-o", "corners.json"],
        ["hypothesize", "tracks.json", "--model", "affine", "-o", "hypotheses.json"],
        ["hypothesize", "long.json", "-o", "long-hypotheses.json"],
        ["cluster", "hypotheses.json", "-o", "segmentation.json"],
        ["cluster", "long-hypotheses.json", "-o", "long-segmentation.json"],
    ):
        if invoke([*arguments, "--quiet"]):
            raise RuntimeError(f"{arguments}: failed on a whole file")


def _write_tables(folder: Path, first: Any, second: Any) -> None:
    rows = np.column_stack([first, second, np.arange(60) // 30 + 1])
    np.savetxt(folder / "m.csv", rows, "%.6g", ",", header="x1,y1,x2,y2,label", comments="")
    tracks = np.stack([first + t * (second - first) for t in np.arange(5)], axis=1)
    lines = [f"{p},{f},{x},{y}" for p, one in enumerate(tracks) for f, (x, y) in enumerate(one)]
    (folder / "s.csv").write_text("\n".join(["track,frame,x,y", *lines]))
    np.save(folder / "t.npy", tracks)
    np.savez_compressed(folder / "t.npz", tracks=tracks, visible=np.ones((60, 5)))
    (folder / "t.json").write_text(json.dumps({"tracks": tracks.tolist()}))
    listed = [
        {"id": i, "frames": list(range(5)), "points": o.tolist()} for i, o in enumerate(tracks)
    ]
    (folder / "l.json").write_text(json.dumps({"tracks": listed}))
    head = ["time", *(f"p{p} {axis}" for p in range(60) for axis in "xy")]
    times = [[f, *tracks[:, f].ravel()] for f in range(5)]
    (folder / "r.csv").write_text("\n".join(";".join(map(str, row)) for row in [head, *times]))
    write_track_files(folder, tracks)
    np.savez(folder / "w.npz", W=tracks.transpose(1, 2, 0).reshape(10, 60))
    np.savez(folder / "k.npz", kptsA=first, kptsB=second.T)
    from scipy.io import savemat  # slow to import

    savemat(folder / "t.mat", {"tracks": tracks, "s": {"a": "text"}}, do_compression=True)
    savemat(folder / "u.mat", {"data": np.vstack([first.T, np.ones(60), second.T, np.ones(60)])})
    (folder / "t.xml").write_text(
        "<Tracks>"
        + "".join(
            "<particle>"
            + "".join(f'<detection t="{f}" x="{x}" y="{y}"/>' for f, (x, y) in enumerate(one))
            + "</particle>"
            for one in tracks[:5]
        )
        + "</Tracks>"
    )
    (folder / "poses.txt").write_text(
        "\n".join(f"{i} {i % 3} 0 0 0 0 0 1" for i in range(20))  # time, place, quaternion
    )


def _write_pictures(folder: Path, rng: np.random.Generator) -> None:
    big = cv2.GaussianBlur(rng.integers(0, 255, (80, 100), dtype=np.uint8), (0, 0), 1.5)
    big = cv2.normalize(big, None, 0, 255, cv2.NORM_MINMAX)
    views = [big[5:69, 5 + s : 85 + s] for s in (0, 3, 5)]
    for name in ("png", "jpg", "bmp", "tif", "webp", "pgm"):
        cv2.imwrite(str(folder / f"1.{name}"), views[0])
    cv2.imwrite(str(folder / "2.png"), views[1])
    coloured = [cv2.cvtColor(view, cv2.COLOR_GRAY2BGR) for view in views]
    cv2.imwritemulti(str(folder / "stack.tif"), views)
    if hasattr(cv2, "imwriteanimation"):
        animation = cv2.Animation()
        animation.frames = [cv2.cvtColor(view, cv2.COLOR_BGR2BGRA) for view in coloured]
        animation.durations = [100] * len(views)
        for name in ("a.gif", "a.webp", "a.apng"):
            cv2.imwriteanimation(str(folder / name), animation)
    for name, codec in (("v.avi", "MJPG"), ("v.mp4", "mp4v")):
        out = cv2.VideoWriter(str(folder / name), cv2.VideoWriter_fourcc(*codec), 10, (80, 64))
        for view in coloured:
            out.write(view)
        out.release()


def _write_labels(folder: Path) -> None:
    mask = np.zeros((200, 200), np.uint8)
    mask[:100], mask[100:] = 1, 2
    cv2.imwrite(str(folder / "mask-1.png"), mask)
    np.save(folder / "mask.npy", mask)
    square = [[10, 10], [150, 10], [150, 150], [10, 150]]
    shapes = [{"label": "a", "points": square, "shape_type": "polygon", "group_id": None}]
    labelme = {"shapes": shapes, "imagePath": "m-0.png", "imageWidth": 200, "imageHeight": 200}
    (folder / "labelme.json").write_text(json.dumps(labelme))
    outline = [side for corner in square for side in corner]
    runs = {"size": [200, 200], "counts": [100, 20_000, 19_900]}
    coco = {
        "images": [{"id": 1, "file_name": "m-0.png", "width": 200, "height": 200}],
        "annotations": [
            {"id": 1, "image_id": 1, "category_id": 1, "segmentation": [outline]},
            {"id": 2, "image_id": 1, "category_id": 1, "segmentation": runs},
        ],
        "categories": [{"id": 1, "name": "car"}],
    }
    (folder / "coco.json").write_text(json.dumps(coco))
    points = ";".join(f"{x},{y}" for x, y in square)
    (folder / "cvat.xml").write_text(
        '<annotations><image id="0" name="m-0.png" width="200" height="200">'
        f'<polygon label="a" points="{points}" z_order="0"/>'
        '<mask label="b" left="0" top="0" width="2" height="2" rle="1,3"/></image></annotations>'
    )
    region = {"name": "polygon", "all_points_x": [9, 99, 99], "all_points_y": [9, 9, 99]}
    regions = [{"shape_attributes": region, "region_attributes": {"type": "car"}}]
    via = {"a": {"filename": "m-0.png", "size": 1, "regions": regions}}
    (folder / "via.json").write_text(json.dumps(via))
    (folder / "yolo.txt").write_text("0 0.1 0.1 0.7 0.1 0.7 0.7\n1 0.5 0.5 0.2 0.2\n")
    (folder / "mots.txt").write_text("0 1001 1 200 200 T3jT1Lb2\n")
    box = "<bndbox><xmin>9</xmin><ymin>9</ymin><xmax>99</xmax><ymax>99</ymax></bndbox>"
    (folder / "voc.xml").write_text(
        f"<annotation><filename>m-0.png</filename><object><name>a</name>{box}</object></annotation>"
    )
    np.savez(folder / "masks.npz", masks=np.stack([mask, mask]))
    (folder / "points.csv").write_text("x,y,label\n" + "\n".join(f"{i},{i},1" for i in range(9)))


def _write_cameras(folder: Path) -> None:
    own = {"fx": 200, "fy": 200, "cx": 100, "cy": 100, "distortion": [0.1, 0, 0, 0]}
    (folder / "camera.yaml").write_text(yaml.safe_dump(own))
    (folder / "camera.ini").write_text("[left]\nfx = 200\nfy = 200\ncx = 100\ncy = 100\nk1 = 0.1\n")
    (folder / "vins.yaml").write_text(
        "%YAML:1.0\nmodel_type: KANNALA_BRANDT\nimage_width: 200\nimage_height: 200\n"
        "projection_parameters:\n   k2: 0.1\n   mu: 200\n   mv: 200\n   u0: 100\n   v0: 100\n"
    )
    (folder / "camera.json").write_text(json.dumps({"K": [200, 0, 100, 0, 200, 100, 0, 0, 1]}))
    matrix = "<K type_id='opencv-matrix'><rows>3</rows><cols>3</cols><dt>d</dt>"
    data = "<data>200 0 100 0 200 100 0 0 1</data></K>"
    (folder / "camera.xml").write_text(
        f"<opencv_storage><camera_matrix>{matrix}{data}</camera_matrix></opencv_storage>"
    )
    np.savez(folder / "camera.npz", K=np.array([[200.0, 0, 100], [0, 200, 100], [0, 0, 1]]))
    (folder / "cameras.txt").write_text("1 PINHOLE 200 200 200 200 100 100\n")
    _write_rigs(folder)
    (folder / "config.yaml").write_text(
        "seed: 1\ninput:\n  tracks: m.csv\nhypothesize: {model: affine}\nsegment:\n  motions: 2\n"
        "report: {pictures: no, html: no}\n"
    )


def _write_rigs(folder: Path) -> None:
    own = {"fx": 200, "fy": 200, "cx": 100, "cy": 100}
    size = {"width": 200, "height": 200}
    listed = [{"camera_type": "kb4", "intrinsics": own | {"k1": 0.1}}]
    basalt = {"value0": {"intrinsics": listed, "resolution": [[200, 200]]}}
    (folder / "basalt.json").write_text(json.dumps(basalt))
    data = size | {"focal_length": 200, "principal_point": [100, 100], "disto_k3": [0.1, 0, 0]}
    value = {
        "polymorphic_id": 2147483649,
        "polymorphic_name": "pinhole_radial_k3",
        "ptr_wrapper": {"data": data},
    }
    openmvg = {"sfm_data_version": "0.3", "intrinsics": [{"key": 0, "value": value}]}
    (folder / "openmvg.json").write_text(json.dumps(openmvg))
    entry = size | {"intrinsicId": "1", "type": "radial3", "focalLength": "36"}
    entry |= {"principalPoint": ["1", "1"], "distortionParams": ["0.1", "0", "0"]}
    meshroom = {"version": ["1", "2", "6"], "intrinsics": [entry]}
    (folder / "meshroom.json").write_text(json.dumps(meshroom))
    (folder / "metashape.xml").write_text(
        "<calibration><projection>frame</projection><width>200</width><height>200</height>"
        "<f>200</f><cx>1</cx><cy>1</cy><b1>1</b1><k1>0.1</k1></calibration>"
    )
    (folder / "ost.txt").write_text(
        "camera matrix\n200 0 100\n0 200 100\n0 0 1\n\ndistortion\n0.1 0\n"
    )
    (folder / "okvis.yaml").write_text(
        "cameras:\n- {image_dimension: [200, 200], focal_length: [200, 200], "
        "principal_point: [100, 100]}\n"
    )
    (folder / "cameras.bin").write_bytes(
        struct.pack("<QiiQQ4d", 1, 1, 1, 200, 200, 200.0, 200.0, 100.0, 100.0)
    )
