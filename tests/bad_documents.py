"""Bad documents: one value of a whole one replaced or removed."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple


class Bad(NamedTuple):
    """One row: its name, how its files are made, the arguments, and words of the error."""

    name: str
    make: Callable[[], None]
    arguments: list[str]
    words: tuple[str, ...]
    status: tuple[int, ...] = (2, 3, 4)


def nothing() -> None:
    """No file is made."""


def written(name: str, content: bytes | str) -> Callable[[], None]:
    """Writes a file."""
    raw = content.encode("utf-8", "surrogateescape") if isinstance(content, str) else content
    return lambda: Path(name).write_bytes(raw) and None


def changed(source: str, path: str, value: Any) -> Callable[[], None]:
    """Writes ``bad.json``: a document with the value at a dotted path replaced, or without it."""

    def make() -> None:
        tree = json.loads(Path(source).read_text())
        keys = [int(key) if key.lstrip("-").isdecimal() else key for key in path.split(".")]
        parent = tree
        for key in keys[:-1]:
            parent = parent[key]
        if value is ...:
            del parent[keys[-1]]
        else:
            parent[keys[-1]] = value
        Path("bad.json").write_text(json.dumps(tree))

    return make


def documents() -> Iterator[Bad]:
    commands = {
        "corners": ["match", "bad.json"],
        "tracks": ["hypothesize", "bad.json"],
        "hypotheses": ["cluster", "bad.json"],
        "segmentation": ["report", "bad.json", "--format", "text"],
    }
    everywhere = [
        ("frames", ...),
        ("frames", {}),
        ("frames.0.width", 0),
        ("frames.0.height", -4),
        ("frames.1.width", 10**30),
        ("frames.0.width", 1.5),
        ("frames.0.path", 7),
        ("frames.0.path", "a" * 20_000),
        ("frames.0.index", -1),
        ("schema", ...),
        ("schema", 5),
        ("schema", "mssegment/other/1"),
        ("schema", "mssegment/tracks/9"),
        ("history", 3),
        ("history", [{"stage": 1}]),
        ("camera", {"fx": 1}),
        ("camera", {"fx": 0, "fy": 1, "cx": 0, "cy": 0}),
        ("camera", {"fx": 1e9, "fy": 1, "cx": 0, "cy": 0}),
        ("camera", {"fx": 9, "fy": 9, "cx": 0, "cy": 0, "distortion": [1, 2, 3]}),
        ("camera", {"fx": 9, "fy": 9, "cx": 0, "cy": 0, "distortion": [1e9, 0, 0, 0]}),
    ]
    own: dict[str, list[tuple[str, Any]]] = {
        "corners": [
            ("corners", ...),
            ("corners", []),
            ("corners.0.points", [[1, 2, 3]]),
            ("corners.0.points.0", [1e6, 0]),
            ("corners.0.points.3", [5, -40]),
            ("corners.0.points.0", [None, None]),
            ("corners.0.responses", [1]),
            ("corners.0.scales.0", 0),
            ("corners.1.scales", "x"),
            ("corners.0", 4),
        ],
        "tracks": [
            ("tracks", ...),
            ("tracks.points", 5),
            ("tracks.points", [[[1]]]),
            ("tracks.points.0.0", [1, None]),
            ("tracks.points.0.0", [1e7, 0]),
            ("tracks.points.0", [[1, 2]]),
            ("tracks.labels", [1]),
            ("tracks.labels.0", 10**30),
            ("tracks.labels.0", -9),
            ("tracks.labels.0", 2**40),
            ("tracks.ids", ["a"]),
            ("tracks.points", {"dtype": "<f8", "shape": [10**12, 2, 2], "base64": ""}),
            ("tracks.points", {"dtype": "|O", "shape": [1], "base64": ""}),
            ("tracks.points", {"dtype": "<f8", "shape": [1] * 90, "base64": "AAAAAAAAAAA="}),
            ("tracks.points", {"dtype": "<f8", "shape": [1, 2, 2], "base64": "?"}),
            ("tracks.affines", [[1]]),
        ],
        "hypotheses": [
            ("strategy", "guess"),
            ("status", [0]),
            ("status.0", 5),
            ("sets", 1),
            ("sets.0.model", "nothing"),
            ("sets.0.manifold", "special_linear(3)"),
            ("sets.0.manifold", "affine(" + "9" * 50 + ")"),
            ("sets.0.manifold", ""),
            ("sets.0.frames", [0, 9]),
            ("sets.0.frames", [0, 10**30]),
            ("sets.0.frames", [0]),
            ("sets.0.subsets.0.0", 10**6),
            ("sets.0.subsets.0.0", -1),
            ("sets.0.subsets", [[1]]),
            ("sets.0.points.0", [[1]]),
            ("sets.0.points.0.0.0", 1e299),
            ("sets.0.points.0.0.0", None),
            ("sets.0.drawn", -1),
            ("sets.0.drawn", 10**30),
            ("sets.0.normalization", ...),
            ("sets.0.normalization.scale", 0),
            ("sets.0.normalization.centres", [[0, 0]]),
            ("partition", "spectral"),
            ("sets.0.normalization.rotation", [[1, 0, 0], [0, 1, 0], [0, 0, 2]]),
            ("log_nfa", [0.5]),
        ],
        "segmentation": [
            ("labels", [1]),
            ("labels.0", 99),
            ("labels.0", -7),
            ("labels", ...),
            ("motions.0.label", 5),
            ("motions.0.set_index", 9),
            ("motions.0.set_index", -1),
            ("motions.0.parameters", [1, 2]),
            ("motions.0.parameters.0.0", 1e299),
            ("motions.0.parameters.0.0", None),
            ("motions.0.inliers.0", 10**6),
            ("motions.0.inliers", [[1]]),
            ("motions.0.rms", -1),
            ("motions.0.rms", None),
            ("modes.0.kde", None),
            ("modes.0.kde", -1),
            ("modes.0.hypotheses", -3),
            ("modes.0.hypotheses", 10**30),
            ("modes.0.motion", 99),
            ("modes.0.set_index", 7),
            ("modes.0.point", [1]),
            ("modes.0.point.0.0", -1e299),
            ("bandwidths", [-1]),
            ("residuals", [[1]]),
            ("assignments.0", [1]),
            ("assignments.0.0", 10**6),
            ("camera_motion", 99),
            ("camera_motion", 0),
            ("notes", [5]),
            ("notes", ["x" * 20_000]),
            ("sets.0.points.0.0.0", 1e299),
        ],
    }
    for kind, command in commands.items():
        for path, value in [*everywhere, *own[kind]]:
            if (path, value) == ("schema", "mssegment/tracks/9") and kind != "tracks":
                continue
            yield Bad(
                f"{kind}-{path}-{str(value)[:60]}",
                changed(f"{kind}.json", path, value),
                command,
                ("bad.json",),
            )
        yield Bad(
            f"{kind}-deep", written("bad.json", '{"schema":' + "[" * 10**5), command, ("bad",)
        )
        name = f'{{"schema": "mssegment/{kind}/1"'
        yield Bad(f"{kind}-cut", written("bad.json", name), command, ("bad.json",))
        yield Bad(
            f"{kind}-latin",
            written("bad.json", name.encode() + b', "frames": "\xff"}'),
            command,
            ("bad.json",),
        )
