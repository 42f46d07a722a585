"""Draw the pictures of docs/why.md: ``python -m docs.pictures_why`` (needs matplotlib)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from benchmarks.unseen_scenes import Spec, generate
from mssegment.geometry.epipolar_fit import compatible_plane, fit_epipolar, mapped_points
from mssegment.records import Floats, Integers
from mssegment.sampling.chimeras import LocalFlats, draw_chimeras, draw_walks
from mssegment.sampling.frame_pairs import draw_for_consensus
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.consensus.coassociation import CoassociationAccumulator
from mssegment.segmentation.consensus.epipolar_evidence import EpipolarEvidence
from mssegment.segmentation.consensus.joinedness import Joinedness
from mssegment.segmentation.consensus.rigid_grouping import APART
from mssegment.segmentation.consensus.split_test import SplitTest
from mssegment.segmentation.consensus.windowed_split import WindowedSplitTest

mpl.rcParams.update({"svg.hashsalt": "mssegment", "font.size": 9, "axes.spines.top": False})
mpl.rcParams.update({"axes.spines.right": False, "axes.spines.left": False})

FOLDER = Path(__file__).parent / "pictures"
FRAMES = 8
SCENES = 60
PERSPECTIVE_SCENES = 30
LEAST_RATIO = 0.02
"""Smaller values of R are drawn here."""
BLUE, ORANGE, GREY, GREEN = "#3b73b9", "#d9772b", "#8a8a8a", "#3d9155"


def main() -> None:
    """Writes null.svg, split.svg, joined.svg and join.svg to docs/pictures."""
    draw_null(FOLDER / "null.svg")
    draw_split(FOLDER / "split.svg")
    draw_joined(FOLDER / "joined.svg")
    draw_join(FOLDER / "join.svg")


def draw_null(path: Path) -> None:
    """Residuals of tracks, of outliers and of both null hypotheses."""
    spec = Spec(FRAMES, (120, 80, 60), outliers=260, noise=0.5)
    scene = generate(spec, np.random.default_rng(1))
    rng = np.random.default_rng(0)
    flats = LocalFlats(scene.points, rng)
    own = flats.own_residuals()
    chimeras = flats.residuals_of(draw_chimeras(scene.points, 500, rng))
    inliers = scene.points[scene.labels > 0]
    of_inliers = LocalFlats(inliers, rng)
    walks = of_inliers.residuals_of(draw_walks(inliers, 500, rng))
    rows = {
        "tracks on an object": (own[scene.labels > 0], BLUE),
        "outliers": (own[scene.labels == 0], ORANGE),
        "chimeras": (chimeras, GREY),
        "random walks": (walks, GREEN),
    }
    edges = np.geomspace(min(own.min(), walks.min()), 1.2 * chimeras.max(), 60)
    figure = Figure(figsize=(6.4, 4.0))
    axes = figure.subplots(len(rows), 1, sharex=True)
    for axis, (name, (values, colour)) in zip(axes, rows.items(), strict=True):
        axis.hist(values, edges.tolist(), color=colour)
        axis.set(xscale="log", yticks=[])
        axis.set_title(name, loc="left", fontsize=9, pad=2)
    axes[-1].set_xlabel("residual from the best local flats (pixels)")
    _save(figure, path)


def draw_split(path: Path) -> None:
    """R between two bodies, and between halves of one body, over random scenes.

    Values below the scale are drawn at its left end.
    """
    apart, together = [], []
    for seed in range(SCENES):
        scene = generate(Spec(FRAMES, (70, 70), noise=0.5), np.random.default_rng([2, seed]))
        agreement = (scene.labels[:, None] == scene.labels).astype(float)
        place = scene.points.mean(axis=1)
        gaps = np.linalg.norm(place[:, None] - place, axis=-1)
        bodies = [np.flatnonzero(scene.labels == label) for label in (1, 2)]
        test = SplitTest(scene.points, agreement, gaps, single=False)
        apart.append(test.ratio(*bodies))
        together += [test.ratio(*halves(body, place)) for body in bodies]
    edges = np.geomspace(0.02, 60, 50)
    figure = Figure(figsize=(6.4, 2.2))
    axis = figure.subplots()
    axis.hist(
        np.clip(together, edges[0], None), edges.tolist(), color=ORANGE, label="halves of one body"
    )
    axis.hist(apart, edges.tolist(), color=BLUE, label="two bodies")
    axis.axvline(1.0, color="black", linewidth=1)
    axis.set(xscale="log", yticks=[], xlabel="R: what a split saves, over what its border costs")
    axis.legend(frameon=False, loc="upper left")
    _save(figure, path)


def draw_joined(path: Path) -> None:
    """R and J of a static scene and a moving body, and of their halves; tracks cut at random."""
    apart: list[tuple[float, float]] = []
    together: list[tuple[float, float]] = []
    spec = Spec(10, (160, 70), noise=0.4, moving_camera=True, visibility="cut")
    for seed in range(PERSPECTIVE_SCENES):
        rng = np.random.default_rng([3, seed])
        scene = generate(spec, rng)
        ratio, joinedness = _evidence(scene.points, scene.labels, rng)
        bodies = [np.flatnonzero(scene.labels == label) for label in (1, 2)]
        place = np.nanmean(scene.points, axis=1)
        for pairs, found in (
            ([bodies], apart),
            ([halves(body, place) for body in bodies], together),
        ):
            for pair in pairs:
                saved = ratio(*pair)
                if saved is not None:
                    found.append((joinedness(*pair), max(saved, LEAST_RATIO)))
    figure = Figure(figsize=(6.4, 3.4))
    axis = figure.subplots()
    axis.plot(*np.transpose(together), "o", color=ORANGE, markersize=4, label="halves of one")
    axis.plot(*np.transpose(apart), "o", color=BLUE, markersize=4, label="scene and body")
    ends = np.array([0.01, 1.0])
    axis.plot(ends, APART * ends, color="black", linewidth=1)
    axis.set(xscale="log", yscale="log", xlabel="J: how joined they look")
    axis.set_ylabel("R: what a split saves, over its price")
    axis.legend(frameon=False, loc="lower left")
    _save(figure, path)


def _evidence(
    points: Floats, labels: Integers, rng: np.random.Generator
) -> tuple[Callable[[Integers, Integers], float | None], Joinedness]:
    """R and J of groups of incomplete tracks, with the noise of the true bodies."""
    drawn = draw_for_consensus(points, rng)
    accumulated = CoassociationAccumulator(len(points))
    for one in drawn.sets:
        observed_set = ObservedSet.of(points, one)
        accumulated.add(observed_set, observed_set.ranking_sq_residuals())
    planar = accumulated.kinds["homography"]
    place = np.nanmean(points, axis=1)
    gaps = np.linalg.norm(place[:, None] - place, axis=-1)
    pairs = sorted({(one.frames[0], one.frames[1]) for one in drawn.sets})
    evidence = EpipolarEvidence(points, pairs)
    evidence.measure_noise([np.flatnonzero(labels == label) for label in np.unique(labels)])
    agreement = np.asarray(planar.mean, dtype=np.float64)
    test = WindowedSplitTest(points, agreement, gaps, single=True)
    return test.ratio, Joinedness(planar, gaps, evidence)


def draw_join(path: Path) -> None:
    """Parallax relative to a plane of the static scene, and the lines through its epipole."""
    spec = Spec(2, (160, 50), noise=0.3, moving_camera=True, speed=25, turn=6)
    scene = generate(spec, np.random.default_rng(2))
    centre = scene.points.mean(axis=(0, 1))
    first, second = (scene.points - centre).transpose(1, 0, 2) / 200.0
    static = scene.labels == 1
    fit = fit_epipolar(first[static], second[static], np.ones(static.sum()), 0.0015)
    plane = compatible_plane(fit.matrix, first[static], second[static], 0.0015)
    place = mapped_points(plane, first)[0] * 200.0 + centre
    shift = second * 200.0 + centre - place
    epipole = np.linalg.svd(fit.matrix)[0][:, 2]
    across = epipole[:2] * 200.0 + epipole[2] * (centre - place)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    figure = Figure(figsize=(6.4, 4.2))
    axes = figure.subplots()
    for tail, along in zip(place[static], across[static], strict=True):
        ends = np.stack([tail - 30 * along, tail + 30 * along])
        axes.plot(*ends.T, color="#d8d8d8", linewidth=0.8, zorder=0)
    for own, colour, name in ((static, BLUE, "static scene"), (~static, ORANGE, "moving body")):
        axes.quiver(
            *place[own].T,
            *shift[own].T,
            color=colour,
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=0.003,
            label=name,
        )
    axes.set(xticks=[], yticks=[], aspect="equal")
    axes.invert_yaxis()
    axes.spines["bottom"].set_visible(False)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", frameon=False)
    _save(figure, path)


def halves(body: Integers, place: Floats) -> tuple[Integers, Integers]:
    """The tracks of a body left and right of its median track."""
    left = place[body, 0] < np.median(place[body, 0])
    return body[left], body[~left]


def _save(figure: Figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, transparent=False, metadata={"Date": None})
    print(path)


if __name__ == "__main__":
    main()
