"""Our front end against SIFT on the AdelaideRMF pairs: ``python -m benchmarks.frontend FOLDER``.

FOLDER holds .mat files with two pictures and labelled matches. A match is right if it is within
2 pixels (Sampson distance) of the epipolar geometry of one of the labelled motions. SIFT: detect,
compute, brute force, Lowe's ratio 0.8. Seconds are CPU seconds on one thread, medians of
interleaved runs, so that a busy machine does not show.
"""

from __future__ import annotations

import argparse
import functools
import json
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.io import loadmat

from mssegment.datasets.adelaidermf import group_of
from mssegment.imaging.corners import detect_all
from mssegment.imaging.matching import match
from mssegment.records import Floats

Method = Callable[[list[np.ndarray]], Floats]

RIGHT = 2.0
RATIO = 0.8


def sift(pictures: list[np.ndarray]) -> Floats:
    """Matches [n, 2, 2] by SIFT and the ratio test."""
    detector = cv2.SIFT_create()
    (points1, first), (points2, second) = (detector.detectAndCompute(p, None) for p in pictures)
    pairs = cv2.BFMatcher(cv2.NORM_L2).knnMatch(first, second, k=2)
    good = [a for a, b in pairs if a.distance < RATIO * b.distance]
    return np.array([[points1[m.queryIdx].pt, points2[m.trainIdx].pt] for m in good])


def ours(pictures: list[np.ndarray], method: str) -> Floats:
    """Matches [n, 2, 2] by our corners and a matcher."""
    grey = [p.astype(np.float32) for p in pictures]
    return match(grey, detect_all(grey), method).points


def fundamentals(data: Floats, labels: np.ndarray) -> list[Floats]:
    """A fundamental matrix for every labelled motion with enough matches."""
    found = []
    for label in range(1, int(labels.max()) + 1):
        one, two = data[labels == label, 0:2], data[labels == label, 3:5]
        if len(one) >= 8:
            matrix, _ = cv2.findFundamentalMat(one, two, cv2.FM_LMEDS)
            if matrix is not None and matrix.shape == (3, 3):
                found.append(matrix)
    return found


def epipolar_distance(matches: Floats, matrices: list[Floats]) -> Floats:
    """Sampson distance [n] to the epipolar geometry of the best motion, pixels."""
    one, two = (np.column_stack([matches[:, i], np.ones(len(matches))]) for i in (0, 1))
    best = np.full(len(matches), np.inf)
    for matrix in matrices:
        line2, line1 = one @ matrix.T, two @ matrix
        value = np.abs((line2 * two).sum(axis=1))
        slope = (line1[:, :2] ** 2).sum(axis=1) + (line2[:, :2] ** 2).sum(axis=1)
        best = np.minimum(best, value / np.sqrt(np.maximum(slope, 1e-24)))
    return best


def measure(path: Path, methods: dict[str, Method], runs: int) -> dict:
    content = loadmat(path)
    pictures = [cv2.cvtColor(content[f"img{i}"], cv2.COLOR_RGB2GRAY) for i in (1, 2)]
    matrices = fundamentals(content["data"].T, content["label"].ravel())
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    results: dict[str, Floats] = {}
    for _ in range(runs):
        for name, method in methods.items():
            start = time.process_time()
            results[name] = method(pictures)
            seconds[name].append(time.process_time() - start)
    row = {"pair": path.stem}
    for name, matches in results.items():
        right = epipolar_distance(matches, matrices) < RIGHT
        row[name] = {
            "matches": len(matches),
            "right": int(right.sum()),
            "share": float(right.mean()) if len(right) else 0.0,
            "seconds": float(np.median(seconds[name])),
        }
    return row


def mean_of(rows: list[dict], names: list[str]) -> dict:
    """The mean of every figure over the pairs."""
    return {"pair": "mean"} | {
        name: {key: float(np.mean([row[name][key] for row in rows])) for key in rows[0][name]}
        for name in names
    }


def print_table(rows: list[dict], names: list[str]) -> None:
    print(f"{'pair':18}" + "".join(f"{name + ': right/all, share, ms':>36}" for name in names))
    for row in [*rows, mean_of(rows, names)]:
        print(f"{row['pair']:18}", end="")
        for cell in (row[name] for name in names):
            counts = f"{cell['right']:.0f}/{cell['matches']:.0f}"
            print(f"{counts:>20} {cell['share']:8.1%} {1000 * cell['seconds']:6.0f}", end="")
        print()
    total = mean_of(rows, names)
    for name in names[1:]:
        more = total[name]["right"] / total["sift"]["right"]
        points = 100 * (total[name]["share"] - total["sift"]["share"])
        slower = total[name]["seconds"] / total["sift"]["seconds"]
        print(
            f"{name}: right x {more:.2f}, share {points:+.1f} points, time x {slower:.2f} of SIFT"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--methods", default="affine", help="ours, separated by commas")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    methods: dict[str, Method] = {"sift": sift}
    for method in options.methods.split(","):
        methods[method] = functools.partial(ours, method=method)
    paths = [path for path in options.folder.glob("**/*.mat") if group_of(path.stem) == "motion"]
    if not paths:
        raise SystemExit(f"{options.folder}: no .mat files of moving objects")
    rows = [measure(path, methods, options.runs) for path in sorted(paths)]
    if options.json:
        print(json.dumps({"pairs": rows, "mean": mean_of(rows, list(methods))}, indent=1))
    else:
        print_table(rows, list(methods))


if __name__ == "__main__":
    main()
