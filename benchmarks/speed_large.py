"""Many hypotheses: time, memory and agreement of the linear mode.

Each size runs in a process of its own, ``python -m benchmarks.speed_large N``, which prints JSON,
so that the peak memory is its own.
"""

from __future__ import annotations

import json
import math
import resource
import subprocess
import sys
from collections.abc import Iterator

import numpy as np

from benchmarks.speed_estimator import bandwidth_of
from benchmarks.timing import Row, embedded, floor_pass, seconds, three_clusters
from mssegment.manifolds import Grassmann
from mssegment.meanshift import MeanShift

SMALL, LARGE = 16_000, 250_000


def rows() -> Iterator[Row]:
    """16 000 and 250 000 hypotheses on G(10,3) in passes of the floor at n = 4000."""
    small, large = _measure(SMALL), _measure(LARGE)
    yield Row(f"G(10,3) n={SMALL} / floor pass at 4000", small["passes"], 8.0)
    yield Row(f"G(10,3) n={LARGE} / floor pass at 4000", large["passes"], 100.0)
    growth = math.log(large["passes"] / small["passes"]) / math.log(LARGE / SMALL)
    yield Row("growth exponent between the two", growth, 1.1)
    yield Row(
        f"n={SMALL}: adjusted Rand index, cluster members, to exact", small["rand"], 0.995, True
    )
    yield Row(f"n={SMALL}: peak memory, MB", small["memory"], 400.0)
    yield Row(f"n={LARGE}: peak memory, MB", large["memory"], 2000.0)


def _measure(n: int) -> dict[str, float]:
    command = [sys.executable, "-m", "benchmarks.speed_large", str(n)]
    return dict(json.loads(subprocess.run(command, check=True, capture_output=True).stdout))


def measure(n: int) -> dict[str, float]:
    """Passes, peak memory in MB and, at the smaller size, the agreement with the exact mode."""
    manifold = Grassmann(10, 3)
    points, truth = three_clusters(manifold, n)
    found = MeanShift(manifold)

    def cluster() -> None:
        found.set_params(bandwidth=bandwidth_of(manifold, points, 0.5)).fit(points)

    spent = seconds(cluster)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    flat = embedded(three_clusters(manifold, 4000)[0])
    floor = sorted(seconds(lambda: floor_pass(flat, 3, found.bandwidth_)) for _ in range(5))[2]
    figures = {"passes": spent / floor, "memory": memory}
    if n <= SMALL:
        exact = MeanShift(manifold, bandwidth=found.bandwidth_, sample_above=None).fit(points)
        member = truth >= 0
        figures["rand"] = adjusted_rand(found.labels_[member], exact.labels_[member])
    return figures


def adjusted_rand(a: np.ndarray, b: np.ndarray) -> float:
    """The adjusted Rand index of two labellings (Hubert and Arabie, 1985)."""
    _, i = np.unique(a, return_inverse=True)
    _, j = np.unique(b, return_inverse=True)
    table = np.bincount(i * (j.max() + 1) + j).astype(float)

    def pairs(counts: np.ndarray) -> float:
        return float(np.sum(counts * (counts - 1) / 2))

    together, of_a, of_b = pairs(table), pairs(np.bincount(i)), pairs(np.bincount(j))
    chance = of_a * of_b / pairs(np.array([float(len(a))]))
    most = (of_a + of_b) / 2
    return 1.0 if most == chance else (together - chance) / (most - chance)


if __name__ == "__main__":
    print(json.dumps(measure(int(sys.argv[1]))))
