"""Whole files of tracks as other programs lay them out, for ``benchmarks.fuzz``."""

from __future__ import annotations

import json
import sqlite3
import struct
from pathlib import Path
from typing import Any

import numpy as np

LAYOUTS = [
    *("brox.dat", "equalizer.txt", "mtrackj.mdf", "effects.txt", "klt.txt", "images.txt"),
    *("images.bin", "kitti.txt", "drones.txt", "mot.txt", "sleap.csv", "labelled.csv"),
    *("storage.yml", "storage.xml", "trackmate.xml", "flow.flo", "pair.db"),
]
"""The files of text and bytes."""
TREES = ["frames.json", "coco-tracks.json", "split.json", "storage.json", "people.json"]
"""The files of JSON."""
WHOLE = "whole-"
"""Before the names of the whole files; the damaged ones have those that programs give them."""


def write_track_files(folder: Path, tracks: Any) -> None:
    """Write files with tracks [P, F, 2] of all these kinds into a folder."""
    tracks = np.round(tracks[:12], 2)
    count, frames = tracks.shape[:2]
    rows = [(p, f, *tracks[p, f].tolist()) for p in range(count) for f in range(frames)]
    texts = {
        **_blocks(tracks),
        "images.txt": "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
        + "".join(
            f"{f} 1 0 0 0 0 0 0 1 {f}.jpg\n"
            + " ".join(f"{x} {y} {p}" for p, (x, y) in enumerate(tracks[:, f]))
            + "\n"
            for f in range(frames)
        ),
        "kitti.txt": "".join(
            f"{f} {p} Car 0 0 -1 {x} {y} {x + 9} {y + 9} 1 1 3 -4 1 13 -2\n" for p, f, x, y in rows
        ),
        "drones.txt": "".join(
            f'{p} {x} {y} {x + 9} {y + 9} {f} 0 0 1 "Car"\n' for p, f, x, y in rows
        ),
        "mot.txt": "".join(f"{f},{p},{x},{y},9,9,1,-1,-1,-1\n" for p, f, x, y in rows),
        "sleap.csv": "track,frame_idx,head.x,head.y,head.score,tail.x,tail.y,tail.score\n"
        + "".join(f"{p},{f},{x},{y},0.9,{x + 3},{y},0.4\n" for p, f, x, y in rows),
        "labelled.csv": "scorer,,,me,me\nbodyparts,,,nose,nose\ncoords,,,x,y\n"
        + "".join(f"a,b,{f}.png,{x},{y}\n" for p, f, x, y in rows if p == 0),
        "trackmate.xml": _trackmate(rows),
    }
    for name, text in texts.items():
        (folder / f"{WHOLE}{name}").write_text(text)
    _write_binary(folder, tracks)
    _write_storage(folder, tracks)
    _write_trees(folder, rows, frames)


def _blocks(tracks: Any) -> dict[str, str]:
    count, frames = tracks.shape[:2]
    texts = {
        "brox.dat": f"{frames}\n{count}\n",
        "equalizer.txt": f"{count}\n",
        "mtrackj.mdf": "MTrackJ 1.5.1 Data File\n",
        "effects.txt": "Adobe After Effects 8.0 Keyframe Data\n",
        "klt.txt": "KLT Feature Table\n",
    }
    for p, own in enumerate(tracks):
        places = list(enumerate(own.tolist()))
        texts["brox.dat"] += f"{p % 2} {frames}\n" + "".join(
            f"{x} {y} {f}\n" for f, (x, y) in places
        )
        texts["equalizer.txt"] += f"Point {p}\n0\n{frames}\n"
        texts["equalizer.txt"] += "".join(f"{f} {x} {y}\n" for f, (x, y) in places)
        texts["mtrackj.mdf"] += f"Track {p} FF0000 true\n"
        texts["mtrackj.mdf"] += "".join(f"Point {f} {x} {y} 1 {f} 1\n" for f, (x, y) in places)
        texts["effects.txt"] += f"Point {p}\n\tFrame\tX pixels\tY pixels\n"
        texts["effects.txt"] += "".join(f"\t{f}\t{x}\t{y}\n" for f, (x, y) in places)
        texts["klt.txt"] += f"{p} | " + " ".join(f"({x},{y})= 0" for _, (x, y) in places) + "\n"
    return texts


