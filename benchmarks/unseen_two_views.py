"""The rows on two views: AdelaideRMF, static pairs, frame pairs, noise, random scenes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

import mssegment
from benchmarks.paper import run_scene
from benchmarks.scenes import SETUPS
from benchmarks.unseen_outliers import shuffled, uniform, within_reach
from benchmarks.unseen_pictures import rendered_pairs
from benchmarks.unseen_real import (
    OBJECTS,
    PLANES,
    Change,
    as_one_scene,
    half_of_the_matches,
    pair_of_frames,
    published,
    unchanged,
    with_noise,
)
from benchmarks.unseen_rows import Case, Outcome, Plan, Row, judged, synthetic
from benchmarks.unseen_scenes import Scene, Spec, generate
from benchmarks.unseen_sequences import SMALLEST, number, picture_size, shared_out
from mssegment import models
from mssegment.benchmarking import run_benchmark

Rng = np.random.Generator
KINDS = ("uniform", "reach", "shuffled")
STATIC = ("teddy", "tsukuba", "facade")
CAMERA = mssegment.Camera(800.0, 800.0, 320.0, 240.0)
OFFSET = 20_000.0
"""Pixels: coordinates of a mosaic."""
MODELS = ["auto", *(name for name in models.of_pictures() if name != "factorization")]
"""``auto`` and every model of two views; ``factorization`` refuses fewer than three frames."""


def random_scene(kind: str, rng: Rng) -> Scene:
    """1 to 6 bodies in 20 to 2000 matches, up to 70 % outliers, noise of 0.1 to 2 px.

    No body has fewer than ``SMALLEST`` matches: there are fewer bodies where matches are few.
    """
    total, share = int(number(rng, 20, 2000)), rng.uniform(0, 0.7)
    inliers = max(round(total * (1 - share)), SMALLEST)
    bodies = min(int(rng.integers(1, 7)), inliers // SMALLEST)
    moving = bool(rng.random() < 0.5)
    spec = Spec(
        2,
        shared_out(inliers, bodies, SMALLEST, rng, moving),
        outliers=max(total - inliers, 0),
        kind=kind,
        noise=number(rng, 0.1, 2.0),
        moving_camera=moving,
        speed=number(rng, 5, 40),
        turn=rng.uniform(0, 12),
        picture=picture_size(rng),
    )
    return generate(spec, rng)


def moving_camera(rng: Rng) -> Scene:
    """One moving body before a static scene with depth, few mismatches."""
    sizes = int(rng.integers(100, 401)), int(rng.integers(25, 81))
    spec = Spec(
        2,
        sizes,
        outliers=int(rng.uniform(0, 0.3) * sum(sizes)),
        kind=str(rng.choice(KINDS)),
        noise=rng.uniform(0.1, 0.7),
        moving_camera=True,
        speed=rng.uniform(8, 30),
        turn=rng.uniform(0, 8),
    )
    return generate(spec, rng)


def static_scene(rng: Rng) -> Scene:
    """A static scene with depth, seen by a moving camera."""
    size = int(rng.integers(100, 401))
    spec = Spec(
        2,
        (size,),
        outliers=int(rng.uniform(0, 0.3) * size),
        noise=rng.uniform(0.1, 0.7),
        moving_camera=True,
        speed=rng.uniform(8, 30),
        turn=rng.uniform(0, 8),
    )
    return generate(spec, rng)


def few_matches(each: int, rng: Rng) -> Scene:
    """Three bodies of so few clean matches."""
    noise, turn = rng.uniform(0.1, 0.3), rng.uniform(0, 5)
    return generate(Spec(2, (each,) * 3, noise=noise, speed=20, turn=turn), rng)


def exact_data(rng: Rng) -> Scene:
    """Two or three bodies without any noise, up to 30 % mismatches."""
    sizes = tuple(int(size) for size in rng.integers(40, 301, rng.integers(2, 4)))
    outliers = int(rng.uniform(0, 0.4) * sum(sizes))
    spec = Spec(2, sizes, outliers, noise=0.0, speed=20, turn=rng.uniform(0, 10))
    return generate(spec, rng)


def noisy(pixels: float, rng: Rng) -> Scene:
    """Three bodies with much noise, up to 30 % mismatches."""
    sizes = tuple(int(size) for size in rng.integers(40, 81, 3))
    outliers = int(rng.uniform(0, 0.4) * sum(sizes))
    spec = Spec(2, sizes, outliers, noise=pixels, speed=20, turn=rng.uniform(0, 8))
    return generate(spec, rng)


def far_coordinates(rng: Rng) -> Case:
    """Three bodies whose coordinates have a large offset."""
    scene = generate(Spec(2, (60, 40, 40), 20, noise=0.5, speed=20, turn=5), rng)
    return Case(
        scene.points + OFFSET,
        scene.labels,
        oracle=scene.oracle(),
        factors=scene.factors,
    )


def large_picture(rng: Rng) -> Scene:
    """Three bodies in 24 megapixels, mismatches within reach of a tracker."""
    spec = Spec(
        2,
        (120, 80, 80),
        outliers=100,
        kind="reach",
        noise=1.0,
        speed=10,
        turn=5,
        picture=(6000, 4000),
    )
    return generate(spec, rng)


def half_turn(bodies: int, rng: Rng) -> Scene:
    """Bodies that turn by half a turn in the picture, give or take 20 degrees."""
    spec = Spec(2, (60,) * bodies, 20, speed=20, turn=2, roll=rng.uniform(160, 200))
    return generate(spec, rng)


def noise_only(model: str, rng: Rng) -> Case:
    """50, 200 or 1000 matches of which none belongs to a motion."""
    tracks, kind = int(rng.choice([50, 200, 1000])), str(rng.choice(KINDS))
    if kind == "shuffled":
        size = tracks // 3 + 1
        scene = generate(Spec(2, (size,) * 3, noise=0.5, speed=20, turn=5), rng)
        points = shuffled(scene.points, tracks, rng)
    else:
        make = uniform if kind == "uniform" else within_reach
        points = make(tracks, 2, (640, 480), rng)
    return Case(
        points,
        np.zeros(tracks, dtype=np.int64),
        {"hypothesize.model": model},
        (640, 480),
        CAMERA if model == "translation" else None,
        oracle=0.0,
        factors={"tracks": tracks, "kind of outliers": kind, "model": model},
    )


def from_pixels(plan: Plan) -> Iterator[Outcome]:
    """AdelaideRMF's objects found in the pictures; the labelled matches are judged by them."""
    assert plan.folder is not None
    folder = plan.folder / "adelaidermf" / "motion"
    start = time.process_time()
    for result in run_benchmark("adelaidermf", folder, seeds=plan.seeds.stop, from_pixels=True):
        seconds, start = time.process_time() - start, time.process_time()
        if result.seed in plan.seeds:
            motions = result.motions_true, result.motions_found
            yield judged(_named(result.name), result.seed, "", result.error, motions, seconds)


