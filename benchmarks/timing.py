"""Ratios measured side by side: what the speed benchmarks share."""

from __future__ import annotations

import os

# Two threads make these small products slower, so every benchmark runs with one.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.records import Floats

Work = Callable[[], object]


@dataclass(frozen=True)
class Row:
    """One figure of the table: a ratio and its goal (an upper bound, or with ``more`` a lower).

    ``ratio`` is None where the row was skipped; ``note`` says why, or what was measured.
    """

    name: str
    ratio: float | None
    goal: float
    more: bool = False
    note: str = ""

    @property
    def holds(self) -> bool | None:
        """Whether the goal is reached; None where the row was skipped."""
        if self.ratio is None:
            return None
        return self.ratio >= self.goal if self.more else self.ratio <= self.goal


Rows = Callable[[], Iterator[Row]]


def seconds(work: Work) -> float:
    """CPU seconds of ``work`` in this process: another program's load does not count."""
    start = time.process_time()
    work()
    return time.process_time() - start


def ratio(work: Work, yardstick: Work, repeats: int = 5) -> float:
    """Median CPU time of ``work`` over that of ``yardstick``, in interleaved runs."""
    work()
    pairs = [(seconds(work), seconds(yardstick)) for _ in range(repeats)]
    return statistics.median(a for a, _ in pairs) / statistics.median(b for _, b in pairs)


def command_seconds(arguments: Sequence[str], repeats: int = 3) -> float:
    """Median CPU seconds of a whole process ``python *arguments``."""
    spent = []
    for _ in range(repeats):
        before = os.times()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        after = os.times()
        spent.append(after.children_user + after.children_system)
        spent[-1] -= before.children_user + before.children_system
    return statistics.median(spent)


def three_clusters(
    manifold: Manifold, n: int, seed: int = 1, spread: float = 0.05
) -> tuple[Floats, np.ndarray]:
    """Hypotheses like those of a real run: three clusters and 40 % scattered; labels, -1 these."""
    rng = np.random.default_rng(seed)
    centres = manifold.random_point(rng, 3)
    label = rng.integers(0, 3, int(0.6 * n))
    x = centres[label]
    tangent = manifold.project_tangent(x, spread * rng.standard_normal(x.shape))
    scattered = manifold.random_point(rng, n - len(x))
    points = np.concatenate([manifold.exp(x, tangent), scattered])
    return points, np.concatenate([label, np.full(len(scattered), -1)])


def embedded(points: Floats) -> Floats:
    """Subspaces [n, N, k] as the upper triangles of their projectors, sqrt 2 off the diagonal."""
    projectors = points @ np.swapaxes(points, 1, 2)
    above = np.triu_indices(points.shape[1])
    return np.asarray(projectors[:, *above] * np.where(above[0] == above[1], 1.0, np.sqrt(2.0)))


def floor_pass(flat: Floats, k: int, bandwidth: float, rows: int = 128) -> Floats:
    """One blocked n x n pass in double precision: product, exponential, product, nothing else."""
    columns = np.ascontiguousarray(flat.T / bandwidth**2)
    sums = np.empty_like(flat)
    for start in range(0, len(flat), rows):
        weights = flat[start : start + rows] @ columns
        np.subtract(weights, k / bandwidth**2, out=weights)
        np.exp(weights, out=weights)
        sums[start : start + rows] = weights @ flat
    return sums