def _trackmate(rows: list[tuple[int, int, float, float]]) -> str:
    spots = "".join(
        f'<Spot ID="{100 * p + f}" POSITION_X="{x}" POSITION_Y="{y}" FRAME="{f}"/>'
        for p, f, x, y in rows
    )
    edges = "".join(
        f'<Track TRACK_ID="{p}"><Edge SPOT_SOURCE_ID="{100 * p}" SPOT_TARGET_ID="{100 * p + 1}"/>'
        "</Track>"
        for p, f, _, _ in rows
        if not f
    )
    return (
        f"<TrackMate><Model><AllSpots><SpotsInFrame>{spots}</SpotsInFrame></AllSpots>"
        f"<AllTracks>{edges}</AllTracks></Model></TrackMate>"
    )


def _write_binary(folder: Path, tracks: Any) -> None:
    count, frames = tracks.shape[:2]
    model = struct.pack("<Q", frames)
    for f in range(frames):
        model += struct.pack("<I7dI", f, *[0.0] * 7, 1) + b"a.jpg\0" + struct.pack("<Q", count)
        model += b"".join(struct.pack("<ddq", *tracks[p, f], p) for p in range(count))
    (folder / f"{WHOLE}images.bin").write_bytes(model)
    flow = np.full((30, 40, 2), 3.0, dtype=np.float32)
    (folder / f"{WHOLE}flow.flo").write_bytes(
        struct.pack("<fii", 202021.25, 40, 30) + flow.tobytes()
    )
    base = sqlite3.connect(folder / f"{WHOLE}pair.db")
    base.execute("create table images (image_id int, name text)")
    for table, key in (("keypoints", "image_id"), ("matches", "pair_id")):
        base.execute(f"create table {table} ({key} int, rows int, cols int, data blob)")
    for f in range(2):
        base.execute("insert into images values (?, ?)", (f + 1, f"{f}.jpg"))
        data = tracks[:, f].astype(np.float32).tobytes()
        base.execute("insert into keypoints values (?, ?, 2, ?)", (f + 1, count, data))
    both = np.repeat(np.arange(count, dtype=np.uint32)[:, None], 2, axis=1).tobytes()
    base.execute("insert into matches values (?, ?, 2, ?)", (2147483647 + 2, count, both))
    base.commit()
    base.close()


def _write_storage(folder: Path, tracks: Any) -> None:
    import cv2

    for suffix in ("yml", "xml", "json"):
        out = cv2.FileStorage(str(folder / f"{WHOLE}storage.{suffix}"), cv2.FILE_STORAGE_WRITE)
        for f in range(2):
            out.write(f"points{f}", tracks[:, f].reshape(-1, 1, 2).astype(np.float32))
        out.release()


def _write_trees(folder: Path, rows: list[tuple[int, int, float, float]], frames: int) -> None:
    trees: dict[str, Any] = {
        "frames.json": {
            "frames": [
                {
                    "frame": f,
                    "objects": [{"id": p, "x": x, "y": y} for p, g, x, y in rows if g == f],
                }
                for f in range(frames)
            ]
        },
        "coco-tracks.json": {
            "images": [{"id": f, "file_name": f"{f}.jpg"} for f in range(frames)],
            "annotations": [
                {"id": 1, "image_id": f, "track_id": p, "bbox": [x, y, 9, 9]} for p, f, x, y in rows
            ],
        },
        "split.json": {"columns": ["track", "frame", "x", "y"], "data": rows},
        "people.json": [
            {"image_id": f, "idx": p, "keypoints": [x, y, 0.9, x + 3, y, 0.2]}
            for p, f, x, y in rows
        ],
    }
    for name, tree in trees.items():
        (folder / f"{WHOLE}{name}").write_text(json.dumps(tree))
