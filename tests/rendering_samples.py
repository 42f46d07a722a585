"""Reports made by hand for the tests of rendering: two motions on a grey picture, no pipeline."""

from __future__ import annotations

import numpy as np

from mssegment.models import make
from mssegment.records import ClusterResult, Frame, HypothesisSet, Mode, Motion, Tracks
from mssegment.rendering.report import Report, build_report

WIDTH, HEIGHT = 320, 240


def picture(index: int) -> np.ndarray:
    """A grey picture with one bright square, so that a mark on it can be found."""
    image = np.full((HEIGHT, WIDTH, 3), 90, dtype=np.uint8)
    image[60:120, 40:120] = 200
    image[100:200, 200:280] = 160
    return image


def affine_report(
    *, frames: int = 2, tracks: int = 60, truth: bool = True, errors: int = 0, **extra
) -> Report:
    """Two bodies that shift by (12, 4) and (-9, 6), some outliers, one background track.

    The true labels are those found but for the first ``errors`` tracks.
    """
    rng = np.random.default_rng(5)
    labels = np.array([1] * (tracks // 2) + [2] * (tracks // 3))
    labels = np.concatenate([labels, np.zeros(tracks - len(labels), dtype=np.int64)])
    start = np.where(
        (labels == 1)[:, None],
        rng.uniform([42, 62], [118, 118], (tracks, 2)),
        rng.uniform([202, 102], [278, 198], (tracks, 2)),
    )
    step = np.array([[0.0, 0.0], [12.0, 4.0], [-9.0, 6.0]])[labels]
    step[labels == 0] = rng.uniform(-30, 30, ((labels == 0).sum(), 2))
    times = np.arange(frames) / max(1, frames - 1)
    points = start[:, None] + times[:, None] * step[:, None]
    points += rng.normal(0, 0.2, points.shape)
    model = make("affine")
    ends = points[:, [0, -1]]
    normalization = model.normalization(ends, None)
    observed = model.observe(ends, normalization)
    weights = np.array([labels == 1, labels == 2], dtype=np.float64)
    parameters, _ = model.fit(observed, weights)
    residuals = model.residuals(parameters, observed, normalization)
    subsets = np.concatenate(
        [rng.choice(np.flatnonzero(labels == k), (20, 3)) for k in (1, 2)]
        + [rng.integers(0, tracks, (10, 3))]
    )
    hypotheses, valid = model.minimal_fit(observed[subsets])
    valid &= np.isfinite(hypotheses).all(axis=(1, 2))
    hypotheses, subsets = hypotheses[valid], subsets[valid]
    assignment = np.argmin(model.manifold.pairwise_dist2(parameters, hypotheses), axis=0)
    found = labels.copy()
    found[-1] = -1
    motions = tuple(
        Motion(
            label=k + 1,
            set_index=0,
            model="affine",
            parameters=parameters[k],
            inliers=np.flatnonzero(found == k + 1),
            scale=0.3,
            rms=0.25 + k,
            cost_saved=200.0 - k,
        )
        for k in range(2)
    )
    modes = (
        Mode(0, 24, 0.06, parameters[0], 1),
        Mode(0, 19, 0.031, parameters[1], 2),
        Mode(0, 5, 0.004, hypotheses[-1], 0),
    )
    true_labels = np.where(np.arange(tracks) < errors, 2, labels)
    return build_report(
        frames=[Frame(f"{i + 1}.png", WIDTH, HEIGHT) for i in range(frames)],
        tracks=Tracks(points),
        sets=[
            HypothesisSet(
                "affine",
                model.manifold.name,
                (0, frames - 1),
                normalization,
                subsets,
                hypotheses,
                80,
            )
        ],
        segmentation=ClusterResult(
            found, modes, motions, (0.2,), residuals, (assignment,), ("the camera moves",)
        ),
        **{"pictures": picture, "truth": true_labels if truth else None, **extra},
    )


def many_tracks(*, tracks: int, frames: int, width: int = 1242, height: int = 375) -> Report:
    """Five motions without hypotheses on noisy pictures: as heavy as a long video."""
    rng = np.random.default_rng(7)
    labels = rng.integers(0, 6, tracks)
    drift = rng.normal(0, 3, (6, 2))[labels][:, None] + rng.normal(0, 0.5, (tracks, frames, 2))
    points = rng.uniform([0, 0], [width, height], (tracks, 2))[:, None] + np.cumsum(drift, axis=1)
    points[rng.random((tracks, frames)) < 0.1] = np.nan
    base = np.kron(rng.integers(40, 220, (height // 5, width // 6, 3)), np.ones((5, 6, 1)))
    canvas = np.zeros((height, width, 3))
    canvas[: base.shape[0], : base.shape[1]] = base
    grain = np.random.default_rng(8).normal(0, 12, (height, width, 1))
    motions = tuple(
        Motion(k, 0, "factorization", np.eye(3), np.flatnonzero(labels == k), 1.0, 1.0)
        for k in range(1, 6)
    )
    modes = tuple(Mode(0, 10, 0.1 / k, np.eye(3), k) for k in range(1, 6))
    return build_report(
        frames=[Frame(f"{i:06d}.png", width, height) for i in range(frames)],
        tracks=Tracks(points),
        sets=[],
        segmentation=ClusterResult(
            labels, modes, motions, (), rng.lognormal(0, 2, (5, tracks)), (), ()
        ),
        pictures=lambda i: np.clip(canvas + np.roll(grain, 7 * i, axis=1), 0, 255).astype(np.uint8),
    )


def crowd(*, motions: int = 14, tracks: int = 900) -> Report:
    """Many motions in clusters, some of them over each other, in two frames of one video."""
    rng = np.random.default_rng(7)
    labels = rng.integers(0, motions + 1, tracks)
    labels[rng.random(tracks) < 0.05] = -1
    moving = np.maximum(labels, 0)
    start = rng.uniform([100, 80], [1100, 600], (motions + 1, 2))[moving]
    start = start + rng.normal(0, 25, (tracks, 2))
    start[labels <= 0] = rng.uniform(0, [1200, 700], ((labels <= 0).sum(), 2))
    end = start + rng.normal(0, 12, (motions + 1, 2))[moving]
    found = tuple(
        Motion(k, 0, "affine", np.eye(3), np.flatnonzero(labels == k), 1.0, 1.0)
        for k in range(1, motions + 1)
    )
    name = "a-long-folder/some_recording_2024_11_30_with_a_long_name.mp4"
    return build_report(
        frames=[Frame(name, 1200, 700, "ab" * 32, i) for i in range(2)],
        tracks=Tracks(np.stack([start, end], axis=1)),
        sets=[],
        segmentation=ClusterResult(
            labels,
            tuple(Mode(0, 10, 0.1 / k, np.eye(3), k) for k in range(1, motions + 1)),
            found,
            (),
            rng.lognormal(0, 2, (motions, tracks)),
        ),
        truth=np.where(labels < 0, -3, labels),
        pictures=lambda i: np.full((700, 1200, 3), 150, dtype=np.uint8),
        history=[{"stage": "cluster", "version": "1", "settings": {"cluster.bandwidth": "auto"}}],
    )
