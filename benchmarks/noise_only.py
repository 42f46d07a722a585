"""Noise only: positions drawn uniformly in each frame. No model may find a motion in them.

    python -m benchmarks.noise_only [--seeds N] [--minutes M] [--frames N...] [--matches N...]

Two views are segmented by every model and by ``auto``, sequences by ``auto`` (consensus) and by
``meanshift``. All cells are run with one seed after another, so that a run that ``--minutes`` cuts
short has seen them equally often.
"""

from __future__ import annotations

import argparse
import time
from collections import defaultdict

import numpy as np

import mssegment
from mssegment.errors import DataError
from mssegment.models import MODELS

SIZE = (640, 480)
CAMERA = mssegment.Camera(500.0, 500.0, 320.0, 240.0)
Cell = tuple[int, str, int]
"""Frames, model (two views) or method (sequences), and number of matches."""


def cells(frames: list[int], matches: list[int]) -> list[Cell]:
    """All cells of the table."""
    pairs = [
        "auto",
        *(name for name, model in MODELS.items() if model.of_pictures and model.accepts(2)),
    ]
    return [
        (count, way, size)
        for size in matches
        for count in frames
        for way in (pairs if count == 2 else ["auto", "meanshift"])
    ]


def motions_in_noise(cell: Cell, seed: int) -> int:
    """The number of motions that are found in noise; a refusal (DataError) finds none."""
    frames, way, matches = cell
    rng = np.random.default_rng([seed, frames, matches])
    points = rng.uniform(0, 1, (matches, frames, 2)) * SIZE
    settings: dict[str, object] = {"seed": seed}
    settings["hypothesize.model" if frames == 2 else "cluster.method"] = way
    camera = CAMERA if way in MODELS and MODELS[way].needs_camera else None
    try:
        found = mssegment.segment_tracks(points, settings, frame_size=SIZE, camera=camera)
    except DataError:
        return 0
    return len(found.motions)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--minutes", type=float, default=1e9)
    parser.add_argument("--frames", type=int, nargs="+", default=[2, 3, 4, 5, 6, 10, 20])
    parser.add_argument("--matches", type=int, nargs="+", default=[50, 200, 1000])
    options = parser.parse_args()
    stop = time.monotonic() + 60 * options.minutes
    runs: dict[Cell, int] = defaultdict(int)
    wrong: dict[Cell, list[int]] = defaultdict(list)
    table = cells(options.frames, options.matches)
    for seed in range(options.seeds):
        for cell in table:
            if time.monotonic() > stop:
                break
            runs[cell] += 1
            if motions_in_noise(cell, seed):
                wrong[cell].append(seed)
                print(f"{cell}: seed {seed} finds a motion", flush=True)
    print(f"{'frames':>6} {'model or method':<16} {'matches':>7} {'runs':>5} {'with a motion':>14}")
    for cell in table:
        frames, way, matches = cell
        print(f"{frames:>6} {way:<16} {matches:>7} {runs[cell]:>5} {len(wrong[cell]):>14}")
    bad = sum(map(len, wrong.values()))
    print(f"{sum(runs.values())} runs, {bad} with a motion")


if __name__ == "__main__":
    main()
