"""The paths of mean shift on the page: those of the kernel and bandwidth of the segmentation."""

from __future__ import annotations

import numpy as np
import pytest

from mssegment.manifolds import Euclidean
from mssegment.meanshift import KERNELS
from mssegment.records import ClusterResult, Floats, HypothesisSet, Mode, Normalization, Tracks
from mssegment.rendering.page.projection import MAX_STEPS, PATH_TOLERANCE, _paths, project
from mssegment.rendering.report import Report, build_report

BANDWIDTH = 0.4


def plane_report(points: Floats, history: list[dict[str, object]]) -> Report:
    """Hypotheses that are points of the plane, with one mode in the origin."""
    count = len(points)
    normalization = Normalization(np.zeros((2, 2)), 1.0)
    subsets = np.zeros((count, 2), dtype=np.int64)
    chosen = HypothesisSet("affine", "euclidean(2)", (0, 1), normalization, subsets, points)
    modes = (Mode(0, count, 0.5, np.zeros(2), 1),)
    assignments = (np.zeros(count, dtype=np.int64),)
    nothing = np.zeros(0, dtype=np.int64)
    found = ClusterResult(nothing, modes, (), (BANDWIDTH,), np.zeros((0, 0)), assignments)
    tracks = Tracks(np.zeros((0, 2, 2)))
    return build_report(
        frames=[], tracks=tracks, sets=[chosen], segmentation=found, history=history
    )


def clustered_with(kernel: str) -> dict[str, object]:
    return {"stage": "cluster", "settings": {"cluster.kernel": kernel, "cluster.bandwidth": "auto"}}


def paths_of(report: Report, count: int = 4) -> list[Floats]:
    points = report.sets[0].points
    return _paths(report, Euclidean(2), 0, np.arange(len(points)), np.arange(count))


@pytest.mark.parametrize("kernel", sorted(KERNELS))
def test_paths_are_those_of_the_kernel_in_the_history(
    kernel: str, rng: np.random.Generator
) -> None:
    points = rng.standard_normal((80, 2))
    earlier = [{"stage": "match"}, clustered_with("gaussian")]
    paths = paths_of(plane_report(points, [*earlier, clustered_with(kernel)]))
    for start, path in zip(points, paths, strict=False):
        x = start
        for place in path:
            np.testing.assert_allclose(place, x, atol=1e-12)
            z = np.sum((points - x) ** 2, axis=1) / BANDWIDTH**2
            weights = KERNELS[kernel].weights(z[None].copy())[0][0]
            x = weights @ points / weights.sum()
        if len(path) <= MAX_STEPS:
            assert np.linalg.norm(path[-1] - path[-2]) <= PATH_TOLERANCE * BANDWIDTH


def test_a_path_ends_where_the_shift_is_too_short_to_see(rng: np.random.Generator) -> None:
    points = 0.01 * rng.standard_normal((50, 2))
    paths = paths_of(plane_report(points, [clustered_with("epanechnikov")]))
    assert {len(path) for path in paths} == {3}
    np.testing.assert_allclose(paths[0][-1], points.mean(axis=0), atol=1e-12)


def test_without_a_history_the_kernel_is_the_default(rng: np.random.Generator) -> None:
    points = rng.standard_normal((80, 2))
    plain = paths_of(plane_report(points, []))
    gaussian = paths_of(plane_report(points, [clustered_with("gaussian")]))
    assert all(np.array_equal(a, b) for a, b in zip(plain, gaussian, strict=True))


def test_an_unknown_kernel_has_no_paths(rng: np.random.Generator) -> None:
    report = plane_report(rng.standard_normal((80, 2)), [clustered_with("sharp")])
    assert paths_of(report) == []
    view = project(report, 0)
    assert view is not None
    assert view.paths == ()
