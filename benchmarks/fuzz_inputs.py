"""Inputs for ``benchmarks.fuzz``: whole files of every kind, and strategies that damage them.

``whole_files`` writes valid ones into a folder. A strategy of ``KINDS`` gives the files to write
and the command to run on them, in the folder where the whole ones are.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from hypothesis import strategies as st

from mssegment.cli import invoke
from mssegment.configuration import KEYS

Case = tuple[dict[str, bytes], list[str]]
"""Files by name, and the arguments of the command line."""

NUMBERS = st.one_of(
    st.sampled_from([0, -1, 1, 2, 255, 2**31, 2**53 + 1, 2**63, 10**30, -(2**63), 10**400]),
    st.sampled_from([0.5, -0.0, 1e-320, 1e-12, 1e6, 1e12, 1e154, 1e299, -1e299, 1.7e308]),
    st.floats(allow_nan=False, allow_infinity=False),
    st.integers(-1000, 1000),
)
TEXTS = st.one_of(
    st.sampled_from(["", "-", "\0", "=1+1", "\x1b[31m", "a" * 20_000, "../..", "/dev/zero", "nan"]),
    st.text(max_size=12),
)
VALUES: st.SearchStrategy[Any] = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, TEXTS),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXTS, inner, max_size=3),
    max_leaves=6,
)


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
    (folder / "points.csv").write_text("x,y,label\n" + "\n".join(f"{i},{i},1" for i in range(9)))


def _write_cameras(folder: Path) -> None:
    own = {"fx": 200, "fy": 200, "cx": 100, "cy": 100, "distortion": [0.1, 0, 0, 0]}
    (folder / "camera.yaml").write_text(yaml.safe_dump(own))
    (folder / "camera.json").write_text(json.dumps({"K": [200, 0, 100, 0, 200, 100, 0, 0, 1]}))
    matrix = "<K type_id='opencv-matrix'><rows>3</rows><cols>3</cols><dt>d</dt>"
    data = "<data>200 0 100 0 200 100 0 0 1</data></K>"
    (folder / "camera.xml").write_text(
        f"<opencv_storage><camera_matrix>{matrix}{data}</camera_matrix></opencv_storage>"
    )
    np.savez(folder / "camera.npz", K=np.array([[200.0, 0, 100], [0, 200, 100], [0, 0, 1]]))
    (folder / "cameras.txt").write_text("1 PINHOLE 200 200 200 200 100 100\n")
    (folder / "config.yaml").write_text(
        "seed: 1\ninput:\n  tracks: m.csv\nhypothesize: {model: affine}\nsegment:\n  motions: 2\n"
        "report: {pictures: no, html: no}\n"
    )


_WORDS = [b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\1"]


@st.composite
def damaged(draw: st.DrawFn, content: bytes) -> bytes:
    """Bytes with a few changes: single ones, numbers, blocks left out, doubled or cut."""
    out = bytearray(content)
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(len(out) - 1, 0)))
        kind = draw(st.integers(0, 6))
        if kind == 0:
            out[place : place + 1] = draw(st.binary(min_size=1, max_size=1))
        elif kind == 1:
            out[place : place + 4] = draw(
                st.sampled_from(
                    [b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"\0\0\0\1"]
                )
            )
        elif kind == 2:
            del out[place : place + draw(st.integers(1, 64))]
        elif kind == 3:
            out[place:place] = out[place : place + draw(st.integers(1, 64))]
        elif kind == 4:
            del out[place:]
        elif kind == 5:
            out[place:place] = draw(st.binary(max_size=16))
        elif out:
            out[place % min(len(out), 200)] ^= 1 << draw(st.integers(0, 7))  # the header
    return bytes(out)


def _places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths to values of a tree, of long lists the first three and the last."""
    found = [path] if path else []
    if isinstance(tree, dict):
        parts = list(tree.items())
    elif isinstance(tree, list):
        parts = list(enumerate(tree))
        parts = parts if len(parts) < 5 else [*parts[:3], parts[-1]]
    else:
        parts = []
    for key, value in parts:
        found += _places(value, (*path, key))
    return found


