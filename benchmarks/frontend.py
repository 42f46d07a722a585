"""Our front end against SIFT on the AdelaideRMF pairs: ``python -m benchmarks.frontend FOLDER``.

FOLDER holds .mat files with two pictures and labelled matches. A match is right if it is within
2 pixels of the epipolar lines, both ways, of one of the labelled motions. SIFT: detect, compute,
brute force, Lowe's ratio 0.8. Times are medians of interleaved runs on one thread.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from scipy.io import loadmat

from mssegment.imaging.corners import detect_all
from mssegment.imaging.matching import match
from mssegment.records import Floats

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
    """The greater of the two distances to the epipolar lines, for the best motion, pixels."""
    one, two = (np.column_stack([matches[:, i], np.ones(len(matches))]) for i in (0, 1))
    best = np.full(len(matches), np.inf)
    for matrix in matrices:
        line2, line1 = one @ matrix.T, two @ matrix
        value = np.abs((line2 * two).sum(axis=1))
        shorter = np.minimum(
            np.linalg.norm(line1[:, :2], axis=1), np.linalg.norm(line2[:, :2], axis=1)
        )
        best = np.minimum(best, value / np.maximum(shorter, 1e-12))
    return best


def measure(
    path: Path, methods: dict[str, Callable[[list[np.ndarray]], Floats]], runs: int
) -> dict:
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--methods", default="affine", help="ours, separated by commas")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    methods: dict[str, Callable[[list[np.ndarray]], Floats]] = {"sift": sift}
    for method in options.methods.split(","):
        methods[method] = lambda pictures, method=method: ours(pictures, method)
    rows = [measure(path, methods, options.runs) for path in sorted(options.folder.glob("*.mat"))]
    if not rows:
        raise SystemExit(f"{options.folder}: no .mat files")
    if options.json:
        print(json.dumps(rows, indent=1))
        return
    print(
        f"{'pair':20}"
        + "".join(f"{name + ': right of all, share':>36} {'ms':>5}" for name in methods)
    )
    rows.append(
        {"pair": "mean"}
        | {n: {k: np.mean([r[n][k] for r in rows]) for k in rows[0][n]} for n in methods}
    )
    for row in rows:
        cells = [row[n] for n in methods]
        print(
            f"{row['pair']:20}"
            + "".join(
                f"{c['right']:20.0f} {c['matches']:7.0f} {c['share']:7.1%} {1000 * c['seconds']:5.0f}"
                for c in cells
            )
        )


if __name__ == "__main__":
    main()
