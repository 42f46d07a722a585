"""The paper's three experiments on synthetic tracks: ``python -m benchmarks.paper``.

Prints per set-up the misclassification with the number of motions unknown and given, the share of
scenes in which the number is found, the oracle beside it, and res / res-hat, equations (23), (24).
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass

import numpy as np

from benchmarks.scenes import CAMERA, SETUPS, Scene, SetUp, generate, oracle
from mssegment import models
from mssegment.evaluation import match_labels, misclassification, residual_errors
from mssegment.records import ClusterResult, Hypotheses, HypothesisSet
from mssegment.sampling.elemental_subsets import hypothesize
from mssegment.sampling.options import SamplingOptions
from mssegment.segmentation import SELECTIONS, SegmentOptions, cluster
from mssegment.segmentation.options import Granularity


@dataclass(frozen=True)
class Outcome:
    """One scene: misclassification (fraction) unknown, given and of the oracle, count, ratios."""

    unknown: float
    given: float
    oracle: float
    count_right: bool
    ratios: tuple[float, ...]


def run_scene(setup: SetUp, seed: int, selection: str, granularity: Granularity) -> Outcome:
    """Segments scene ``seed`` of a set-up with the number of motions unknown, then given."""
    scene = generate(setup, seed)
    sets = hypothesize(
        scene.points,
        models=(setup.model,),
        # no static background here from which the rotation could be estimated
        options=SamplingOptions(count=setup.hypotheses, derotate=False),
        camera=CAMERA,
        rng=np.random.default_rng([seed, 1]),
    )
    found = {
        wanted: cluster(
            scene.points,
            Hypotheses("modes", tuple(sets)),
            options=SegmentOptions(selection=selection, granularity=granularity, motions=wanted),
            rng=np.random.default_rng([seed, 2]),
        )
        for wanted in (None, len(setup.inliers))
    }
    unknown, given = found.values()
    return Outcome(
        unknown=misclassification(unknown.labels, scene.labels),
        given=misclassification(given.labels, scene.labels),
        oracle=misclassification(oracle(setup, scene), scene.labels),
        count_right=len(unknown.motions) == len(setup.inliers),
        ratios=residual_ratios(scene, sets[0], unknown),
    )


def residual_ratios(
    scene: Scene, hypotheses: HypothesisSet, found: ClusterResult
) -> tuple[float, ...]:
    """res / res-hat of every found motion that has a true partner, over its true inliers."""
    model = models.make(hypotheses.model, frames=scene.points.shape[1])
    observed = model.observe(scene.points, hypotheses.normalization)
    ratios = []
    for label, true in match_labels(found.labels, scene.labels).items():
        best, _ = model.algebraic_fit(observed, (scene.labels == true)[None].astype(float))
        both = np.stack([found.motions[label - 1].parameters, best[0]])
        errors = model.algebraic_residuals(both, observed, hypotheses.normalization)
        res, res_hat = (residual_errors(row, scene.labels, true) for row in errors)
        ratios.append(res / res_hat)
    return tuple(ratios)


def summarize(outcomes: list[Outcome]) -> dict[str, float]:
    """Means over the scenes, fractions; the ratio is the mean over all motions of all scenes."""
    ratios = [ratio for outcome in outcomes for ratio in outcome.ratios]
    return {
        "mean_misclassification": float(np.mean([o.unknown for o in outcomes])),
        "count_right": float(np.mean([o.count_right for o in outcomes])),
        "mean_misclassification_given": float(np.mean([o.given for o in outcomes])),
        "oracle": float(np.mean([o.oracle for o in outcomes])),
        "res_ratio": float(np.mean(ratios)) if ratios else float("nan"),
        "res_ratio_median": float(np.median(ratios)) if ratios else float("nan"),
        "seeds": len(outcomes),
    }


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--seeds", type=int, default=100, help="scenes per set-up")
    parser.add_argument("--selection", choices=list(SELECTIONS), default="mdl")
    # the bodies are rigid and planar, or have the noise of half a pixel: no parallax to forgive
    choices = ["surface", "object", "auto"]
    parser.add_argument("--granularity", choices=choices, default="surface")
    parser.add_argument("--setup", choices=list(SETUPS), action="append", help="only this one")
    options = parser.parse_args(arguments)
    results = {}
    for name in options.setup or SETUPS:
        outcomes = []
        for seed in range(options.seeds):
            outcomes.append(run_scene(SETUPS[name], seed, options.selection, options.granularity))
            print(f"\r{name} {seed + 1}/{options.seeds}", end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
        results[name] = summarize(outcomes)
    print(json.dumps(results, indent=2) if options.json else table(results))


def table(results: dict[str, dict[str, float]]) -> str:
    """The results for people, percentages."""
    lines = ["set-up   unknown   count right   given   oracle   res/res-hat (median)"]
    for name, r in results.items():
        lines.append(
            f"{name:6} {r['mean_misclassification']:8.2%} {r['count_right']:12.0%}"
            f" {r['mean_misclassification_given']:9.2%} {r['oracle']:7.2%}"
            f" {r['res_ratio']:10.3f} ({r['res_ratio_median']:.3f})"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
