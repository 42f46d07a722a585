"""The estimator against one n x n pass, and its agreement with the plain algorithm."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from benchmarks.data import sequence_subspaces
from benchmarks.timing import Row, Work, embedded, floor_pass, ratio, three_clusters
from mssegment.manifolds import AffineGroup, Grassmann, Manifold
from mssegment.meanshift import MeanShift, mean_shift_to_convergence, nearest_neighbour_bandwidth
from mssegment.records import Floats


def rows() -> Iterator[Row]:
    """Grassmann manifolds against the floor, A(2) against a pass of closed-form logarithms."""
    for constant, goal in ((0.25, 2.0), (0.5, 3.0), (1.0, 4.0)):
        yield from grassmann(Grassmann(10, 3), 4000, constant, goal)
    yield from grassmann(Grassmann(3, 1), 500, 0.5, 5.0)
    yield from grassmann(Grassmann(10, 3), 1000, 0.5, 4.0)
    real = sequence_subspaces(13, 4, 360)
    if real is None:
        yield Row("G(13,4) n=360 / floor pass", None, 10.0, note="no Hopkins155 data")
    else:
        yield from grassmann(Grassmann(13, 4), 360, 0.5, 10.0, real)
    yield from affine(500, 4.0)
    yield from affine(2000, 2.5)


def grassmann(
    manifold: Grassmann, n: int, constant: float, goal: float, points: Floats | None = None
) -> Iterator[Row]:
    """The whole clustering over one pass, and the agreement."""
    points = three_clusters(manifold, n)[0] if points is None else points
    bandwidth = bandwidth_of(manifold, points, constant)
    estimator = MeanShift(manifold, bandwidth)
    one_pass = partial(floor_pass, embedded(points), manifold.k, bandwidth)
    name = f"G({manifold.n},{manifold.k}) n={n} c={constant}"
    yield from _against(name, estimator, points, "floor pass", one_pass, goal)


def affine(n: int, goal: float, constant: float = 0.5) -> Iterator[Row]:
    """A(2): the whole clustering over all n x n closed-form logarithms once."""
    manifold = AffineGroup()
    points = three_clusters(manifold, n)[0]
    estimator = MeanShift(manifold, bandwidth_of(manifold, points, constant))
    logs = partial(all_logarithms, manifold, points)
    yield from _against(f"A(2) n={n} c={constant}", estimator, points, "pass of logs", logs, goal)


def bandwidth_of(manifold: Manifold, points: Floats, constant: float) -> float:
    """The bandwidth of the paper's rule, with another constant."""
    return nearest_neighbour_bandwidth(manifold, points, np.random.default_rng(0), constant)


def all_logarithms(manifold: Manifold, points: Floats) -> None:
    """Every logarithm between two of the points, in blocks."""
    prepared = manifold.prepare(points)
    for start in range(0, len(points), prepared.block_rows):
        prepared.block(points[start : start + prepared.block_rows])


def _against(
    name: str, estimator: MeanShift, points: Floats, unit: str, one_pass: Work, goal: float
) -> Iterator[Row]:
    yield Row(f"{name} / {unit}", ratio(partial(estimator.fit, points), one_pass), goal)
    moved, off = agreement(estimator.fit(points), points)
    yield Row(f"{name}: share of points in another mode than plainly", moved, 0.01)
    yield Row(f"{name}: largest distance of a mode, in bandwidths", off, 0.01)


def agreement(found: MeanShift, points: Floats) -> tuple[float, float]:
    """The share of points whose mode differs from the plain algorithm's, and how far modes are.

    A mode differs when it is further than half a bandwidth from where the plain trajectory ends;
    the distance is the largest over the others, in bandwidths.
    """
    ends, _ = mean_shift_to_convergence(found.manifold_, points, found.bandwidth_)
    away = found.manifold_.dist(found.modes_[found.labels_], ends) / found.bandwidth_
    other = away > 0.5
    return float(np.mean(other)), float(np.max(away[~other], initial=0.0))
