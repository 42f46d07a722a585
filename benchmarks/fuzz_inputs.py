"""Inputs for ``benchmarks.fuzz``: strategies that damage whole files (``fuzz_files``).

A strategy of ``KINDS`` gives the files to write and the command to run on them, in the folder
where the whole ones are.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml
from hypothesis import strategies as st

from benchmarks.fuzz_tracks import LAYOUTS, TREES, WHOLE
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
    return _on(
        _mutations(folder, ["m.csv", "s.csv", "r.csv", "t.xml"]), lambda name: ["import", name]
    )


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
        _on(
            _mutations(folder, ["t.npy", "t.npz", "w.npz", "k.npz"]), lambda name: ["import", name]
        ),
        _on(_mutations(folder, ["t.json", "l.json"], is_json=True), lambda name: ["import", name]),
        _headers(),
    )


def _layouts(folder: Path) -> st.SearchStrategy[Case]:
    """Tracks as other programs lay them out. Some are known by their name."""

    def case(pair: tuple[str, bytes]) -> Case:
        name = pair[0].removeprefix(WHOLE)
        return {name: pair[1]}, ["import", name]

    trees = _mutations(folder, [WHOLE + name for name in TREES], is_json=True)
    return st.one_of(_mutations(folder, [WHOLE + name for name in LAYOUTS]), trees).map(case)


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

    texts = ["camera.yaml", "camera.xml", "camera.npz", "cameras.txt", "camera.ini", "vins.yaml"]
    texts += ["cameras.bin", "metashape.xml", "ost.txt", "okvis.yaml"]
    trees = ["camera.json", "basalt.json", "openmvg.json", "meshroom.json"]
    return st.one_of(
        _on(_mutations(folder, texts), command),
        _on(_mutations(folder, trees, is_json=True), command),
    )


def _labels(folder: Path) -> st.SearchStrategy[Case]:
    def command(name: str) -> list[str]:
        return ["report", "segmentation.json", "--format", "json", "--labels", name]

    return st.one_of(
        _on(_mutations(folder, ["labelme.json", "coco.json", "via.json"], is_json=True), command),
        _on(_mutations(folder, ["mask-1.png", "mask.npy", "masks.npz", "points.csv"]), command),
        _on(_mutations(folder, ["cvat.xml", "voc.xml", "yolo.txt", "mots.txt"]), command),
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
    "layouts": _layouts,
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
