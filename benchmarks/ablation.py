"""What each ingredient of ``mdl`` is worth: ``python -m benchmarks.ablation FOLDER [--seeds 3]``.

Takes one ingredient away at a time and prints what the error and the count become on the pairs of
AdelaideRMF below FOLDER: moving objects (affine, objects), the same with as many uniform
mismatches added, and planes (homography, surfaces), the number of motions unknown.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mssegment import models
from mssegment.datasets.adelaidermf import ADELAIDERMF, group_of
from mssegment.evaluation import misclassification
from mssegment.records import OUTLIER, Floats, HypothesisSet, Integers, replace
from mssegment.sampling.elemental_subsets import hypothesize
from mssegment.sampling.options import Sampling, SamplingOptions
from mssegment.segmentation.mdl.choice import mdl
from mssegment.segmentation.mdl.preparation import ALL_INGREDIENTS as ALL
from mssegment.segmentation.mdl.preparation import Ingredients
from mssegment.segmentation.mode_based import segment_by_modes
from mssegment.segmentation.options import Granularity, SegmentOptions
from mssegment.segmentation.selection import SelectionProblem, SelectionResult

VARIANTS: dict[str, tuple[Ingredients, Sampling]] = {
    "everything": (ALL, "local"),
    "Gaussian residuals": (replace(ALL, degrees_of_freedom=np.inf), "local"),
    "labels cost nothing": (replace(ALL, label_cost=False), "local"),
    "labels not settled by neighbours": (replace(ALL, neighbour_labels=False), "local"),
    "parameters cost nothing": (replace(ALL, parameter_weight=0.0), "local"),
    "parameters cost twice": (replace(ALL, parameter_weight=2.0), "local"),
    "no moves after the start": (replace(ALL, search=False), "local"),
    "no differences between motions": (replace(ALL, relative_coding=False), "local"),
    "uniform sampling": (ALL, "uniform"),
}
GROUPS = ("motion", "motion + 100 %", "plane")


@dataclass(frozen=True)
class Pair:
    """Matches [P, 2, 2] in pixels with their true labels, and the group that they belong to."""

    name: str
    group: str
    points: Floats
    labels: Integers

    @property
    def model(self) -> str:
        """The motion model of the group."""
        return "homography" if self.group == "plane" else "affine"

    @property
    def granularity(self) -> Granularity:
        """What the group means by a motion."""
        return "surface" if self.group == "plane" else "object"


def pairs(folder: Path) -> Iterator[Pair]:
    """The pairs as published, and the moving objects with as many mismatches again."""
    for path in ADELAIDERMF.files(folder):
        imported = ADELAIDERMF.read(path)
        points, labels = imported.tracks.points, imported.tracks.labels
        assert labels is not None
        group = group_of(path.stem)
        yield Pair(path.stem, group, points, labels)
        if group == "motion":
            rng = np.random.default_rng(len(points))
            size = [imported.frames[0].width, imported.frames[0].height]
            added = rng.uniform([0, 0], size, (len(points), 2, 2))
            everything = np.concatenate([points, added])
            truth = np.concatenate([labels, np.zeros(len(added), dtype=np.int64)])
            yield Pair(path.stem, "motion + 100 %", everything, truth)


def sampled(pair: Pair, sampling: Sampling, seed: int) -> list[HypothesisSet]:
    return hypothesize(
        pair.points,
        models=models.automatic(2) if pair.model == "auto" else (pair.model,),
        options=SamplingOptions(sampling=sampling),
        rng=np.random.default_rng([seed, 1]),
    )


def problem_of(pair: Pair, sampling: Sampling, seed: int) -> SelectionProblem:
    """What a selection gets to see of ``pair``: the tracks and the modes, no labels."""
    kept: list[SelectionProblem] = []

    def keep(problem: SelectionProblem) -> SelectionResult:
        kept.append(problem)
        return SelectionResult(())

    segment_by_modes(
        pair.points,
        sampled(pair, sampling, seed),
        select=keep,
        status=np.full(len(pair.points), OUTLIER),
        options=SegmentOptions(granularity=pair.granularity),
        rng=np.random.default_rng([seed, 2]),
    )
    return kept[0]


def outcomes(pair: Pair, seed: int, tick: Callable[[], None]) -> Iterator[tuple[str, float, bool]]:
    """Error (fraction) and whether the count is right, for every variant on one pair."""
    samplings: tuple[Sampling, ...] = ("local", "uniform")
    problems = {sampling: problem_of(pair, sampling, seed) for sampling in samplings}
    for name, (ingredients, sampling) in VARIANTS.items():
        selected = mdl(problems[sampling], ingredients)
        labels = np.zeros(len(pair.points), dtype=np.int64)
        for label, motion in enumerate(selected.motions, start=1):
            labels[motion.inliers] = label
        right = len(selected.motions) == len(np.unique(pair.labels[pair.labels > 0]))
        yield name, misclassification(labels, pair.labels), right
        tick()


def run(folder: Path, seeds: int) -> dict[str, dict[str, dict[str, float]]]:
    """Variant -> group -> mean error (fraction) and share of right counts."""
    found: dict[str, dict[str, list[tuple[float, bool]]]] = {
        name: {group: [] for group in GROUPS} for name in VARIANTS
    }
    done = 0

    def tick() -> None:
        nonlocal done
        done += 1
        print(f"\r{done} segmentations", end="", file=sys.stderr, flush=True)

    for pair in pairs(folder):
        for seed in range(seeds):
            for name, error, right in outcomes(pair, seed, tick):
                found[name][pair.group].append((error, right))
    print(file=sys.stderr)
    return {
        name: {
            group: {
                "mean": float(np.mean([error for error, _ in values])),
                "count_right": float(np.mean([right for _, right in values])),
            }
            for group, values in groups.items()
            if values
        }
        for name, groups in found.items()
    }


def table(results: dict[str, dict[str, dict[str, float]]]) -> str:
    """The results as a table in Markdown, percentages."""
    groups = [g for g in GROUPS if g in results["everything"]]
    lines = ["| taken away | " + " | ".join(f"{g}: mean, count right" for g in groups) + " |"]
    lines.append("|---" * (len(groups) + 1) + "|")
    for name, by_group in results.items():
        cells = [
            f"{100 * by_group[g]['mean']:.2f} %, {100 * by_group[g]['count_right']:.0f} %"
            for g in groups
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.ablation", description=__doc__)
    parser.add_argument("folder", type=Path, help="the folder with the pairs of AdelaideRMF")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    options = parser.parse_args(arguments)
    results = run(options.folder, options.seeds)
    print(json.dumps(results, indent=2) if options.json else table(results))


if __name__ == "__main__":
    main()