def static_pictures(plan: Plan) -> Iterator[Outcome]:
    """Two pictures of a static scene; the error is the share of matches in smaller motions."""
    assert plan.folder is not None
    for name in STATIC:
        pictures = [str(path) for path in sorted(plan.folder.glob(f"static/{name}-[12].*"))]
        for seed in plan.seeds:
            start = time.process_time()
            labels = mssegment.segment_pictures(pictures, {"seed": seed}).labels
            seconds = time.process_time() - start
            sizes = np.unique(labels[labels > 0], return_counts=True)[1]
            error = 1 - float(sizes.max(initial=0) / max(sizes.sum(), 1))
            yield judged(_named(name), seed, name, error, (1, len(sizes)), seconds)


def paper(plan: Plan) -> Iterator[Outcome]:
    """The paper's set-ups, as ``benchmarks.paper`` runs them."""
    for name, setup in SETUPS.items():
        for seed in plan.seeds:
            for index in range(plan.scenes):
                start = time.process_time()
                found = run_scene(setup, seed * plan.scenes + index, "mdl", "surface")
                seconds = time.process_time() - start
                true = len(setup.inliers)
                case = replace(_named(name), oracle=found.oracle)
                # the benchmark says only whether the number is right
                motions = true, true if found.count_right else -1
                yield judged(case, seed, name, found.unknown, motions, seconds)


def _named(name: str) -> Case:
    """A case whose tracks are not at hand."""
    return Case(np.zeros((0, 2, 2)), np.zeros(0, dtype=np.int64), name=name)


def _row(
    name: str,
    title: str,
    goals: tuple[str, str],
    cells: Mapping[str, Callable[[Rng], Case | Scene]],
    group: str = "",
) -> Row:
    """A synthetic row."""
    return Row(name, title, *goals, synthetic(name, cells), group=group)


