"""The rows on sequences: Hopkins155 and KT3DMoSeg, changed in many ways, noise, random scenes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from benchmarks.unseen_oracle import achievable, affine_body
from benchmarks.unseen_outliers import (
    KINDS,
    independent_paths,
    jitter,
    random_walks,
    shuffled,
    uniform,
)
from benchmarks.unseen_real import (
    SEQUENCES,
    Change,
    cut_at_random,
    first_frames,
    published,
    single_groups,
    thinned_frames,
    unchanged,
)
from benchmarks.unseen_rows import Case, Row, synthetic
from benchmarks.unseen_scenes import PICTURES, Scene, Spec, generate
from mssegment.benchmarking import uniform_mismatches
from mssegment.records import Floats
from tests.moving_bodies import rigid_bodies

Rng = np.random.Generator
LENGTHS = (2, 3, 4, 6, 8, 10, 14, 20)
"""Frames of noise without motion."""
TEST_LENGTHS = (3, 4, 5, 6, 8, 10, 15, 20, 30, 40)
SMALLEST = 8
"""Tracks of the smallest body of the wider scenes."""
MOST_TURNING = 60.0
"""Degrees that a body turns at most over a sequence."""


def number(rng: Rng, low: float, high: float) -> float:
    """A number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def picture_size(rng: Rng) -> tuple[int, int]:
    """Every other picture is 640 x 480, the others smaller or larger."""
    return PICTURES[int(rng.integers(len(PICTURES)))] if rng.random() < 0.5 else PICTURES[0]


def shared_out(tracks: int, bodies: int, least: int, rng: Rng, static: bool) -> tuple[int, ...]:
    """Sizes of bodies, each with ``least`` or more; a static scene has at least two fifths."""
    free = tracks - least * bodies
    shares = rng.dirichlet(np.full(bodies, 2.0))
    if static and bodies > 1:
        shares[0] = max(shares[0], 0.4)
        shares[1:] *= (1 - shares[0]) / shares[1:].sum()
    sizes = least + np.floor(shares * free).astype(int)
    sizes[0] += tracks - sizes.sum()
    return tuple(int(size) for size in sizes)


def random_scene(frames: int, kind: str, rng: Rng) -> Scene:
    """1 to 4 bodies of 25 to 120 tracks, up to 50 % outliers of a kind, noise up to 1 px."""
    bodies, moving = int(rng.integers(1, 5)), bool(rng.random() < 0.4)
    sizes = rng.integers(25, 121, bodies)
    if moving:
        sizes[0] *= 2
    share = rng.uniform(0, 0.5)
    spec = Spec(
        frames,
        tuple(int(size) for size in sizes),
        outliers=int(share / (1 - share) * sizes.sum()),
        kind=kind,
        noise=rng.uniform(0.1, 1.0),
        affine=not moving and bool(rng.random() < 0.3),
        moving_camera=moving,
        speed=rng.uniform(1.5, 5.0),
        turn=min(3.0, MOST_TURNING / frames) * rng.uniform(0, 1),
        picture=picture_size(rng),
    )
    return generate(spec, rng)


