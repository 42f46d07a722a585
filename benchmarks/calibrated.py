"""Objects that turn before a calibrated camera: model ``essential`` beside ``auto``.

    python -m benchmarks.calibrated [--seeds 0:3] [--scenes 8]

The moving objects of AdelaideRMF, with focal lengths guessed as multiples of the longer side of
the picture, and random scenes of boxes that move and turn, with stray matches.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator

import numpy as np

import mssegment
from benchmarks.data import data_folder
from mssegment import Camera
from mssegment.datasets import DATASETS
from mssegment.evaluation import evaluate
from mssegment.geometry.rotations import rotation
from mssegment.records import Floats, Integers

SIZE = np.array([640.0, 480.0])
FOCAL = 800.0
GUESSES = (0.8, 1.2, 1.8)
Scene = tuple[Floats, Integers, Camera]


def boxes(
    rng: np.random.Generator,
    bodies: int = 3,
    per: int = 60,
    outliers: int = 60,
    noise: float = 0.2,
    turn: float = 8.0,
) -> Scene:
    """Boxes of width 1.2 at distances of 4 to 6 that turn by about ``turn`` degrees."""
    parts = []
    for _ in range(bodies):
        centre = rng.uniform([-1.2, -0.9, 4.0], [1.2, 0.9, 6.0])
        first = centre + rng.uniform(-0.6, 0.6, (per, 3))
        turned = rotation(np.radians(turn) * rng.standard_normal(3) / np.sqrt(3.0))
        second = (first - centre) @ turned.T + centre + 0.15 * rng.standard_normal(3)
        space = np.stack([first, second], axis=1)
        parts.append(space[..., :2] / space[..., 2:] * FOCAL + SIZE / 2)
    points = np.concatenate(parts)
    points += noise * rng.standard_normal(points.shape)
    stray = rng.uniform(0.0, 1.0, (outliers, 2, 2)) * SIZE
    labels = np.append(np.repeat(np.arange(1, bodies + 1), per), np.zeros(outliers, np.int64))
    camera = Camera(FOCAL, FOCAL, SIZE[0] / 2, SIZE[1] / 2)
    return np.concatenate([points, stray]), labels, camera


def published(guess: float) -> Iterator[Scene]:
    """The pairs of AdelaideRMF with the focal length ``guess`` times the longer side."""
    folder = data_folder()
    if folder is None:
        return
    reader = DATASETS["adelaidermf"]
    for path in reader.files(folder / "adelaidermf" / "motion"):
        entry = reader.read(path)
        frame, tracks = entry.frames[0], entry.tracks
        assert tracks.labels is not None
        focal = guess * max(frame.width, frame.height)
        camera = Camera(focal, focal, frame.width / 2, frame.height / 2)
        yield tracks.points, tracks.labels, camera


def row(name: str, model: str, scenes: Iterator[Scene], seeds: list[int]) -> None:
    """Print error, share of right numbers of motions, and CPU seconds of one model."""
    errors, right, seconds = [], [], 0.0
    for points, truth, camera in scenes:
        for seed in seeds:
            settings = {"hypothesize.model": model, "seed": seed}
            start = time.process_time()
            used = camera if model == "essential" else None
            found = mssegment.segment_tracks(points, settings, camera=used)
            seconds += time.process_time() - start
            errors.append(100 * evaluate(truth, found.labels).misclassification)
            right.append(len(found.motions) == len(np.unique(truth[truth > 0])))
    if errors:
        print(
            f"| {name} | {model} | {np.mean(errors):.1f} | {sum(right)} of {len(right)} | "
            f"{seconds / len(right):.1f} |",
            flush=True,
        )


SCENES: dict[str, dict[str, float]] = {
    "3 boxes, 25 % outliers": {},
    "noise 0.5 px": {"noise": 0.5},
    "noise 1 px": {"noise": 1.0},
    "turning by 20 degrees": {"turn": 20.0},
    "50 % outliers": {"outliers": 180},
    "one box": {"bodies": 1},
    "5 boxes": {"bodies": 5},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", default="0:3", help="seeds first:stop")
    parser.add_argument("--scenes", type=int, default=8, help="random scenes of each kind")
    options = parser.parse_args()
    seeds = list(range(*map(int, options.seeds.split(":"))))
    print("| data | model | error % | number right | CPU seconds |\n|---|---|---|---|---|")
    row("AdelaideRMF objects", "auto", published(1.2), seeds)
    for guess in GUESSES:
        row(f"the same, focal length {guess} sides", "essential", published(guess), seeds)
    generate: Callable[..., Scene] = boxes
    for name, changes in SCENES.items():
        for model in ("auto", "essential"):
            rngs = (np.random.default_rng([seeds[0], k]) for k in range(options.scenes))
            row(name, model, (generate(rng, **changes) for rng in rngs), seeds[:1])


if __name__ == "__main__":
    main()
