"""Mean shift clustering over any manifold: an estimator of scikit-learn that does without it.

It keeps to the contract of ``sklearn.utils.estimator_checks``: parameters are stored untouched and
checked in ``fit``, what is learnt ends with an underscore, input is checked with the same kinds of
errors. Classes of scikit-learn are imported only where scikit-learn itself calls for them.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from mssegment.blas import with_one_thread
from mssegment.errors import ConfigurationError, DataError
from mssegment.manifolds import MANIFOLDS, Manifold, from_name
from mssegment.meanshift.bandwidth import auto_bandwidth, neighbour_distances
from mssegment.meanshift.clusters import (
    SAMPLE_ABOVE,
    Clusters,
    find_clusters,
    rank,
    thread_pool,
)
from mssegment.meanshift.density import PointWeights
from mssegment.meanshift.kernels import Kernel, kernel_named
from mssegment.meanshift.large import SAMPLE_SIZE
from mssegment.meanshift.parameters import check_parameters
from mssegment.meanshift.search import TRAJECTORY_TOLERANCE, ModeSearch, SearchResult
from mssegment.meanshift.validation import (
    LARGEST,
    InvalidPoints,
    Parameters,
    feature_names,
    generator,
    numbers,
    numbers_like_fitted,
    real_numbers,
    shown,
    thread_count,
)
from mssegment.records import Floats, Integers, replace

KNN_FRACTION = 0.1
"""With ``bandwidth="knn"``, the neighbour is the 0.1 n-th, as in the rule ``auto``."""
PRECISE_UP_TO = 1000
"""Up to so many points the trajectories are computed in double precision, in which labels do not
depend on the unit or the order of the data; above, in single precision, which is twice as fast."""
EXACT = 1e-12
"""Points that violate their constraint by more are projected."""
MERGE_WITHIN = 1.0
"""Modes nearer than this many bandwidths are one, as in scikit-learn."""

Callback = Callable[[int, int], None]


class ConvergenceWarning(UserWarning):
    """Some trajectories did not converge within ``max_iter`` steps."""


class MeanShift(Parameters):
    """Clustering by the modes of the kernel density (7) of points on a manifold.

    Parameters
    ----------
    manifold
        A manifold, its name such as ``"grassmann(10,3)"``, or the name of a family such as
        ``"euclidean"`` or ``"se3"``, whose size is that of the points.
    bandwidth
        h, in the manifold's distance. ``"auto"`` suits normal clusters in any dimension
        (:func:`~mssegment.meanshift.bandwidth.auto_bandwidth`); ``"knn"`` gives each point a
        bandwidth of its own, the distance to its 0.1 n-th neighbour; an array has one for each
        point.
    kernel
        ``"gaussian"``, ``"truncated"``, ``"epanechnikov"``, or a
        :class:`~mssegment.meanshift.Kernel`.
    seeds
        Where the trajectories start, points of the manifold; by default all points. Each point then
        belongs to the mode nearest to it.
    cluster_all
        Whether points without a mode, such as those of modes that ``min_count`` drops, belong to
        the nearest mode; otherwise their label is -1.
    min_count
        Modes at which fewer trajectories end are dropped.
    max_iter
        The largest number of steps of a trajectory.
    sample_above
        The number of points above which they ascend the density of a sample of 4000 of them, at a
        cost that is linear in their number; None for never. Not with weights, seeds or several
        bandwidths.
    n_jobs
        The number of threads, -1 for all; the result is the same with any.
    random_state
        Seed, ``numpy.random.Generator`` or ``RandomState`` that draws samples, and directions at
        saddle points. None is seed 0: the same data give the same result.
    callback
        Called after every step with the number of steps so far and of active trajectories.

    Attributes
    ----------
    cluster_centers_
        The modes [m, ...], densest first; also ``modes_``.
    labels_
        The mode of each point [n], -1 for none.
    densities_
        The kernel densities (7) at the modes [m], without the constant c_{k,h}.
    counts_
        The number of trajectories that end at each mode [m]; with seeds, of points.
    manifold_
        The manifold.
    bandwidth_
        h, or with several the array [n].
    n_iter_
        The number of steps of the first pass.
    converged_
        Whether all trajectories converged.
    sampled_
        Whether the density was that of a sample.
    n_features_in_
        The number of entries of a point.

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
    >>> found = MeanShift(Grassmann(3, 1)).fit(lines[:, :, None])
    >>> found.counts_.tolist()
    [30, 20]
    >>> abs(found.cluster_centers_[:, :, 0]).round(1).tolist()
    [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """

    cluster_centers_: Floats
    manifold_: Manifold
    densities_: Floats
    counts_: Integers
    labels_: Integers
    bandwidth_: float | Floats
    n_iter_: int
    converged_: bool
    sampled_: bool
    n_features_in_: int

    def __init__(
        self,
        manifold: Manifold | str = "euclidean",
        bandwidth: float | str | npt.ArrayLike = "auto",
        kernel: str | Kernel = "gaussian",
        *,
        seeds: npt.ArrayLike | None = None,
        cluster_all: bool = True,
        min_count: int = 1,
        max_iter: int = 500,
        sample_above: int | None = SAMPLE_ABOVE,
        n_jobs: int | None = None,
        random_state: int | np.random.Generator | np.random.RandomState | None = None,
        callback: Callback | None = None,
    ) -> None:
        self.manifold = manifold
        self.bandwidth = bandwidth
        self.kernel = kernel
        self.seeds = seeds
        self.cluster_all = cluster_all
        self.min_count = min_count
        self.max_iter = max_iter
        self.sample_above = sample_above
        self.n_jobs = n_jobs
        self.random_state = random_state
        self.callback = callback

    @property
    def modes_(self) -> Floats:
        """The modes, ``cluster_centers_``."""
        return self.cluster_centers_

    @with_one_thread
    def fit(self, X: npt.ArrayLike, y: Any = None, sample_weight: Any = None) -> Self:
        """Cluster the points.

        Parameters
        ----------
        X
            Points of the manifold [n, ...], or with all entries of a point in one row.
        y
            Ignored, as in every clusterer.
        sample_weight
            Nonnegative weights of the points [n]: how often each counts.

        Returns
        -------
        MeanShift
            The estimator itself, with its attributes set.

        Raises
        ------
        DataError
            Where there are no points, or they are not on the manifold; also a ValueError.
        ConfigurationError
            For a parameter that is no such thing, or an unknown name.
        """
        check_parameters(self)
        names = feature_names(X)
        raw = numbers(X)
        manifold = self._manifold_of(raw)
        points = self._points_on(manifold, raw)
        if len(points) == 0:
            raise InvalidPoints("Found array with 0 sample(s); mean shift needs at least 1 point")
        weights = self._weights(sample_weight, len(points))
        counted = np.arange(len(points)) if weights is None else np.flatnonzero(weights > 0)
        if not counted.size:
            raise InvalidPoints("all sample weights are zero: at least one weight must be positive")
        rng = generator(self.random_state)
        used, own = points[counted], None if weights is None else weights[counted]
        search, self.bandwidth_ = self._search(manifold, used, own, rng, counted, len(points))
        with thread_pool(thread_count(self.n_jobs)) as pool:
            running = replace(search, pool=pool, on_step=self.callback)
            found = self._clusters(running, used, rng)
        self._fitted, self._data, self.manifold_ = search, used, manifold
        if found.sampled:
            self._data = used[np.sort(rng.choice(len(used), SAMPLE_SIZE, replace=False))]
        self._modes = found.modes
        self._set_attributes(found, names, raw)
        labels = self._completed(used, found.labels)
        self.labels_ = np.full(len(points), -1, dtype=np.int64)
        self.labels_[counted] = labels
        if len(counted) < len(points):
            rest = np.setdiff1d(np.arange(len(points)), counted)
            self.labels_[rest] = self._reached(points[rest])
        return self

    def fit_predict(
        self,
        X: npt.ArrayLike,
        y: Any = None,
        sample_weight: Any = None,
    ) -> Integers:
        """The labels [n] of the points, as ``fit(X, y, sample_weight).labels_``."""
        return self.fit(X, y, sample_weight).labels_

    def predict(self, X: npt.ArrayLike) -> Integers:
        """The modes that trajectories from new points reach.

        Parameters
        ----------
        X
            Points [n, ...], as in ``fit``.

        Returns
        -------
        array
            Labels [n]; a point whose trajectory reaches none belongs to the nearest mode, or with
            ``cluster_all=False`` is -1.

        Raises
        ------
        NotFittedError
            Before ``fit``.
        """
        raw = numbers_like_fitted(self, X)
        return self._reached(self._points_on(self._fitted.manifold, raw))

    def _manifold_of(self, raw: Floats) -> Manifold:
        """The manifold, of the size of the points where only its family is named."""
        if isinstance(self.manifold, Manifold):
            return self.manifold
        if not isinstance(self.manifold, str):
            raise ConfigurationError(
                f"manifold must be a manifold or a name, found {shown(self.manifold)}"
            )
        family = MANIFOLDS.get(self.manifold.strip())
        if family is None:
            return from_name(self.manifold)
        manifold: Manifold = family.from_shape(raw.shape[1:])
        return manifold

    def _points_on(self, manifold: Manifold, raw: Floats) -> Floats:
        """``raw`` as points [n, *point_shape], checked."""
        shape = manifold.point_shape
        if raw.ndim == 2 and raw.shape[1:] != shape and raw.shape[1] == int(np.prod(shape)):
            raw = raw.reshape(len(raw), *shape)
        try:
            manifold.check_point(raw)
        except DataError as error:
            raise InvalidPoints(str(error)) from None
        # of points in single precision, or of few digits, logarithms are not even near
        exact = manifold.constraint_violation(raw) <= EXACT
        return raw if bool(np.all(exact)) else manifold.project(raw)

    def _weights(self, sample_weight: Any, count: int) -> Floats | None:
        if sample_weight is None:
            return None
        weights = real_numbers(sample_weight, "sample_weight")
        if weights.ndim == 0:
            weights = np.full(count, float(weights))
        if weights.shape != (count,):
            raise InvalidPoints(
                f"sample_weight must have the shape ({count},), found {weights.shape}"
            )
        if not ((weights <= LARGEST) & (weights >= 0)).all():
            raise InvalidPoints(f"sample_weight must not be negative, nor above {LARGEST:g}")
        return None if (weights == 1.0).all() else weights

    def _search(
        self,
        manifold: Manifold,
        points: Floats,
        weights: Floats | None,
        rng: np.random.Generator,
        counted: Integers,
        count: int,
    ) -> tuple[ModeSearch, float | Floats]:
        """The search, and the bandwidth or bandwidths, for the ``counted`` of ``count`` points."""
        kernel = self.kernel if isinstance(self.kernel, Kernel) else kernel_named(self.kernel)
        bandwidth: float | Floats
        if isinstance(self.bandwidth, str) and self.bandwidth == "auto":
            bandwidth = auto_bandwidth(manifold, points, rng, weights)
        elif isinstance(self.bandwidth, str):
            own = neighbour_distances(manifold, points, KNN_FRACTION, weights)
            smallest = own[own > 0].min(initial=np.inf)
            bandwidth = np.maximum(own, smallest if np.isfinite(smallest) else 1.0)
        else:
            bandwidth = np.asarray(self.bandwidth, dtype=np.float64)
            if bandwidth.ndim and len(bandwidth) != count:
                raise InvalidPoints(
                    f"bandwidth must be one number, or one for each of {count} points, found "
                    f"{len(bandwidth)}"
                )
            bandwidth = bandwidth[counted] if bandwidth.ndim else float(bandwidth)
        common, point_weights = bandwidth, None
        if weights is not None or isinstance(bandwidth, np.ndarray):
            every = np.broadcast_to(bandwidth, (len(points),))
            common = float(np.sort(every)[len(every) // 4])
            own_weights = np.ones(len(points)) if weights is None else weights
            point_weights = PointWeights.build(own_weights, every, common, manifold.dim)
        search = ModeSearch(
            manifold,
            kernel,
            float(common),
            MERGE_WITHIN,
            self.max_iter,
            precise=len(points) <= PRECISE_UP_TO,
            point_weights=point_weights,
        )
        return search, bandwidth

    def _clusters(self, search: ModeSearch, points: Floats, rng: np.random.Generator) -> Clusters:
        if self.seeds is None:
            return find_clusters(search, points, rng, self.min_count, self.sample_above)
        starts = self._points_on(search.manifold, numbers(self.seeds))
        prepared = search.prepare(points, precise=True)
        ascent = search.ascend(prepared, starts, TRAJECTORY_TOLERANCE)
        modes, densities, labels = search.refine(points, ascent.x)
        if not (densities > 0).any():
            raise InvalidPoints(
                f"no seed is near a point: the density at all {len(starts)} of them is 0 with the "
                f"bandwidth {search.bandwidth:.3g}"
            )
        found = rank(SearchResult(modes, densities, labels, ascent), self.min_count, sampled=False)
        nearest = _nearest(search.manifold, points, found.modes, search.bandwidth)
        near = search.manifold.dist(points, found.modes[nearest]) <= search.bandwidth
        found.labels = np.where(near, nearest, -1)
        found.counts = np.bincount(nearest[near], minlength=len(found.modes))
        return found

    def _completed(self, points: Floats, labels: Integers) -> Integers:
        """``labels`` with the nearest mode where there is none, if ``cluster_all``."""
        missing = np.flatnonzero(labels < 0)
        if not self.cluster_all or not missing.size or not len(self._modes):
            return labels
        labels = labels.copy()
        labels[missing] = _nearest(
            self._fitted.manifold, points[missing], self._modes, self._fitted.bandwidth
        )
        return labels

    def _reached(self, points: Floats) -> Integers:
        """The modes that trajectories from ``points`` reach."""
        search = self._fitted
        labels = np.full(len(points), -1, dtype=np.int64)
        if len(points) and len(self._modes):
            prepared = search.prepare(self._data, precise=True)
            ends = search.ascend(prepared, points, TRAJECTORY_TOLERANCE).x
            nearest = _nearest(search.manifold, ends, self._modes, search.bandwidth)
            near = search.manifold.dist(ends, self._modes[nearest]) <= search.bandwidth
            labels = np.where(near, nearest, -1)
        return self._completed(points, labels)

    def _set_attributes(self, found: Clusters, names: Any, raw: Floats) -> None:
        self.cluster_centers_ = found.modes.reshape(len(found.modes), *raw.shape[1:])
        self.densities_, self.counts_ = found.densities, found.counts
        self.n_iter_, self.sampled_ = found.ascent.iterations, found.sampled
        self.converged_ = found.ascent.iterations < self.max_iter
        self.n_features_in_ = int(np.prod(raw.shape[1:]))
        if names is not None:
            self.feature_names_in_ = names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_
        if not self.converged_:
            warnings.warn(
                f"some trajectories did not converge in {self.max_iter} steps: "
                "increase max_iter or the bandwidth",
                ConvergenceWarning,
                stacklevel=3,
            )


def _nearest(manifold: Manifold, points: Floats, modes: Floats, unit: float) -> Integers:
    """The nearest of ``modes`` [m, ...] to each point [n]."""
    prepared = manifold.prepare(modes, unit)
    out = np.zeros(len(points), dtype=np.int64)
    for start in range(0, len(points), prepared.block_rows):
        rows = slice(start, start + prepared.block_rows)
        out[rows] = np.argmin(prepared.block(points[rows]).scaled_sq_dist, axis=1)
    return out
