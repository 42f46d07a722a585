"""Mean shift clustering over any manifold: the estimator.

It borrows names from scikit-learn (``fit``, ``fit_predict``, ``labels_``) but is not a scikit-learn
estimator: it has neither ``get_params`` nor ``predict``, the constructor replaces a manifold's name
by the manifold, and the random generator is an argument of ``fit``.
"""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING

import numpy as np

from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import Manifold, from_name
from mssegment.meanshift.ascent import Ascent
from mssegment.meanshift.bandwidth import nearest_neighbour_bandwidth
from mssegment.meanshift.kernels import kernel_named
from mssegment.meanshift.large import SAMPLE_SIZE, find_by_sample
from mssegment.meanshift.search import ModeSearch, SearchResult
from mssegment.records import Floats, Integers

if TYPE_CHECKING:
    from concurrent.futures import Executor


TIE_DECIMALS = 6
"""Modes whose kernel sums agree to so many decimals, such as isolated points, are ranked by their
first point instead of by rounding errors."""


class MeanShift:
    """Clustering by the modes of the kernel density (7) of points on a manifold.

    Parameters
    ----------
    manifold
        A manifold, or its name, such as ``"grassmann(10,3)"``.
    bandwidth
        h, in the manifold's distance; ``"auto"`` takes
        :func:`~mssegment.meanshift.nearest_neighbour_bandwidth`.
    kernel
        ``"gaussian"``, ``"truncated"`` or ``"epanechnikov"``.
    bandwidth_constant
        The ``constant`` of that rule.
    merge_within
        Modes that are nearer than this many bandwidths are merged.
    min_count
        Modes at which fewer trajectories end are dropped, and their points labelled -1.
    max_iterations
        The largest number of steps of a trajectory.
    sample_above
        The number of points above which they ascend the density of a sample of 4000 of them, at a
        cost that is linear in their number; points far from the sample are labelled -1. At least
        4000.
    memory_mb
        With a sample, a bound on the memory used besides the points and the result, in megabytes.
    threads
        The number of threads that share blocks of rows; the result is the same with any. The matrix
        products must run on one thread each (``OPENBLAS_NUM_THREADS=1``): they are small, and
        several BLAS threads make them 4-12 times slower.
    record
        Whether to keep the trajectories, for plotting; not with a sample.

    Attributes
    ----------
    modes_
        The modes [m, ...], densest first.
    densities_
        The kernel densities (7) there [m], without the constant c_{k,h}.
    counts_
        The number of trajectories that end at each mode [m].
    labels_
        The mode of each point [n], -1 for none.
    bandwidth_
        h.
    n_iter_
        The number of steps of the first pass.
    trajectories_
        With ``record``, the path of each point, a list of n arrays [steps, ...]; else None.

    Raises
    ------
    ConfigurationError
        Where there is no manifold of that name.

    References
    ----------
    R. Subbarao and P. Meer, "Nonlinear mean shift for clustering over analytic manifolds",
    CVPR 2006.

    Examples
    --------
    Two bundles of lines through the origin of space, points of G(3,1):

    >>> import numpy as np
    >>> from mssegment.manifolds import Grassmann
    >>> rng = np.random.default_rng(0)
    >>> lines = np.repeat([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]], [30, 20], axis=0)
    >>> lines = lines + 0.05 * rng.standard_normal((50, 3))
    >>> lines /= np.linalg.norm(lines, axis=1, keepdims=True)
    >>> found = MeanShift(Grassmann(3, 1), bandwidth=0.2).fit(lines[:, :, None])
    >>> found.counts_.tolist()
    [30, 20]
    >>> abs(found.modes_[:, :, 0]).round(1).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
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
        sample_above: int = 2 * SAMPLE_SIZE,
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
        self.sample_above = max(sample_above, SAMPLE_SIZE)
        self.memory_mb = memory_mb
        self.threads = threads
        self.record = record

    def fit(self, points: Floats, rng: np.random.Generator | None = None) -> MeanShift:
        """Cluster the points.

        Parameters
        ----------
        points
            Points of the manifold [n, ...].
        rng
            Draws the samples and the perturbations; a generator with seed 0 by default.

        Returns
        -------
        MeanShift
            The estimator itself, with its attributes set.

        Raises
        ------
        DataError
            Where there are no points, or they are not on the manifold.
        ConfigurationError
            For a bandwidth that is not positive and finite, or an unknown kernel.
        """
        rng = np.random.default_rng(0) if rng is None else rng
        points = np.asarray(points, dtype=np.float64)
        if len(points) == 0:
            raise DataError("mean shift needs at least 1 hypothesis, found none")
        self.manifold.check_point(points)
        self.bandwidth_ = self._choose_bandwidth(points, rng)
        with _pool(self.threads) as pool:
            search = ModeSearch(
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
        self.n_iter_ = found.ascent.iterations
        self._rank(found)
        self.trajectories_ = None
        if self.record and len(points) <= self.sample_above:
            self.trajectories_ = self._paths(found.ascent)
        return self

    def fit_predict(self, points: Floats, rng: np.random.Generator | None = None) -> Integers:
        """The labels [n] of the points, as ``fit(points, rng).labels_``."""
        return self.fit(points, rng).labels_

    def _choose_bandwidth(self, points: Floats, rng: np.random.Generator) -> float:
        if self.bandwidth == "auto":
            return nearest_neighbour_bandwidth(self.manifold, points, rng, self.bandwidth_constant)
        if isinstance(self.bandwidth, str) or not 0 < self.bandwidth < np.inf:
            raise ConfigurationError(
                f"the bandwidth must be 'auto' or a positive number, found {self.bandwidth!r}"
            )
        return float(self.bandwidth)

    def _rank(self, found: SearchResult) -> None:
        """Set the attributes to the modes that enough trajectories reach, densest first."""
        modes, densities, labels = found.modes, found.densities, found.labels
        counts = np.bincount(labels[labels >= 0], minlength=len(modes))
        kept = np.flatnonzero(counts >= max(1, self.min_count))
        first = np.full(len(modes) + 1, len(labels))
        np.minimum.at(first, labels, np.arange(len(labels)))
        sums = np.round(densities[kept] * len(labels), TIE_DECIMALS)
        kept = kept[np.lexsort((first[kept], -sums))]
        place = np.full(len(modes) + 1, -1)
        place[kept] = np.arange(len(kept))
        self.modes_, self.densities_, self.counts_ = modes[kept], densities[kept], counts[kept]
        self.labels_ = place[labels]

    def _paths(self, ascent: Ascent) -> list[Floats]:
        """Each trajectory [steps, ...] up to its mode; a follower continues at its leader's end."""
        paths = ascent.paths()
        for i, (leader, label) in enumerate(zip(ascent.final_leader(), self.labels_, strict=True)):
            if leader != i:
                paths[i].append(ascent.x[leader])
            if label >= 0:
                paths[i].append(self.modes_[label])
        return [np.stack(path) for path in paths]


def _pool(threads: int) -> AbstractContextManager[Executor | None]:
    if threads <= 1:
        return nullcontext()
    from concurrent.futures import ThreadPoolExecutor  # loads logging

    return ThreadPoolExecutor(threads)
