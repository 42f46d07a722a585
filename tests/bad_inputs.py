"""The table of bad inputs: what is written, the command, and what its error must name.

Whole files of every kind are in the folder where the commands run (``benchmarks.fuzz_files``).
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mssegment.configuration import KEYS
from tests.bad_documents import Bad, changed, documents, nothing, written


def files() -> Iterator[Bad]:
    """Every place where a file is named, with everything that is no such file."""
    places: dict[str, list[str]] = {
        "match": ["match", "{}"],
        "hypothesize": ["hypothesize", "{}"],
        "cluster": ["cluster", "{}"],
        "report": ["report", "{}"],
        "compare": ["compare", "segmentation.json", "{}"],
        "import": ["import", "{}"],
        "detect": ["detect", "1.png", "{}"],
        "fuse": ["fuse", "{}", "--manifold", "se3"],
        "labels": ["report", "segmentation.json", "--labels", "{}"],
        "camera": ["hypothesize", "tracks.json", "--camera", "{}"],
        "tracks": ["run", "m.csv", "--set", "input.tracks={}"],
        "config": ["run", "{}.yaml"],
    }
    for place, command in places.items():
        suffix = ".yaml" if place == "config" else ""

        def given(name: str, command: list[str] = command) -> list[str]:
            return [word.replace("{}", name) for word in command]

        yield Bad(f"{place}-absent", nothing, given("absent"), ("absent",))
        yield Bad(f"{place}-empty", written(f"bad{suffix}", ""), given("bad"), ("bad",))
        yield Bad(
            f"{place}-folder", lambda s=suffix: Path(f"bad{s}").mkdir(), given("bad"), ("bad",)
        )
        yield Bad(
            f"{place}-device",
            lambda s=suffix: os.symlink("/dev/zero", f"bad{s}"),
            given("bad"),
            ("bad",),
        )
        yield Bad(
            f"{place}-pipe", lambda s=suffix: os.mkfifo(f"bad{s}"), given("bad"), ("bad", "pipe")
        )
        yield Bad(f"{place}-long-name", nothing, given("n" * 400), ("nnn",))
        noise = np.random.default_rng(0).bytes(3000)
        yield Bad(f"{place}-noise", written(f"bad{suffix}", noise), given("bad"), ("bad",))


def settings() -> Iterator[Bad]:
    """Every setting with a value of another kind, and numbers beyond its range."""
    run = ["run", "m.csv", "--out", "o", "--set"]
    for key, own in KEYS.items():
        value = "{a: 1}" if "TEXT" in own.choices else "[[x]]"
        yield Bad(f"set-{key}", nothing, [*run, f"{key}={value}"], (key, "expected"), (3,))
    wild = ["-1", "1e299", "99999999999999999999", "nan", ".inf", "1.5"]
    for key in (
        "cluster.bandwidth",
        "segment.motions",
        "seed",
        "hypothesize.count",
        "segment.min_motions",
        "detect.max_corners",
        "input.stop",
        "match.min_length",
        "hypothesize.rank",
        "limits.file_bytes",
        "report.label_radius",
    ):
        for value in wild:
            is_any = key in ("cluster.bandwidth", "report.label_radius")
            if is_any and value[0] in "19":
                continue
            yield Bad(f"set-{key}={value}", nothing, [*run, f"{key}={value}"], (key,), (3,))
    for text in (
        "seed",
        "=1",
        "unknown.key=1",
        "seed=[",
        "seed=*a",
        "seed=&a [*a]",
        "report.labels=" + "[" * 3000,
        "seed=!!timestamp x",
        "seed=!!float x",
        "seed={[1]: 2}",
        "seed=" + "9" * 6000,
        "seed=\x1b[31m",
        "camera.fx=0",
    ):
        yield Bad(f"set {text[:30]!r}", nothing, [*run, text], ("--set",), (3,))


def tables() -> Iterator[Bad]:
    bodies = {
        "one-line": "x1,y1,x2,y2",
        "text": "x1,y1,x2,y2\na,b,c,d",
        "ragged": "x1,y1,x2,y2\n1,2,3",
        "infinite": "x1,y1,x2,y2\n1,2,inf,4\n1,2,3,5",
        "far": "x1,y1,x2,y2\n1,2,1e7,4\n1,2,3,5",
        "twice": "track,frame,x,y\n1,0,1,1\n1,0,2,2",
        "unit": "x1,y1,x2,y2\n0,.2,.3,.4\n.1,.5,1,0",
        "label": "x1,y1,x2,y2,label\n1,2,3,4,1.5\n5,6,7,8,1",
        "same": "x,x,y,y\n1,2,3,4",
        "big-label": "x1,y1,x2,y2,label\n1,2,3,4,1e9\n5,6,7,8,1",
        "other": "a,b\n1,2\n3,4",
        "one-frame": "track,frame,x,y\n1,0,1,1\n2,0,2,2",
        "long": "x1,y1,x2,y2\n" + "1" * 200_000,
        "nul": "x1,y1,x2,y2\n1,2,3,4\0",
        "quote": 'x1,y1,x2,y2\n"1,2,3,4',
        "html": "<html></html>",
        "doctype": "<!DOCTYPE x [<!ENTITY a 'b'>]><x>&a;</x>",
        "xml": "<a>",
        "json": "[1, 2",
        "json-deep": "[" * 10**5,
        "json-big": '{"tracks": [[[1' + "0" * 400 + ", 1], [1, 1]]]}",
        "json-text": '{"tracks": "no"}',
        "json-number": "5",
        "pickle": "\udc80\x04\udc95",
        "parquet": "PAR1",
        "sqlite": "SQLite format 3\0",
        "zip": "PK\3\4",
        "hdf": "\udc89HDF\r\n\x1a\n",
        "mat73": "MATLAB 7.3",
        "npy": "\udc93NUMPY\1\0",
        "png": "\udc89PNG\r\n\x1a\n",
    }
    for name, body in bodies.items():
        yield Bad(f"import-{name}", written("bad.csv", body), ["import", "bad.csv"], ("bad.csv",))
    diagonal = "\n".join(["track,frame,x,y", *(f"{i},{i},1,{i % 9}" for i in range(20_000))])
    yield Bad(
        "import-diagonal",
        written("bad.csv", diagonal),
        ["import", "bad.csv"],
        ("bad.csv", "limits.positions"),
    )

    def bomb(kind: str) -> Callable[[], None]:
        def make() -> None:
            if kind == "mat":
                packed = zlib.compress(bytes(600_000_000), 1)
                head = b"MATLAB 5.0".ljust(124) + struct.pack("<H2s", 256, b"IM")
                Path("bad.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
                return
            header = "{'descr': '<f8', 'fortran_order': False, 'shape': (900000000, 2, 2), }"
            text = header.encode().ljust(117) + b"\n"
            Path("bad.npy").write_bytes(b"\x93NUMPY\1\0" + struct.pack("<H", len(text)) + text)

        return make

    for kind in ("mat", "npy"):
        yield Bad(
            f"import-bomb-{kind}",
            bomb(kind),
            ["import", f"bad.{kind}"],
            (f"bad.{kind}", "limits.unpacked_bytes"),
        )
    yield Bad(
        "import-cut-mat",
        lambda: Path("bad.mat").write_bytes(Path("t.mat").read_bytes()[:200]) and None,
        ["import", "bad.mat"],
        ("bad.mat",),
    )


def _png(width: int, height: int) -> bytes:
    def chunk(name: bytes, body: bytes) -> bytes:
        return (
            struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
        )

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    pixels = chunk(b"IDAT", zlib.compress(bytes(1000)))
    return b"\x89PNG\r\n\x1a\n" + head + pixels + chunk(b"IEND", b"")


def pictures() -> Iterator[Bad]:
    long_chunk = _png(100, 100).replace(b"\0\0\0", b"\xc0\0\0", 1)
    whole = _png(8, 8)
    place = whole.index(b"IDAT") - 4
    bodies: dict[str, bytes] = {
        "bomb": _png(60_000, 60_000),
        "wide": _png(2**31 - 1, 1),
        "nothing": _png(0, 0),
        "chunk": whole[:place] + b"\xc0\xff\xff\xff" + whole[place + 4 :],
        "cut": whole[:40],
        "long-head": long_chunk,
        "gif": b"GIF89a" + struct.pack("<HH", 65535, 65535) + b"\0\0\0;",
        "bmp": b"BM" + bytes(12) + struct.pack("<Iii", 40, 10**6, 10**6) + bytes(60),
        "pgm": b"P5 99999 99999 255\n" + bytes(99),
        "text": b"no picture",
        "jpg": b"\xff\xd8\xff",
        "tif": b"II*\0\x08\0\0\0\x02\0"
        + struct.pack("<HHII", 256, 4, 1, 10**6)
        + struct.pack("<HHII", 257, 4, 1, 10**6)
        + bytes(4),
        "webp": b"RIFF\0\0\0\0WEBPVP8X\x0a\0\0\0\0\0\0\0" + b"\xff" * 6,
        "m3u8": b"#EXTM3U\n\xff\n",
        "concat": b"ffconcat version 1.0\nfile '/etc/passwd'\n\xfe",
        "sdp": b"v=0\r\no=- 0 0\xff",
        "dash": b"<?xml version='1.0'?><MPD>\xff</MPD>",
        "pls": b"[playlist]\nFile1=x\xff",
        "mp4": b"\0\0\0\x18ftypisom" + bytes(12),
        "avi": b"RIFF\xff\xff\xff\xffAVI LIST" + bytes(90),
        "mkv": b"\x1aE\xdf\xa3" + bytes(60),
        "svg": b"<svg xmlns='http://www.w3.org/2000/svg'/>",
    }
    for name, body in bodies.items():
        yield Bad(
            f"detect-{name}",
            written(f"bad.{name}", body),
            ["detect", f"bad.{name}", "1.png"],
            (f"bad.{name}",),
        )
        if name in ("bomb", "chunk", "cut", "text", "gif", "tif"):
            yield Bad(
                f"labels-{name}",
                written(f"bad.{name}", body),
                ["report", "segmentation.json", "--labels", f"bad.{name}"],
                (f"bad.{name}",),
            )
    yield Bad("detect-url", nothing, ["detect", "http://a/b.png", "1.png"], ("http://a/b.png",))
    yield Bad("detect-stdin", nothing, ["detect", "-"], ("standard input",))
    yield Bad("detect-number", nothing, ["detect", "0"], ("0: ", "camera"))
    yield Bad("detect-one", nothing, ["detect", "1.png"], ("1.png", "at least 2"))
    yield Bad("detect-nul", nothing, ["detect", "a\0b", "1.png"], ("a",))
    for path in ("pipe", "/dev/zero", "1.png\0", "..", "bad\x1b[31m"):

        def make(path: str = path) -> None:
            if path == "pipe":
                os.mkfifo("pipe")
            changed("corners.json", "frames.0.path", path)()

        yield Bad(f"frame-{path!r}", make, ["match", "bad.json"], (path.strip("\0")[:3],))


def cameras() -> Iterator[Bad]:
    bodies = {
        "laughs": "a0: &a0 [x]\n"
        + "\n".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)),
        "alias": "fx: &a [*a]",
        "zero": "fx: 0\nfy: 1\ncx: 0\ncy: 0",
        "text": "fx: a\nfy: b",
        "missing": "fx: 1",
        "nested": "[" * 5000,
        "xml": "<a><b></a>",
        "tag": "fx: !!python/object x",
        "doctype": "<?xml version='1.0'?><!DOCTYPE a []><a/>",
        "far": "fx: 1e300\nfy: 1\ncx: 0\ncy: 0",
        "short": "fx: 9\nfy: 9\ncx: 0\ncy: 0\ndistortion: [1, 2, 3]",
        "number": "5",
        "list": "- 1",
        "fisheye": "fx: 9\nfy: 9\ncx: 0\ncy: 0\ndistortion: [1,2,3,4,5]\ndistortion_model: fisheye",
        "nan": "fx: .nan\nfy: 1\ncx: 0\ncy: 0",
        "date": "fx: 2020-13-99",
    }
    for name, body in bodies.items():
        yield Bad(
            f"camera-{name}",
            written("bad.yaml", body),
            ["hypothesize", "tracks.json", "--camera", "bad.yaml"],
            ("",),
            (2, 3, 4),
        )
    yield Bad("camera-two", nothing, ["hypothesize", "tracks.json", "--camera", "1,2"], ("1,2",))
    for name in ("laughs", "alias", "nested", "number", "list", "tag"):
        yield Bad(
            f"config-{name}", written("bad.yaml", bodies[name]), ["run", "bad.yaml"], ("bad.yaml",)
        )


def labels() -> Iterator[Bad]:
    square = [[0, 0], [9, 0], [9, 9]]
    shape = {"label": "a", "points": square, "shape_type": "polygon", "group_id": None}
    labelme = {"shapes": [shape], "imagePath": "m", "imageWidth": 200, "imageHeight": 200}
    image = {"id": 1, "file_name": "m", "width": 200, "height": 200}
    code = {"size": [200, 200], "counts": [40_000]}
    entry = {"image_id": 1, "category_id": 1, "segmentation": code}
    coco = {"images": [image], "annotations": [entry], "categories": []}
    trees: dict[str, Any] = {
        "size": labelme | {"imageWidth": 10**6, "imageHeight": 10**6},
        "shapes": labelme | {"shapes": 5},
        "points": labelme | {"shapes": [shape | {"points": [[1]]}]},
        "none": labelme | {"shapes": []},
        "far": labelme | {"shapes": [shape | {"points": [[1e300, 0], [1, 1], [2, 0]]}]},
        "runs": coco | {"annotations": [entry | {"segmentation": code | {"counts": [-1, 40_001]}}]},
        "run-size": coco
        | {"annotations": [entry | {"segmentation": {"size": [10**9] * 2, "counts": []}}]},
        "entry": coco | {"annotations": [5]},
        "image": coco | {"images": [{}]},
        "list": [1, 2],
        "zero": labelme | {"imageWidth": 0},
        "other": {"a": 1},
    }
    for name, tree in trees.items():
        yield Bad(
            f"labels-{name}",
            written("bad.json", json.dumps(tree)),
            ["report", "segmentation.json", "--labels", "bad.json"],
            ("",),
        )
    mask = '<mask label="b" left="{}" top="0" width="{}" height="{}" rle="{}"/>'
    for name, values in {
        "rle": (0, 2, 2, "9,9"),
        "huge": (0, 10**9, 10**9, "1,3"),
        "left": (-5, 2, 2, "1,3"),
        "run": (0, 2, 2, "-1,5"),
        "word": (0, 2, 2, "a"),
        "billion": (0, 2, 2, "1000000000000"),
    }.items():
        head = '<annotations><image id="0" name="m" width="200" height="200">'
        body = f"{head}{mask}</image></annotations>"
        yield Bad(
            f"labels-cvat-{name}",
            written("bad.xml", body.format(*values)),
            ["report", "segmentation.json", "--labels", "bad.xml"],
            ("bad.xml",),
        )


def outputs() -> Iterator[Bad]:
    for command in (
        ["import", "m.csv"],
        ["detect", "1.png", "2.png"],
        ["hypothesize", "tracks.json"],
        ["cluster", "hypotheses.json"],
        ["init"],
        ["schema", "tracks"],
    ):
        yield Bad(
            f"{command[0]}-to-folder", lambda: Path("d").mkdir(), [*command, "-o", "d"], ("d: ",)
        )
        yield Bad(f"{command[0]}-to-nowhere", nothing, [*command, "-o", "no/where"], ("no/where",))
    yield Bad("run-to-file", written("file", "x"), ["run", "m.csv", "--out", "file"], ("file",))
    yield Bad(
        "report-to-file",
        written("file", "x"),
        ["report", "segmentation.json", "--out", "file"],
        ("file",),
    )
    yield Bad("run-two-kinds", nothing, ["run", "m.csv", "1.png"], ("m.csv",))
    for command in (["import", "m.csv"], ["init"], ["schema", "tracks"]):
        yield Bad(f"{command[0]}-to-long", nothing, [*command, "-o", "n" * 400], ("nnn",))
    latin = os.fsdecode(b"lat\xedn.csv")
    for command in (["import", latin], ["run", latin], ["detect", latin, "1.png"]):
        make = (lambda: os.link("m.csv", latin)) if command[0] != "detect" else nothing
        yield Bad(f"{command[0]}-latin", make, command, ("lat", "UTF-8"))
    yield Bad("label-absent", nothing, ["label", "absent.png"], ("absent.png",))
    yield Bad(
        "label-video-cut", written("b.mp4", b"\0\0\0\x18ftypisom"), ["label", "b.mp4"], ("b.mp4",)
    )
    yield Bad("label-to-file", written("file", "x"), ["label", "1.png", "--out", "file"], ("file",))
    yield Bad("label-port", nothing, ["label", "1.png", "--port", "99999"], ("--port",), (2,))
    yield Bad("benchmark-absent", nothing, ["benchmark", "hopkins155", "absent"], ("absent",))
    yield Bad("benchmark-name", nothing, ["benchmark", "nothing", "."], ("nothing",), (2,))
    yield Bad("batch-empty", written("b.csv", ""), ["batch", "b.csv"], ("b.csv",))
    yield Bad(
        "batch-key", written("b.csv", "tracks,nothing\nm.csv,1"), ["batch", "b.csv"], ("nothing",)
    )
    yield Bad("batch-config", nothing, ["batch", "m.csv", "--config", "absent.yaml"], ("absent",))
    yield Bad("completion-shell", nothing, ["completion", "cmd"], ("cmd",), (2,))
    yield Bad("compare-one", nothing, ["compare", "segmentation.json"], ("",))
    yield Bad("run-unknown", nothing, ["run", "m.csv", "--nothing"], ("--nothing",), (2,))
    yield Bad("unknown-command", nothing, ["runn"], ("runn",), (2,))
    yield Bad("schema-unknown", nothing, ["schema", "nothing"], ("nothing",), (2,))
    yield Bad("fuse-unknown", nothing, ["fuse", "poses.txt", "--manifold", "x(1)"], ("x(1)",))
    for manifold in ("sphere(-1)", "sphere(99999999999)", "grassmann(3,9)", "se3(length_scale=0)"):
        yield Bad(f"fuse-{manifold}", nothing, ["fuse", "poses.txt", "--manifold", manifold], ("",))


TABLE = [
    *documents(),
    *files(),
    *settings(),
    *tables(),
    *pictures(),
    *cameras(),
    *labels(),
    *outputs(),
]
"""Every bad input."""