def _adelaidermf(
    name: str,
    title: str,
    goals: tuple[str, str],
    part: str,
    settings: Mapping[str, Any],
    change: Change = unchanged,
) -> Row:
    """A row on the objects (``motion``) or planes (``plane``) of AdelaideRMF."""
    folder = f"adelaidermf/{part}"
    outcomes = published("adelaidermf", folder, settings, change)
    return Row(name, title, *goals, outcomes, needs=folder)


def _pairs(name: str, title: str, goals: tuple[str, str], dataset: str, change: Change) -> Row:
    """A row on two frames of the sequences of a data set."""
    return Row(name, title, *goals, published(dataset, dataset, OBJECTS, change), needs=dataset)


ROWS = (
    _adelaidermf(
        "objects", "AdelaideRMF, objects", ("0.3 %, 10 of 10", "2.5 %, 8 of 9"), "motion", OBJECTS
    ),
    _adelaidermf(
        "planes", "AdelaideRMF, planes", ("2.0 %, 9 of 9", "2.5 %, 7 of 8"), "plane", PLANES
    ),
    Row(
        "pixels",
        "AdelaideRMF, objects from pixels",
        "0.6 %, 10 of 10",
        "3.0 %, 8 of 9",
        from_pixels,
        needs="adelaidermf/motion",
    ),
    _adelaidermf(
        "planes-half",
        "planes, half of the matches",
        ("4 %, 85 %", ""),
        "plane",
        PLANES,
        half_of_the_matches,
    ),
    _adelaidermf(
        "planes-noise", "planes, + 1 px", ("3.5 %, 85 %", ""), "plane", PLANES, with_noise(1.0)
    ),
    Row("static-pictures", "static pairs", "3 of 3", "5 of 5", static_pictures, needs="static"),
    Row("rendered", "rendered pairs", "", "", rendered_pairs),
    _adelaidermf(
        "static-planes",
        "planes as one static scene",
        ("2.5 %, 8 of 9", "3.5 %, 7 of 8"),
        "plane",
        {**PLANES, "segment.granularity": "object"},
        as_one_scene,
    ),
    _pairs(
        "kt3dmoseg-pairs",
        "KT3DMoSeg, frames 1 and 5",
        ("10 %, 65 %", "10 %, 60 %"),
        "kt3dmoseg",
        pair_of_frames(0, 4),
    ),
    _pairs(
        "hopkins-pairs",
        "Hopkins155, first and last frame",
        ("3 %, 90 %", "5 %, 80 %"),
        "hopkins155",
        pair_of_frames(0, -1),
    ),
    _row(
        "moving-camera",
        "a body before depth, moving camera",
        ("98 % right", "95 % right"),
        {"": moving_camera},
        "moving camera",
    ),
    _row("static-scene", "a static scene with depth", ("", ""), {"": static_scene}),
    _row(
        "random",
        "random scenes",
        ("oracle + 4 points, 80 %", "the same"),
        {kind: partial(random_scene, kind) for kind in KINDS},
        "random scenes",
    ),
    _row(
        "noise",
        "noise only",
        ("a motion in <= 1 of 100", "the same"),
        {model: partial(noise_only, model) for model in MODELS},
        "noise only",
    ),
    _row(
        "few",
        "three bodies of few clean matches",
        ("", ""),
        {f"{each} matches": partial(few_matches, each) for each in (5, 8, 12)},
    ),
    _row("exact", "exact data", ("", ""), {"": exact_data}),
    _row(
        "noisy",
        "much noise",
        ("", ""),
        {f"{pixels:g} px": partial(noisy, pixels) for pixels in (1.5, 2.0, 3.0)},
    ),
    _row(
        "large",
        "large coordinates",
        ("", ""),
        {"offset 20 000 px": far_coordinates, "6000 x 4000": large_picture},
    ),
    _row(
        "half-turns",
        "half turns",
        ("", ""),
        {"1 body": partial(half_turn, 1), "2 bodies": partial(half_turn, 2)},
    ),
    Row(
        "paper",
        "the paper's set-ups",
        "1.41 % (98), 0 (100), 0.19 (100)",
        "",
        paper,
    ),
)
"""The rows of the issue on two views, in its order; goals are error and share of right counts."""
