"""Mean shift clustering over any manifold, with scikit-learn's conventions."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import numpy as np

from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import Manifold, from_name
from mssegment.meanshift.ascent import Ascent
from mssegment.meanshift.bandwidth import nearest_neighbour_bandwidth
from mssegment.meanshift.kernels import kernel_named
from mssegment.meanshift.large import SAMPLE, find_by_sample
from mssegment.meanshift.search import Found, Search
from mssegment.records import Floats, Integers

if TYPE_CHECKING:
    from concurrent.futures import Executor


class MeanShift:
    """Finds the modes of the kernel density (7) of points on a manifold.

    Parameters
    ----------
    manifold: a manifold or its name, such as ``"grassmann(10,3)"``.
    bandwidth: h in the manifold's distance, or ``"auto"``: ``bandwidth_constant`` times the
        median distance to the (0.05 n)-th nearest neighbour.
    kernel: ``"gaussian"``, ``"truncated"`` or ``"epanechnikov"``.
    merge_within: modes nearer than this many bandwidths are one.
    min_count: modes that fewer trajectories reach are left out, their points labelled -1.
    max_iterations: a trajectory stops after so many steps at the latest.
    sample_above: more points than this climb the density of a sample of 4000 of them, at a cost
        that grows linearly; what is far from the sample is labelled -1.
    memory_mb: bounds the memory used then, besides the points and the result.
    threads: blocks of rows are spread over so many threads. The matrix products themselves must
        run on one (``OPENBLAS_NUM_THREADS=1``): they are small, and several BLAS threads make them
        4-12 times slower. The result is the same with any number.
    record: keep every trajectory in ``trajectories_`` (for plotting; not with a sample).

    Attributes after ``fit``
    ------------------------
    modes_ [m, ...], densest first; ``densities_`` [m] kernel density (7) at each without its
    constant c_{k,h}; ``counts_`` [m] trajectories that end there; ``labels_`` [n] the mode of each
    point, -1 for what belongs nowhere; ``bandwidth_``; ``n_iter_``; ``trajectories_``, a list of n
    arrays [steps, ...], where asked for.
    """

    modes_: Floats
    densities_: Floats
    counts_: Integers
    labels_: Integers
    bandwidth_: float
    n_iter_: int
    trajectories_: list[Floats] | None

    def __init__(
        self,
        manifold: Manifold | str,
        bandwidth: float | str = "auto",
        kernel: str = "gaussian",
        *,
        bandwidth_constant: float = 0.5,
        merge_within: float = 1.0,
        min_count: int = 1,
        max_iterations: int = 500,
        sample_above: int = 2 * SAMPLE,
        memory_mb: float = 1000.0,
        threads: int = 1,
        record: bool = False,
    ) -> None:
        self.manifold = from_name(manifold) if isinstance(manifold, str) else manifold
        self.bandwidth = bandwidth
        self.kernel = kernel
        self.bandwidth_constant = bandwidth_constant
        self.merge_within = merge_within
        self.min_count = min_count
        self.max_iterations = max_iterations
        self.sample_above = max(sample_above, SAMPLE)
        self.memory_mb = memory_mb
        self.threads = threads
        self.record = record

    def fit(self, points: Floats, rng: np.random.Generator | None = None) -> MeanShift:
        """Cluster ``points`` [n, ...] on the manifold.

        ``rng`` (a fixed seed by default) draws the sample for the bandwidth and the perturbations.
        Raises DataError for no points or arrays that are not points, ConfigurationError for a
        bandwidth that is not positive or an unknown kernel.
        """
        rng = np.random.default_rng(0) if rng is None else rng
        points = np.asarray(points, dtype=np.float64)
        if len(points) == 0:
            raise DataError("mean shift needs at least 1 hypothesis, found none")
        self.manifold.check_point(points)
        self.bandwidth_ = self._choose_bandwidth(points, rng)
        with _pool(self.threads) as pool:
            search = Search(
                self.manifold,
                kernel_named(self.kernel),
                self.bandwidth_,
                self.merge_within,
                self.max_iterations,
                self.record,
                pool,
            )
            if len(points) > self.sample_above:
                found = find_by_sample(search, points, rng, self.memory_mb)
            else:
                found = search.find(points, rng)
        self.n_iter_ = found.way.iterations
        self._rank(found)
        self.trajectories_ = None
        if self.record and len(points) <= self.sample_above:
            self.trajectories_ = self._paths(found.way)
        return self

    def fit_predict(self, points: Floats, rng: np.random.Generator | None = None) -> Integers:
        """``fit``, then ``labels_``."""
        return self.fit(points, rng).labels_

    def _choose_bandwidth(self, points: Floats, rng: np.random.Generator) -> float:
        if self.bandwidth == "auto":
            return nearest_neighbour_bandwidth(self.manifold, points, rng, self.bandwidth_constant)
        if isinstance(self.bandwidth, str) or not 0 < self.bandwidth < np.inf:
            raise ConfigurationError(
                f"the bandwidth must be 'auto' or a positive number, found {self.bandwidth!r}"
            )
        return float(self.bandwidth)

    def _rank(self, found: Found) -> None:
        """Keep the modes that enough trajectories reach, densest first."""
        modes, densities, labels = found.modes, found.densities, found.labels
        counts = np.bincount(labels[labels >= 0], minlength=len(modes))
        kept = np.flatnonzero(counts >= max(1, self.min_count))
        kept = kept[np.argsort(-densities[kept], kind="stable")]
        place = np.full(len(modes) + 1, -1)
        place[kept] = np.arange(len(kept))
        self.modes_, self.densities_, self.counts_ = modes[kept], densities[kept], counts[kept]
        self.labels_ = place[labels]

    def _paths(self, way: Ascent) -> list[Floats]:
        """Each trajectory [steps, ...]; it ends at its mode, a follower via its leaders."""
        paths: list[list[Floats]] = [[] for _ in way.x]
        for moving, x in way.history or []:
            for i, place in zip(moving, x, strict=True):
                paths[i].append(place)
        for i, (last, label) in enumerate(zip(way.last_leader(), self.labels_, strict=True)):
            if last != i:
                paths[i].append(way.x[last])
            if label >= 0:
                paths[i].append(self.modes_[label])
        return [np.stack(path) for path in paths]


def _pool(threads: int) -> AbstractContextManager[Executor | None]:
    if threads <= 1:
        return nullcontext()
    from concurrent.futures import ThreadPoolExecutor  # loads logging

    return ThreadPoolExecutor(threads)