def wider_scene(visibility: str, kind: str, rng: Rng) -> Scene:
    """1 to 6 bodies in 20 to 2000 tracks, up to 70 % outliers, noise 0.1 to 2 px, 10 frames.

    No body has fewer than ``SMALLEST`` tracks: there are fewer bodies where tracks are few.
    """
    total, share = int(number(rng, 20, 2000)), rng.uniform(0, 0.7)
    inliers = max(round(total * (1 - share)), SMALLEST)
    bodies = min(int(rng.integers(1, 7)), inliers // SMALLEST)
    moving = bool(rng.random() < 0.4)
    spec = Spec(
        10,
        shared_out(inliers, bodies, SMALLEST, rng, moving),
        outliers=max(total - inliers, 0),
        kind=kind,
        noise=number(rng, 0.1, 2.0),
        affine=not moving and bool(rng.random() < 0.3),
        moving_camera=moving,
        speed=number(rng, 1.0, 6.0),
        turn=rng.uniform(0, 4.0),
        visibility=visibility,
        picture=picture_size(rng),
    )
    return generate(spec, rng)


def two_bodies(frames: int, rng: Rng) -> Scene:
    """Two plain bodies of 60 tracks, noise up to half a pixel, no outliers."""
    noise, affine = rng.uniform(0.1, 0.5), bool(rng.random() < 0.5)
    return generate(Spec(frames, (60, 60), noise=noise, affine=affine), rng)


def body_before_depth(frames: int, rng: Rng) -> Scene:
    """A moving body before a static scene with depth, seen by a moving camera."""
    sizes = int(rng.integers(100, 201)), int(rng.integers(40, 61))
    noise, speed = rng.uniform(0.1, 0.5), rng.uniform(3, 6)
    return generate(Spec(frames, sizes, noise=noise, moving_camera=True, speed=speed), rng)


def large_scene(tracks: int, rng: Rng) -> Scene:
    """Three bodies and a fifth of outliers over 10 frames."""
    body = int(tracks * 0.8 / 3)
    return generate(Spec(10, (body, body, body), outliers=tracks - 3 * body), rng)


def moving_bodies(outliers: float, rng: Rng) -> Case:
    """The scenes of the tests, with so many of all tracks as uniform mismatches."""
    frames, seed = int(rng.choice(TEST_LENGTHS)), int(rng.integers(2**32))
    exact, labels = rigid_bodies(np.random.default_rng(seed), frames=frames, noise=0.0)
    points, _ = rigid_bodies(np.random.default_rng(seed), frames=frames)
    count = round(outliers / (1 - outliers) * len(points))
    wrong = uniform_mismatches(points, count, rng)
    order = rng.permutation(len(points) + count)
    points = np.concatenate([points, wrong])[order]
    truth = np.concatenate([labels, np.zeros(count, dtype=np.int64)])[order]
    bodies = [affine_body(exact[labels == k]) for k in np.unique(labels)]
    oracle = achievable(bodies, points, truth, 0.15)[1]
    factors = {"frames": frames, "outliers": outliers}
    return Case(points, truth, frame_size=(640, 480), oracle=oracle, factors=factors)


def noise_only(make: Callable[[int, int, Rng], Floats], most: int, least: int, rng: Rng) -> Case:
    """Tracks of noise over ``least`` or more frames, in which ``most`` motions may be found."""
    frames = int(rng.choice([length for length in LENGTHS if length >= least]))
    tracks = int(number(rng, 50, 1000))
    points = make(tracks, frames, rng)
    return Case(
        points,
        np.zeros(len(points), dtype=np.int64),
        frame_size=(640, 480),
        counts=(0, most),
        oracle=0.0,
        factors={"frames": frames, "tracks": tracks},
    )


def _uniform(tracks: int, frames: int, rng: Rng) -> Floats:
    return uniform(tracks, frames, (640, 480), rng)


def _jitter(tracks: int, frames: int, rng: Rng) -> Floats:
    return jitter(tracks, frames, (640, 480), rng)


def _walks(tracks: int, frames: int, rng: Rng) -> Floats:
    return random_walks(tracks, frames, (640, 480), number(rng, 1, 10), rng)


def _paths(tracks: int, frames: int, rng: Rng) -> Floats:
    noise = rng.normal(0, number(rng, 0.1, 1.0), (tracks, frames, 2))
    return independent_paths(tracks, frames, (640, 480), number(rng, 1, 10), rng) + noise


def _shuffled(tracks: int, frames: int, rng: Rng) -> Floats:
    """The tracks of moving bodies in another order in time."""
    size = max(tracks // 3, 10)
    scene = generate(Spec(frames, (size, size, size), noise=0.0), rng)
    return shuffled(scene.exact, tracks, rng) + rng.normal(0, 0.5, (tracks, frames, 2))


def _row(
    name: str,
    title: str,
    goals: tuple[str, str],
    cells: Mapping[str, Callable[[Rng], Case | Scene]],
    group: str = "",
) -> Row:
    """A synthetic row."""
    return Row(name, title, *goals, synthetic(name, cells), group=group)


def _hopkins(
    name: str,
    title: str,
    goals: tuple[str, str],
    settings: Mapping[str, Any] | None = None,
    change: Change = unchanged,
    **options: Any,
) -> Row:
    """A row on Hopkins155; ``options`` are those of ``published``."""
    settings = {**SEQUENCES, **(settings or {})}
    outcomes = published("hopkins155", "hopkins155", settings, change, **options)
    return Row(name, title, *goals, outcomes, needs="hopkins155")


def _kt3dmoseg(name: str, title: str, goals: tuple[str, str], given: bool) -> Row:
    """A row on KT3DMoSeg."""
    outcomes = published("kt3dmoseg", "kt3dmoseg", SEQUENCES, given=given)
    return Row(name, title, *goals, outcomes, needs="kt3dmoseg")


NO_MOTION = "a motion in <= 1 of 100"
ROWS = (
    _hopkins("hopkins-given", "Hopkins155, count given", ("0.12 %", "0.2 %"), given=True),
    _hopkins("hopkins-unknown", "Hopkins155, one motion allowed", ("0.7 %, 96 %", "1.8 %, 93 %")),
    _hopkins(
        "hopkins-two",
        "Hopkins155, at least two motions",
        ("0.4 %, 98 %", "1.0 %, 95 %"),
        {"segment.min_motions": 2},
    ),
    Row(
        "hopkins-single",
        "Hopkins155, single groups",
        "93 %",
        "90 %",
        single_groups("hopkins155"),
        needs="hopkins155",
    ),
    _hopkins(
        "hopkins-outliers-10",
        "+ 10 % outlier tracks, given",
        ("0.3 %", "0.5 %"),
        given=True,
        outliers=0.1,
    ),
    _hopkins(
        "hopkins-outliers-20",
        "+ 20 % outlier tracks, given",
        ("0.4 %", "0.9 %"),
        given=True,
        outliers=0.2,
    ),
    _hopkins("hopkins-first-3", "first 3 frames", ("4 %", "5 %"), change=first_frames(3)),
    _hopkins("hopkins-first-8", "first 8 frames", ("1.5 %", "3 %"), change=first_frames(8)),
    _hopkins("hopkins-thinned", "thinned to 5 frames", ("4 %", "5 %"), change=thinned_frames(5)),
    _kt3dmoseg("kt3dmoseg-given", "KT3DMoSeg, count given", ("2.2 %", "1.0 %"), True),
    _kt3dmoseg(
        "kt3dmoseg-unknown", "KT3DMoSeg, count unknown", ("5.0 %, 75 %", "2.0 %, 85 %"), False
    ),
    _hopkins(
        "hopkins-cut-given",
        "Hopkins155, tracks cut at random, given",
        ("0.4 %", "0.5 %"),
        change=cut_at_random,
        given=True,
    ),
    _hopkins(
        "hopkins-cut-unknown",
        "Hopkins155, tracks cut at random",
        ("3.5 %, 85 %", "4.5 %, 80 %"),
        change=cut_at_random,
    ),
    _row(
        "noise-uniform",
        "noise only: uniform",
        (NO_MOTION, NO_MOTION),
        {"": partial(noise_only, _uniform, 0, 2)},
        "noise: uniform",
    ),
    _row(
        "noise-jitter",
        "noise only: +-30 px about fixed places",
        ("at most one motion", "at most one motion"),
        {"": partial(noise_only, _jitter, 1, 2)},
        "noise: jitter",
    ),
    _row(
        "noise-walks",
        "noise only: random walks",
        ("no motion", "no motion"),
        {"": partial(noise_only, _walks, 0, 2)},
        "noise: random walks",
    ),
    _row(
        "noise-paths",
        "noise only: independent smooth paths",
        ("no motion", "no motion"),
        {"": partial(noise_only, _paths, 0, 3)},
        "noise: independent paths",
    ),
    _row(
        "noise-shuffled",
        "noise only: tracks shuffled in time",
        ("", ""),
        {"": partial(noise_only, _shuffled, 0, 3)},
        "noise: shuffled in time",
    ),
    _row(
        "two-bodies",
        "two bodies of 60 tracks",
        ("99 % right", "98 % right"),
        {f"{n} frames": partial(two_bodies, n) for n in (6, 8, 10, 20)},
    ),
    _row(
        "body-before-depth",
        "a body before depth, moving camera",
        ("97 % right", "95 % right"),
        {f"{n} frames": partial(body_before_depth, n) for n in (3, 4, 5, 6)},
    ),
    *(
        _row(
            f"random-{n}",
            f"random scenes, {n} frames",
            ("1 %, 98 %", f"{unseen} %, 97 %"),
            {kind: partial(random_scene, n, kind) for kind in KINDS},
            "random scenes",
        )
        for n, unseen in ((6, 2), (10, 2), (20, 1))
    ),
    _row(
        "wider",
        "wider scenes",
        ("oracle + 4 points", "oracle + 5 points"),
        {kind: partial(wider_scene, "complete", kind) for kind in KINDS},
        "wider scenes",
    ),
    _row(
        "wider-incomplete",
        "wider scenes, incomplete tracks",
        ("", ""),
        {
            f"{visibility}, {kind}": partial(wider_scene, visibility, kind)
            for visibility in ("cut", "leaving")
            for kind in KINDS
        },
        "wider scenes",
    ),
    _row(
        "moving-bodies",
        "the tests' bodies, 3-40 frames, mismatches",
        ("", ""),
        {f"{share:.0%}": partial(moving_bodies, share) for share in (0.0, 0.3, 0.5, 0.7)},
        "the tests' bodies",
    ),
    Row(
        "large",
        "seconds of CPU for many tracks",
        "no worse than before",
        "",
        synthetic("large", {f"{n} tracks": partial(large_scene, n) for n in (2000, 30_000)}, 3),
    ),
)
"""The rows of the issue on sequences, in its order; goals are error and share of right counts."""
