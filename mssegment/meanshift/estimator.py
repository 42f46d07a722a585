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
STRAGGLERS = 50
"""When only one in so many still moves, the modes found so far join them on the last climb."""
WAY_TOLERANCE, MODE_TOLERANCE = 1e-2, 1e-4
"""The distance (in bandwidths) from its mode at which a trajectory, or a mode, stands still."""
PERTURBATION = 0.1
"""A mode is moved by this many bandwidths; a saddle point does not come back."""
ISOLATED = 1e-2
"""Where the kernel sum without the own point is less than this, the point is a mode by itself.

It cannot be a saddle, nothing else can end there, and its trajectory hardly moves."""


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
        way = self._ascend(points, points, WAY_TOLERANCE, follow=True)
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
        self,
        points: Floats,
        starts: Floats,
        tolerance: float,
        precise: bool = False,
        follow: bool = False,
    ) -> Ascent:
        kernel = kernel_named(self.kernel)
        cloud = self.manifold.cloud(points, self.bandwidth_, precise, kernel.reach(precise))
        return ascend(
            self.manifold,
            cloud,
            kernel,
            self.bandwidth_,
            starts,
            tolerance,
            self.max_iterations,
            follow_within=FOLLOW_WITHIN if follow else 0.0,
            until=len(starts) // STRAGGLERS if follow else 0,
            record=self.record and follow,
        )

    def _find_modes(
        self, points: Floats, way: Ascent, rng: np.random.Generator
    ) -> tuple[Floats, Floats, Integers]:
        """Distinct modes in double precision, their densities, and the mode of each point.

        Isolated ends stay as they are. The others, merged, climb on together with a perturbed copy
        of each: a saddle is an end whose copy goes elsewhere, and gives way to where that arrives.
        """
        last = way.last_leader()
        ends, place = np.unique(last, return_inverse=True)
        lonely = (way.density[ends] * len(points) < 1.0 + ISOLATED) & way.converged[ends]
        alone, social = ends[lonely], ends[~lonely]
        x, _, joined = self._merge(way.x[social], way.density[social], FOLLOW_WITHIN)
        push = PERTURBATION * self.bandwidth_ * self.manifold.random_tangent(x, rng)
        both = np.concatenate([x, self.manifold.exp(x, push)])
        arrived = self._ascend(points, both, WAY_TOLERANCE)
        x, copy = np.split(arrived.x, 2)
        saddle = self.manifold.dist(x, copy) > 0.5 * self.bandwidth_
        x[saddle] = copy[saddle]
        density = np.where(saddle, *np.split(arrived.density, 2)[::-1])
        x, _, joined_later = self._merge(x, density, FOLLOW_WITHIN)
        polished = self._ascend(points, x, MODE_TOLERANCE, precise=True)
        x, density, joined_last = self._merge(polished.x, polished.density, self.merge_within)
        mode_of_end = np.empty(len(ends), dtype=np.int64)
        mode_of_end[~lonely] = joined_last[joined_later[joined]]
        mode_of_end[lonely] = len(x) + np.arange(len(alone))
        return (
            np.concatenate([x, way.x[alone]]),
            np.concatenate([density, way.density[alone]]),
            mode_of_end[place],
        )

    def _merge(self, x: Floats, density: Floats, within: float) -> tuple[Floats, Floats, Integers]:
        """The distinct ones of ``x``, their densities, and which one each became."""
        kept, joined = merge(self.manifold, x, density, within * self.bandwidth_)
        return x[kept], density[kept], joined

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
