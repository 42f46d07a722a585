"""The estimator against other programs, and against the paper's algorithm as it stands."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from functools import partial

import numpy as np
from scipy.linalg import expm, logm

from benchmarks.speed_estimator import bandwidth_of
from benchmarks.timing import Row, embedded, seconds, three_clusters
from mssegment.manifolds import AffineGroup, Grassmann, Manifold
from mssegment.meanshift import MeanShift, mean_shift_to_convergence
from mssegment.records import Floats


def rows() -> Iterator[Row]:
    """Each peer, or why it was skipped."""
    yield scikit_learn()
    yield geomstats()
    yield literal_grassmann()
    yield literal_affine()


def _ours(manifold: Manifold, points: Floats) -> tuple[MeanShift, float]:
    estimator = MeanShift(manifold, bandwidth_of(manifold, points, 0.5)).fit(points)
    return estimator, min(seconds(partial(estimator.fit, points)) for _ in range(5))


def scikit_learn(goal: float = 300.0) -> Row:
    """sklearn's MeanShift (a flat kernel) on the embedded points, with its defaults.

    That is every point a seed (no binning), at most 300 iterations, one job.
    """
    name = "sklearn.cluster.MeanShift, G(10,3) n=1000 / ours"
    if importlib.util.find_spec("sklearn") is None:
        return Row(name, None, goal, True, "scikit-learn is not installed: pip install .[bench]")
    from sklearn.cluster import MeanShift as Peer

    points, _ = three_clusters(Grassmann(10, 3), 1000)
    estimator, ours = _ours(Grassmann(10, 3), points)
    flat = embedded(points)
    # The radius at which a flat kernel finds the clusters: the neighbour distance, not half of it.
    radius = np.sqrt(2.0) * estimator.bandwidth_ / 0.5
    peer = Peer(bandwidth=radius)
    theirs = seconds(partial(peer.fit, flat))
    note = f"{theirs:.2f} s / {ours:.4f} s; flat kernel of radius {radius:.2f}, "
    note += f"{peer.n_iter_} iterations at most"
    return Row(name, theirs / ours, goal, True, note)


def geomstats(goal: float = 3000.0) -> Row:
    """geomstats' RiemannianMeanShift on G(3,1), as many starts as points, drawn from them."""
    name = "geomstats RiemannianMeanShift, G(3,1) n=60 / ours"
    if importlib.util.find_spec("geomstats") is None:
        return Row(name, None, goal, True, "geomstats is not installed (it needs numpy < 2.4)")
    from geomstats.geometry.grassmannian import Grassmannian
    from geomstats.learning.riemannian_mean_shift import RiemannianMeanShift

    points, _ = three_clusters(Grassmann(3, 1), 60)
    estimator, ours = _ours(Grassmann(3, 1), points)
    peer = RiemannianMeanShift(
        Grassmannian(3, 1), bandwidth=estimator.bandwidth_, n_clusters=len(points)
    )
    theirs = seconds(partial(peer.fit, points @ np.swapaxes(points, 1, 2)))
    note = f"{theirs:.1f} s / {ours:.4f} s; flat kernel of radius {estimator.bandwidth_:.3f}"
    return Row(name, theirs / ours, goal, True, note)


def literal_grassmann(goal: float = 100.0, starts: int = 2) -> Row:
    """A loop per start and point, an SVD per step; a few starts, extrapolated to all."""
    manifold = Grassmann(10, 3)
    points, _ = three_clusters(manifold, 1000)
    estimator, ours = _ours(manifold, points)

    def paper() -> None:
        for start in points[:starts]:
            x, h = start, estimator.bandwidth_
            for _ in range(1000):
                total, weights = np.zeros_like(x), 0.0
                for y in points:
                    w = np.exp(-(3 - np.trace(x.T @ y @ y.T @ x)) / (2 * h * h))
                    total += w * (y @ y.T @ x - x @ x.T @ y @ y.T @ x)
                    weights += w
                step = total / weights
                u, s, v = np.linalg.svd(step, full_matrices=False)
                x = x @ v.T @ np.diag(np.cos(s)) @ v + u @ np.diag(np.sin(s)) @ v
                if np.linalg.norm(step) < 1e-4 * h:
                    break

    theirs = seconds(paper) * len(points) / starts
    name = "the paper's algorithm as it stands, G(10,3) n=1000 / ours"
    return Row(name, theirs / ours, goal, True, f"extrapolated from {starts} starts")


def literal_affine(goal: float = 1e4, pairs: int = 100) -> Row:
    """scipy's logm for every pair and step; some pairs, extrapolated by the plain step count."""
    manifold = AffineGroup()
    points, _ = three_clusters(manifold, 500)
    estimator, ours = _ours(manifold, points)
    steps = _plain_steps(manifold, points, estimator.bandwidth_)

    def paper() -> None:
        inverse = np.linalg.inv(points[0])
        for y in points[:pairs]:
            logm(inverse @ y)
        expm(points[0])

    theirs = seconds(paper) / pairs * len(points) * steps
    name = "the paper's algorithm as it stands, A(2) n=500, scipy logm / ours"
    return Row(name, theirs / ours, goal, True, f"{pairs} pairs, extrapolated to {steps} steps")


def _plain_steps(manifold: Manifold, points: Floats, bandwidth: float) -> int:
    """How many steps all plain trajectories take together."""
    counted = 0

    class Counting(type(manifold)):  # type: ignore[misc]
        def exp(self, x: Floats, v: Floats) -> Floats:
            nonlocal counted
            counted += len(x)
            return np.asarray(super().exp(x, v))

    mean_shift_to_convergence(Counting(), points, bandwidth, tolerance=1e-4)
    return counted
