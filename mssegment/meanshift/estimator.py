"""Mean shift clustering over any manifold, with scikit-learn's conventions."""

from __future__ import annotations

import numpy as np

from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import Manifold, from_name
from mssegment.meanshift.ascent import Ascent, ascend
from mssegment.meanshift.bandwidth import nearest_neighbour_bandwidth
from mssegment.meanshift.kernels import kernel_named
from mssegment.meanshift.modes import merge
from mssegment.records import Floats, Integers

FOLLOW_WITHIN = 0.1
"""A trajectory this near (in bandwidths) to a denser one follows it."""
WAY_TOLERANCE, MODE_TOLERANCE = 1e-2, 1e-6
"""Shift (in bandwidths) below which a trajectory, or a mode at the end, stands still."""
PERTURBATION = 0.1
"""A mode is moved by this many bandwidths; a saddle point does not come back."""
ISOLATED = 1e-2
"""A mode with less company than this (kernel sum without its own point) cannot be a saddle."""


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
    max_iterations: a trajectory that still moves after so many steps belongs nowhere (-1).
    record: keep every trajectory in ``trajectories_`` (for plotting).

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
        record: bool = False,
    ) -> None:
        self.manifold = from_name(manifold) if isinstance(manifold, str) else manifold
        self.bandwidth = bandwidth
        self.kernel = kernel
        self.bandwidth_constant = bandwidth_constant
        self.merge_within = merge_within
        self.min_count = min_count
        self.max_iterations = max_iterations
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
        way = self._ascend(points, points, WAY_TOLERANCE, precise=False, follow=FOLLOW_WITHIN)
        self.n_iter_ = way.iterations
        modes, densities, labels = self._find_modes(points, way, rng)
        self._rank(modes, densities, labels)
        self.trajectories_ = self._paths(way) if self.record else None
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

    def _ascend(
        self, points: Floats, starts: Floats, tolerance: float, precise: bool, follow: float = 0.0
    ) -> Ascent:
        cloud = self.manifold.cloud(points, self.bandwidth_, precise)
        return ascend(
            self.manifold,
            cloud,
            kernel_named(self.kernel),
            self.bandwidth_,
            starts,
            tolerance,
            self.max_iterations,
            follow,
            self.record and not precise,
        )

    def _find_modes(
        self, points: Floats, way: Ascent, rng: np.random.Generator
    ) -> tuple[Floats, Floats, Integers]:
        """Distinct modes in double precision, their densities, and the mode of each point."""
        last = way.last_leader()
        ends, place = np.unique(last, return_inverse=True)
        kept, joined = merge(
            self.manifold, way.x[ends], way.density[ends], FOLLOW_WITHIN * self.bandwidth_
        )
        polished = self._ascend(points, way.x[ends[kept]], MODE_TOLERANCE, precise=True)
        modes, densities, labels = self._merge(polished, joined[place])
        labels[~way.converged[last]] = -1
        away = self._leave_saddles(points, modes, densities, rng)
        if away is not None:
            modes, densities, labels = self._merge(away, labels)
        return modes, densities, labels

    def _merge(self, ends: Ascent, labels: Integers) -> tuple[Floats, Floats, Integers]:
        kept, joined = merge(
            self.manifold, ends.x, ends.density, self.merge_within * self.bandwidth_
        )
        relabelled = np.where(labels >= 0, joined[labels], -1)
        return ends.x[kept], ends.density[kept], relabelled

    def _leave_saddles(
        self, points: Floats, modes: Floats, densities: Floats, rng: np.random.Generator
    ) -> Ascent | None:
        """Perturb the modes and climb again; where a saddle went, or None if there is none."""
        doubtful = np.flatnonzero(densities * len(points) > 1.0 + ISOLATED)
        if not doubtful.size:
            return None
        push = self.manifold.random_tangent(modes[doubtful], rng)
        pushed = self.manifold.exp(modes[doubtful], PERTURBATION * self.bandwidth_ * push)
        again = self._ascend(points, pushed, WAY_TOLERANCE, precise=True)
        left = self.manifold.dist(again.x, modes[doubtful]) > 0.5 * self.bandwidth_
        if not left.any():
            return None
        whole = Ascent.from_starts(modes)
        whole.density[:] = densities
        saddles = doubtful[left]
        arrived = self._ascend(points, again.x[left], MODE_TOLERANCE, precise=True)
        whole.x[saddles], whole.density[saddles] = arrived.x, arrived.density
        return whole

    def _rank(self, modes: Floats, densities: Floats, labels: Integers) -> None:
        """Keep the modes that enough trajectories reach, densest first."""
        counts = np.bincount(labels[labels >= 0], minlength=len(modes))
        kept = np.flatnonzero(counts >= max(1, self.min_count))
        kept = kept[np.argsort(-densities[kept], kind="stable")]
        place = np.full(len(modes) + 1, -1)
        place[kept] = np.arange(len(kept))
        self.modes_, self.densities_, self.counts_ = modes[kept], densities[kept], counts[kept]
        self.labels_ = place[labels]

    def _paths(self, way: Ascent) -> list[Floats]:
        """Each trajectory [steps, ...]; it ends at its mode, that of a follower by way of leaders."""
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