@st.composite
def changed(draw: st.DrawFn, content: bytes) -> bytes:
    """JSON with one to three values replaced, removed, doubled or moved."""
    tree = json.loads(content)
    for _ in range(draw(st.integers(1, 3))):
        places = _places(tree)
        if not places:
            break
        path = draw(st.sampled_from(places))
        parent = tree
        for key in path[:-1]:
            parent = parent[key]
        kind = draw(st.integers(0, 4))
        if kind == 0:
            del parent[path[-1]]
        elif kind == 1 and isinstance(parent, list):
            parent.append(parent[path[-1]])
        elif kind == 2 and len(places) > 1:
            other: Any = tree
            for key in draw(st.sampled_from(places)):
                other = other[key]
            parent[path[-1]] = json.loads(json.dumps(other))
        else:
            parent[path[-1]] = draw(VALUES)
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def _mutations(folder: Path, names: list[str], is_json: bool = False) -> st.SearchStrategy[Any]:
    """The name of a file, and its content damaged."""
    contents = {name: (folder / name).read_bytes() for name in names if (folder / name).exists()}
    ways = [st.tuples(st.just(n), damaged(c)) for n, c in contents.items()]
    if is_json:
        ways += 3 * [st.tuples(st.just(n), changed(c)) for n, c in contents.items()]
    return st.one_of(ways)


def _on(mutated: st.SearchStrategy[Any], command: Callable[[str], list[str]]) -> Any:
    def case(pair: tuple[str, bytes]) -> Case:
        name = f"x{Path(pair[0]).suffix}"
        return {name: pair[1]}, command(name)

    return mutated.map(case)


def _documents(folder: Path) -> st.SearchStrategy[Case]:
    commands = {
        "corners.json": lambda name: ["match", name],
        "tracks.json": lambda name: ["hypothesize", name, "--count", "60"],
        "long.json": lambda name: ["hypothesize", name, "--count", "60"],
        "hypotheses.json": lambda name: ["cluster", name],
        "long-hypotheses.json": lambda name: ["cluster", name],
        "segmentation.json": lambda name: ["report", name, "--format", "text"],
        "long-segmentation.json": lambda name: ["report", name, "--format", "csv"],
    }
    return st.one_of(
        [_on(_mutations(folder, [name], is_json=True), way) for name, way in commands.items()]
    )


def _tables(folder: Path) -> st.SearchStrategy[Case]:
    return _on(_mutations(folder, ["m.csv", "s.csv", "t.xml"]), lambda name: ["import", name])


def _cells(folder: Path) -> st.SearchStrategy[Case]:
    """Tables of odd cells, rows and separators."""
    cell = st.one_of(NUMBERS.map(str), TEXTS, st.sampled_from(["nan", "1,5", '"', "inf", "1e5"]))
    rows = st.lists(st.lists(cell, min_size=1, max_size=6), min_size=1, max_size=6)
    head = st.sampled_from([[], ["x1", "y1", "x2", "y2"], ["track", "frame", "x", "y"]])

    def case(parts: Any) -> Case:
        first, body, separator = parts
        lines = [separator.join(row) for row in ([first] if first else []) + body]
        return {"x.csv": "\n".join(lines).encode("utf-8", "replace")}, ["import", "x.csv"]

    return st.tuples(head, rows, st.sampled_from([",", ";", "\t", " ", "|"])).map(case)


def _arrays(folder: Path) -> st.SearchStrategy[Case]:
    return st.one_of(
        _on(_mutations(folder, ["t.npy", "t.npz"]), lambda name: ["import", name]),
        _on(_mutations(folder, ["t.json"], is_json=True), lambda name: ["import", name]),
        _headers(),
    )


def _headers() -> st.SearchStrategy[Case]:
    """Arrays of numpy whose header states anything."""
    shape = st.lists(st.sampled_from([0, 1, 2, 5, 60, 10**6, 10**12, -1]), max_size=4).map(tuple)
    kind = st.sampled_from(["<f8", "|O", "<i8", "|S0", "<U9", "<c16", "|V4", "<M8[ns]", "?", "<f2"])

    def case(parts: Any) -> Case:
        shape, dtype, zipped = parts
        header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}"
        text = header.encode().ljust(117) + b"\n"
        array = b"\x93NUMPY\1\0" + len(text).to_bytes(2, "little") + text + b"\0" * 480
        if not zipped:
            return {"x.npy": array}, ["import", "x.npy"]
        out = io.BytesIO()
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("tracks.npy", array)
        return {"x.npz": out.getvalue()}, ["import", "x.npz"]

    return st.tuples(shape, kind, st.booleans()).map(case)


def _matlab(folder: Path) -> st.SearchStrategy[Case]:
    return _on(_mutations(folder, ["t.mat", "u.mat"]), lambda name: ["import", name])


