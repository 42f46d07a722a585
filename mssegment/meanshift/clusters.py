"""From points to ranked modes: the search, by a sample where there are many points."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import numpy as np

from mssegment.meanshift.large import SAMPLE_SIZE, find_by_sample
from mssegment.meanshift.modes import TIE_DECIMALS
from mssegment.meanshift.search import ModeSearch, SearchResult
from mssegment.meanshift.trajectories import Ascent
from mssegment.records import Floats, Integers, State

if TYPE_CHECKING:
    from concurrent.futures import Executor

SAMPLE_ABOVE = 2 * SAMPLE_SIZE
MEMORY_MB = 1000.0


class Clusters(State):
    """The modes of a density, ranked, and which point belongs to which.

    Attributes
    ----------
    modes
        The modes [m, ...], densest first.
    densities
        The kernel densities there [m].
    counts
        The number of trajectories that end at each mode [m].
    labels
        The mode of each point [n], -1 for none.
    sampled
        Whether the trajectories ascended the density of a sample.
    ascent
        The trajectories of the first pass.
    """

    modes: Floats
    densities: Floats
    counts: Integers
    labels: Integers
    sampled: bool
    ascent: Ascent

    def paths(self) -> list[Floats]:
        """Each recorded trajectory [steps, ...] up to its mode.

        A follower continues at its leader's end. Only where the search recorded them, and not with
        a sample.
        """
        paths = self.ascent.paths()
        for i, (leader, label) in enumerate(
            zip(self.ascent.final_leader(), self.labels, strict=True)
        ):
            if leader != i:
                paths[i].append(self.ascent.x[leader])
            if label >= 0:
                paths[i].append(self.modes[label])
        return [np.stack(path) for path in paths]


def find_clusters(
    search: ModeSearch,
    points: Floats,
    rng: np.random.Generator,
    min_count: int = 1,
    sample_above: int | None = SAMPLE_ABOVE,
    memory_mb: float = MEMORY_MB,
) -> Clusters:
    """The modes of the density of the points at which at least ``min_count`` trajectories end.

    Parameters
    ----------
    search
        Manifold, kernel, bandwidth and limits.
    points
        The data points [n, ...].
    rng
        Draws the sample, and directions at saddle points.
    min_count
        Modes at which fewer trajectories end are dropped, and their points labelled -1.
    sample_above
        The number of points above which a sample of 4000 of them makes the density; None for never.
    memory_mb
        With a sample, a bound on the memory used besides the points and the result, in megabytes.

    Returns
    -------
    Clusters
    """
    sampled = (
        sample_above is not None
        and search.point_weights is None
        and len(points) > max(sample_above, SAMPLE_SIZE)
    )
    found = find_by_sample(search, points, rng, memory_mb) if sampled else search.find(points, rng)
    return rank(found, min_count, sampled)


def rank(found: SearchResult, min_count: int, sampled: bool) -> Clusters:
    """Order the modes that enough trajectories reach by density."""
    modes, densities, labels = found.modes, found.densities, found.labels
    counts = np.bincount(labels[labels >= 0], minlength=len(modes))
    kept = np.flatnonzero(counts >= max(1, min_count))
    first = np.full(len(modes) + 1, len(labels))
    np.minimum.at(first, labels, np.arange(len(labels)))
    sums = np.round(densities[kept] * len(labels), TIE_DECIMALS)
    kept = kept[np.lexsort((first[kept], -sums))]
    place = np.full(len(modes) + 1, -1)
    place[kept] = np.arange(len(kept))
    return Clusters(
        modes[kept], densities[kept], counts[kept], place[labels], sampled, found.ascent
    )


def thread_pool(threads: int) -> AbstractContextManager[Executor | None]:
    """A pool of so many threads; none for one."""
    if threads <= 1:
        return nullcontext()
    from concurrent.futures import ThreadPoolExecutor  # loads logging

    return ThreadPoolExecutor(threads)
