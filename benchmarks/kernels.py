"""How many labels two CPU kernels of OpenBLAS agree on.

    python -m benchmarks.kernels [--data FOLDER] [--kernels Haswell SkylakeX] [--limit N]

The same input and seed give the same bytes on one CPU kernel. Another one rounds differently; what
decides, the labels, should not hang on the last digits. The sample scenes, and the pairs of
AdelaideRMF below FOLDER, are segmented in processes of their own, one for each kernel
(``OPENBLAS_CORETYPE``).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import mssegment
from mssegment.evaluation import match_labels
from mssegment.neighbours import nearest

ROOT = Path(mssegment.__file__).parents[1]
SAMPLES = ("affine", "factorization", "translation")
PLANE: dict[str, object] = {"hypothesize.model": "homography", "segment.granularity": "surface"}


def inputs(data: Path | None, limit: int | None = None) -> list[str]:
    """The names of the inputs: samples, and files of AdelaideRMF."""
    pairs = [] if data is None else sorted(data.glob("adelaidermf/**/*.mat"))
    return [*SAMPLES, *map(str, pairs[:limit])]


Labelled = list[list[float]]
"""Of each track its place in the first frame that shows it, in pixels, and its label."""
NEAR = 3.0
"""Pixels within which a track is the same place of the scene, as ``report.label_radius``."""


def labels_of(name: str) -> Labelled:
    """The tracks of one input with their labels."""
    if name in SAMPLES:
        folder = ROOT / "sample_data" / name
        settings: dict[str, object] = {"hypothesize.model": name}
        if name == "translation":
            settings["camera.file"] = str(folder / "camera.yaml")
        found = mssegment.segment_pictures(sorted(folder.glob("frame-*.png")), settings)
    else:
        from mssegment import datasets

        settings = dict(PLANE) if "plane" in Path(name).parts else {}
        found = mssegment.segment_tracks(datasets.read(name).tracks.points, settings)
    seen = np.isfinite(found.points).all(axis=-1).argmax(axis=1)
    places = found.points[np.arange(len(seen)), seen]
    rows: Labelled = np.column_stack([places, found.labels]).tolist()
    return rows


def with_kernel(kernel: str, names: Sequence[str]) -> dict[str, Labelled]:
    """The labelled tracks of each input, in a process with this kernel."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-m", "benchmarks.kernels", "--print", *names]
    done = subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE, cwd=ROOT)
    found: dict[str, Labelled] = json.loads(done.stdout)
    return found


def agreement(first: Labelled, second: Labelled) -> float:
    """The share of tracks with the same label, by the best matching of the motions.

    Pictures are matched by the kernel too, so a track is compared with the nearest one of the other
    kernel; where none is near, there is nothing to compare. Tracks that were given are the same
    ones, of which several may begin at one place.
    """
    a, b = np.asarray(first), np.asarray(second)
    if np.array_equal(a[:, :2], b[:, :2]):
        pairs = a[:, 2], b[:, 2]
    else:
        gaps, place = nearest(b[:, :2], a[:, :2])
        near = gaps[:, 0] <= NEAR
        pairs = a[near, 2], b[place[near, 0], 2]
    own, other = (labels.astype(np.int64) for labels in pairs)
    matching = match_labels(own, other)
    renamed = [matching.get(label, -9) if label > 0 else label for label in own.tolist()]
    return float((np.array(renamed) == other).mean())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path)
    parser.add_argument("--kernels", nargs=2, default=["Haswell", "SkylakeX"])
    parser.add_argument("--limit", type=int)
    parser.add_argument("--print", nargs="+", metavar="INPUT", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.print:
        print(json.dumps({name: labels_of(name) for name in options.print}))
        return
    names = inputs(options.data, options.limit)
    found = [with_kernel(kernel, names) for kernel in options.kernels]
    shares = {name: agreement(found[0][name], found[1][name]) for name in names}
    for name, share in shares.items():
        print(f"{Path(name).stem:<24} {100 * share:6.2f} %")
    worst = min(shares.values())
    print(f"mean {100 * np.mean([*shares.values()]):.2f} %, least {100 * worst:.2f} %")


if __name__ == "__main__":
    main()