def _cameras(folder: Path) -> st.SearchStrategy[Case]:
    def command(name: str) -> list[str]:
        return ["hypothesize", "tracks.json", "--count", "20", "--camera", name]

    texts = ["camera.yaml", "camera.xml", "camera.npz", "cameras.txt"]
    return st.one_of(
        _on(_mutations(folder, texts), command),
        _on(_mutations(folder, ["camera.json"], is_json=True), command),
    )


def _labels(folder: Path) -> st.SearchStrategy[Case]:
    def command(name: str) -> list[str]:
        return ["report", "segmentation.json", "--format", "json", "--labels", name]

    return st.one_of(
        _on(_mutations(folder, ["labelme.json", "coco.json"], is_json=True), command),
        _on(_mutations(folder, ["mask-1.png", "cvat.xml", "points.csv"]), command),
    )


def _pictures(folder: Path) -> st.SearchStrategy[Case]:
    names = [f"1.{kind}" for kind in ("png", "jpg", "bmp", "tif", "webp", "pgm")]
    names += ["stack.tif", "a.gif", "a.webp", "a.apng"]
    return _on(_mutations(folder, names), lambda name: ["detect", name, "1.png"])


def _videos(folder: Path) -> st.SearchStrategy[Case]:
    return _on(_mutations(folder, ["v.avi", "v.mp4"]), lambda name: ["detect", name])


def _poses(folder: Path) -> st.SearchStrategy[Case]:
    manifold = st.sampled_from(["se3", "so3", "r3", "sphere(2)", "spd(3)", "r7", "x", "se3(0)"])
    return st.tuples(_mutations(folder, ["poses.txt"]), manifold).map(
        lambda parts: ({"x.txt": parts[0][1]}, ["fuse", "x.txt", "--manifold", parts[1]])
    )


def _configurations(folder: Path) -> st.SearchStrategy[Case]:
    own = _mutations(folder, ["config.yaml"])
    values = st.dictionaries(st.sampled_from(list(KEYS)), VALUES, max_size=3)

    def case(changes: dict[str, Any]) -> Case:
        tree: dict[str, Any] = yaml.safe_load((folder / "config.yaml").read_text())
        for key, value in changes.items():
            section, _, name = key.rpartition(".")
            (tree.setdefault(section, {}) if section else tree)[name] = value
        return {"x.yaml": json.dumps(tree).encode()}, ["run", "x.yaml", "--out", "o", "--force"]

    return st.one_of(
        own.map(lambda pair: ({"x.yaml": pair[1]}, ["run", "x.yaml", "--out", "o", "--force"])),
        values.map(case),
    )


def _settings(folder: Path) -> st.SearchStrategy[Case]:
    """Random combinations of valid settings on a pair and on a sequence."""
    quiet = ["report.pictures=no", "report.html=no"]
    left_out = ("input.", "report.", "limits.", "camera.file")
    free = [key for key in KEYS if not key.startswith(left_out)]
    chosen = st.lists(st.sampled_from(free), max_size=6, unique=True)
    pairs = chosen.flatmap(lambda keys: st.tuples(*(_assignment(key) for key in keys)))

    def case(parts: tuple[str, tuple[str, ...]]) -> Case:
        name, assignments = parts
        given = [word for text in (*quiet, *assignments) for word in ("--set", text)]
        return {}, ["run", name, "--out", "o", "--force", *given]

    return st.tuples(st.sampled_from(["m.csv", "s.csv"]), pairs).map(case)


def _assignment(key: str) -> st.SearchStrategy[str]:
    """A valid value of a setting, mostly."""
    choices = KEYS[key].choices.removesuffix("...").split("|")
    ways: list[st.SearchStrategy[Any]] = []
    for choice in choices:
        if choice == "INTEGER":
            ways.append(st.sampled_from([0, 1, 2, 3, 4, 5, 8, 30, 500]))
        elif choice == "NUMBER":
            ways.append(st.sampled_from([1e-9, 0.01, 0.5, 1, 2.5, 100, 1e9]))
        elif choice == "TEXT":
            ways.append(st.just("m.csv"))
        else:
            ways.append(st.just(choice))
    return st.one_of(ways).map(lambda value: f"{key}={value}")


KINDS: dict[str, Callable[[Path], st.SearchStrategy[Case]]] = {
    "documents": _documents,
    "tables": _tables,
    "cells": _cells,
    "arrays": _arrays,
    "matlab": _matlab,
    "cameras": _cameras,
    "labels": _labels,
    "pictures": _pictures,
    "videos": _videos,
    "poses": _poses,
    "configurations": _configurations,
    "settings": _settings,
}
"""What is fuzzed: a strategy of files and commands, given the folder of whole files."""
