"""How far the figures hold on changed scenes: ``python -m benchmarks.robustness FOLDER``.

Each disturbance changes the labelled matches of AdelaideRMF below FOLDER as another photographer
might have: every body seen with a perspective of its own, half of the matches, more noise,
mismatches. The number of motions is unknown. What holds here was not fitted to single scenes.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from mssegment.benchmarking.disturbance import uniform_mismatches
from mssegment.configuration import Setting, resolve
from mssegment.datasets.adelaidermf import ADELAIDERMF
from mssegment.datasets.base import ImportedTracks
from mssegment.documents import TracksDocument
from mssegment.evaluation import misclassification
from mssegment.pipeline import cluster, hypothesize
from mssegment.records import Floats, Integers, Tracks

Disturbance = Callable[[Floats, Integers, np.random.Generator], tuple[Floats, Integers]]

STEEPEST = 0.6
"""Bound on the change of depth over a body, so that every point stays in front of the camera."""


@dataclass(frozen=True)
class Row:
    """One line of the table; ``error`` is the mean over all pairs and seeds, a fraction."""

    group: str
    model: str
    disturbance: str
    error: float
    count_right: float


def perspective(share: float) -> Disturbance:
    """Every body of view 2 through a perspective in a random direction: ``share`` at its border."""

    def disturb(
        points: Floats, labels: Integers, rng: np.random.Generator
    ) -> tuple[Floats, Integers]:
        points = points.copy()
        for body in np.unique(labels[labels > 0]):
            place = points[labels == body, 1]
            centre = np.median(place, axis=0)
            radius = np.percentile(np.linalg.norm(place - centre, axis=1), 95)
            angle = rng.uniform(0, 2 * np.pi)
            slope = (place - centre) @ [np.cos(angle), np.sin(angle)] * share / radius
            depth = 1 + np.clip(slope, -STEEPEST, STEEPEST)
            points[labels == body, 1] = centre + (place - centre) / depth[:, None]
        return points, labels

    return disturb


def noise(pixels: float) -> Disturbance:
    """Normal noise on every coordinate."""
    return lambda points, labels, rng: (points + rng.normal(0, pixels, points.shape), labels)


def thinned(points: Floats, labels: Integers, rng: np.random.Generator) -> tuple[Floats, Integers]:
    """Half of the matches."""
    kept = rng.permutation(len(points))[: len(points) // 2]
    return points[kept], labels[kept]


def mismatched(
    points: Floats, labels: Integers, rng: np.random.Generator
) -> tuple[Floats, Integers]:
    """As many uniform mismatches again."""
    added = uniform_mismatches(points, len(points), rng)
    return np.concatenate([points, added]), np.concatenate([labels, np.zeros_like(labels)])


DISTURBANCES: dict[str, Disturbance] = {
    "as published": lambda points, labels, rng: (points, labels),
    "perspective 10 %": perspective(0.1),
    "perspective 20 %": perspective(0.2),
    "perspective 30 %": perspective(0.3),
    "1 px of noise": noise(1.0),
    "half of the matches": thinned,
    "100 % mismatches": mismatched,
}
MODELS = {"motion": ("auto", "affine"), "plane": ("homography", "auto")}


def measure(folder: Path, seeds: int) -> Iterator[Row]:
    """The rows of the table, one after the other."""
    pairs = [ADELAIDERMF.read(path) for path in ADELAIDERMF.files(folder)]
    for group, models in MODELS.items():
        own = [pair for pair in pairs if pair.group == group]
        for model in models:
            for name, disturb in DISTURBANCES.items():
                found = [_run(pair, model, disturb, seed) for pair in own for seed in range(seeds)]
                error, right = np.mean(found, axis=0) if found else (np.nan, np.nan)
                yield Row(group, model, name, float(error), float(right))


def _run(pair: ImportedTracks, model: str, disturb: Disturbance, seed: int) -> tuple[float, bool]:
    """Error, and whether the count is right."""
    assert pair.tracks.labels is not None
    rng = np.random.default_rng([seed, len(pair.tracks.points)])
    points, labels = disturb(pair.tracks.points, pair.tracks.labels, rng)
    known = ADELAIDERMF.benchmark
    assert known is not None
    values = {**known.settings, **known.by_group[pair.group], "hypothesize.model": model}
    configuration = resolve([Setting(k, v, "robustness") for k, v in values.items()])
    document = TracksDocument(frames=list(pair.frames), camera=None, tracks=Tracks(points))
    found = cluster(hypothesize(document, configuration), configuration)
    true = len(np.unique(labels[labels > 0]))
    return misclassification(found.labels, labels), len(found.motions) == true


def main() -> None:
    """Prints the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = []
    for row in measure(arguments.folder, arguments.seeds):
        rows.append(row)
        text = f"{row.group:8} {row.model:12} {row.disturbance:22}"
        text += f"{100 * row.error:7.2f} %   count right {100 * row.count_right:3.0f} %"
        print(text, file=sys.stderr if arguments.json else sys.stdout, flush=True)
    if arguments.json:
        print(json.dumps([asdict(row) for row in rows], indent=1))


if __name__ == "__main__":
    main()
