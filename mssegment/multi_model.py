"""Several structures in one data set, as an estimator of scikit-learn that does without it."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
import numpy.typing as npt

from mssegment.errors import ConfigurationError
from mssegment.meanshift.validation import (
    InvalidPoints,
    Parameters,
    feature_names,
    generator,
    numbers,
    numbers_like_fitted,
    positive_number,
    shown,
    thread_count,
)
from mssegment.models import MODELS, of_data
from mssegment.records import Floats, Hypotheses, HypothesisSet, Integers, Motion, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.sampling.options import SamplingOptions
from mssegment.sampling.strategy import model_of_data
from mssegment.sampling.structures import sample_structures
from mssegment.segmentation import SegmentOptions, cluster

FEWEST = 2
"""The least number of points of scikit-learn's contract for estimators that need several."""


class Structure(Record, frozen=True):
    """One structure that was found.

    Attributes
    ----------
    inliers
        Indices of its points.
    scale
        Standard deviation of a residual coordinate, in the unit of the data.
    limit
        The largest residual of an inlier.
    coefficients
        Planes and hyperplanes: (a, b, ..., e) of ax + by + ... + e = 0, with (a, b, ...) of length
        1; otherwise None.
    origin, basis
        Lines: a point [d] and the direction [d, 1]. Subspaces: the origin, and orthonormal columns
        [d, k]. Otherwise None.
    matrix
        Quadrics: Q [d + 1, d + 1] with z'Qz = 0 for z = (x, 1). ``rigid3d``: [4, 4], which maps
        the first points to the second. Otherwise None.
    point
        The structure on the manifold of its model, in normalized coordinates.
    """

    inliers: Integers
    scale: float
    limit: float
    point: Floats
    coefficients: Floats | None = None
    origin: Floats | None = None
    basis: Floats | None = None
    matrix: Floats | None = None


class MultiModel(Parameters):
    """Several lines, planes, subspaces or rigid motions in one data set, among outliers.

    Neither the number of structures nor the noise need be known: hypotheses from elemental subsets
    are kept if more points agree with them than chance explains, mean shift on the manifold of the
    model finds their modes, and the modes with the shortest description of the data are the
    structures. None and one are possible results.

    Parameters
    ----------
    model
        ``"hyperplane"``, ``"subspace"``, ``"line"``, ``"plane"``, ``"quadric"``, ``"rigid3d"``, or
        a model of a package that is installed. All coordinates should have errors of about the same
        size.
    rank
        For ``"subspace"``, its dimension.
    n_structures
        The number of structures, if it is known; it is the upper bound too.
    n_hypotheses
        The number of hypotheses, or ``"auto"``.
    bandwidth
        Of mean shift, or ``"auto"``.
    n_jobs
        The number of threads, -1 for all; the result is the same with any.
    random_state
        Seed, ``numpy.random.Generator`` or ``RandomState``; None is seed 0.

    Attributes
    ----------
    labels_
        The structure of each point [n], 0 that with most points; -1 for outliers.
    structures_
        The structures, as :class:`~mssegment.multi_model.Structure`.
    n_structures_
        Their number.
    scales_
        The noise of each.
    n_features_in_
        The number of coordinates.

    References
    ----------
    R. Subbarao and P. Meer, "Nonlinear mean shift for clustering over analytic manifolds",
    CVPR 2006, sections 4 and 5.

    Examples
    --------
    Two lines and as many outliers; y = x / 2 and y = 0.8 - x:

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> x = rng.uniform(-1.0, 1.0, 100)
    >>> y = np.where(np.arange(100) < 50, 0.5 * x, 0.8 - x) + 0.01 * rng.standard_normal(100)
    >>> points = np.concatenate([np.stack([x, y], axis=1), rng.uniform(-1, 1, (100, 2))])
    >>> found = MultiModel("line").fit(points)
    >>> found.n_structures_, bool((found.labels_[100:] == -1).mean() > 0.9)
    (2, True)
    >>> a, b, c = found.structures_[0].coefficients
    """

    labels_: Integers
    structures_: tuple[Structure, ...]
    n_structures_: int
    scales_: Floats
    n_features_in_: int

    def __init__(
        self,
        model: str = "hyperplane",
        *,
        rank: int | None = None,
        n_structures: int | None = None,
        n_hypotheses: int | str = "auto",
        bandwidth: float | str = "auto",
        n_jobs: int | None = None,
        random_state: int | np.random.Generator | np.random.RandomState | None = None,
    ) -> None:
        self.model = model
        self.rank = rank
        self.n_structures = n_structures
        self.n_hypotheses = n_hypotheses
        self.bandwidth = bandwidth
        self.n_jobs = n_jobs
        self.random_state = random_state

    def fit(self, X: npt.ArrayLike, y: Any = None) -> Self:
        """Find the structures.

        Parameters
        ----------
        X
            Points [n, d]; for ``"rigid3d"`` matched points [n, 2, 3], or [n, 6] with the first
            points in the first three columns.
        y
            Ignored, as in every clusterer. For the regression of y, make it a column of ``X``.

        Returns
        -------
        MultiModel
            The estimator itself, with its attributes set.

        Raises
        ------
        DataError
            For too few points, points that all lie on a smaller structure, or numbers that are not
            finite; also a ValueError.
        ConfigurationError
            For a parameter that is no such thing, or an unknown model.
        """
        self._check_parameters()
        names = feature_names(X)
        points = self._points(numbers(X))
        rng = generator(self.random_state)
        options = SamplingOptions(
            self.model,
            "auto" if self.rank is None else self.rank,
            "auto" if self.n_hypotheses == "auto" else int(self.n_hypotheses),
        )
        model = model_of_data(self.model, options, points)
        if len(points) < 2 * model.subset_size:
            raise InvalidPoints(
                f"Found array with {len(points)} sample(s) (shape={np.shape(X)}) while a minimum "
                f"of {2 * model.subset_size} is required by model {self.model}, twice an elemental "
                "subset"
            )
        chosen = sample_structures(points, model, options, rng=rng)
        self._chosen = chosen
        labels = np.full(len(points), -1, dtype=np.int64)
        structures: tuple[Structure, ...] = ()
        if len(chosen.points) and self.n_structures != 0:
            found = cluster(
                points, Hypotheses("modes", (chosen,)), options=self._segment_options(), rng=rng
            )
            labels = np.where(found.labels > 0, found.labels - 1, -1)
            structures = tuple(
                _structure(motion, found.residuals[motion.label - 1]) for motion in found.motions
            )
        self.labels_, self.structures_, self.n_structures_ = labels, structures, len(structures)
        self.scales_ = np.array([structure.scale for structure in structures])
        self.n_features_in_ = int(np.prod(points.shape[1:]))
        if names is not None:
            self.feature_names_in_ = names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_
        self._fitted = True
        return self

    def fit_predict(self, X: npt.ArrayLike, y: Any = None) -> Integers:
        """The labels [n] of the points, as ``fit(X, y).labels_``."""
        return self.fit(X, y).labels_

    def predict(self, X: npt.ArrayLike) -> Integers:
        """The nearest structure of new points [n, ...], -1 where none is within its limit.

        Raises
        ------
        NotFittedError
            Before ``fit``.
        """
        residuals = self.residuals(X)
        if not len(residuals):
            return np.full(residuals.shape[1], -1, dtype=np.int64)
        limits = np.array([structure.limit for structure in self.structures_])
        outside = residuals > limits[:, None]
        nearest = np.where(outside, np.inf, residuals).argmin(axis=0)
        return np.where(outside.all(axis=0), -1, nearest).astype(np.int64)

    def residuals(self, X: npt.ArrayLike) -> Floats:
        """The distance of points [n, ...] from each structure, [m, n], in the unit of the data."""
        raw = numbers_like_fitted(self, X)
        points = self._points(raw)
        if not self.structures_:
            return np.zeros((0, len(points)))
        chosen: HypothesisSet = self._chosen
        observed_set = ObservedSet.of(points, chosen)
        return observed_set.residuals(np.stack([each.point for each in self.structures_]))

    def _points(self, raw: Floats) -> Floats:
        """Points [n, F, d], from [n, d] or [n, F d]."""
        kind = MODELS[self.model]
        views, d = kind.min_frames, kind.coordinates
        if raw.ndim == 2 and views > 1 and raw.shape[1] == views * (d or 0):
            return raw.reshape(len(raw), views, d)
        points = raw[:, None] if raw.ndim == 2 else raw
        if points.ndim != 3 or points.shape[1] != views:
            expected = "[n, d]" if views == 1 else f"[n, {views}, {d}]"
            raise InvalidPoints(f"X has the shape {raw.shape}; model {self.model} wants {expected}")
        least = d or 2
        if len(raw) and (points.shape[2] < least or (d and points.shape[2] != d)):
            raise InvalidPoints(
                f"Found array with {points.shape[2]} feature(s) (shape={raw.shape}) while "
                f"{'a minimum of ' if d is None else ''}{least} is required by model {self.model}."
            )
        if not len(raw):
            raise InvalidPoints(
                f"Found array with 0 sample(s) (shape={raw.shape}) while a minimum of {FEWEST} is "
                "required."
            )
        return points

    def _segment_options(self) -> SegmentOptions:
        bandwidth: Any = self.bandwidth
        return SegmentOptions(
            bandwidth=bandwidth if bandwidth == "auto" else float(bandwidth),
            motions=self.n_structures,
            threads=thread_count(self.n_jobs),
        )

    def _check_parameters(self) -> None:
        known = of_data()
        if self.model not in known:
            raise ConfigurationError(
                f"model must be one of {', '.join(known)}, found {self.model!r}"
            )
        kind = MODELS[self.model]
        if kind.has_ranks and self.rank is None:
            raise ConfigurationError(
                f"model {self.model} needs rank, the dimension of its subspaces, found None"
            )
        if not kind.has_ranks and self.rank is not None:
            raise ConfigurationError(
                f"rank has no effect on model {self.model}: leave it out, found {shown(self.rank)}"
            )
        for name, least in (("rank", 1), ("n_structures", 0)):
            value = getattr(self, name)
            if value is not None and not _is_whole(value, least):
                raise ConfigurationError(
                    f"{name} must be None or a whole number of at least {least}, found {value!r}"
                )
        if self.n_hypotheses != "auto" and not _is_whole(self.n_hypotheses, 1):
            raise ConfigurationError(
                "n_hypotheses must be 'auto' or a whole number of at least 1, found "
                f"{self.n_hypotheses!r}"
            )
        value = self.bandwidth
        if not (isinstance(value, str) and value == "auto") and not positive_number(value):
            raise ConfigurationError(
                f"bandwidth must be 'auto' or a positive number, found {shown(value)}"
            )


def _is_whole(value: Any, least: int) -> bool:
    whole = isinstance(value, (int, np.integer)) and not isinstance(value, bool)
    return whole and value >= least


def _structure(motion: Motion, residuals: Floats) -> Structure:
    return Structure(
        inliers=motion.inliers,
        scale=motion.scale,
        limit=float(residuals[motion.inliers].max(initial=0.0)),
        point=motion.parameters,
        coefficients=motion.coefficients,
        origin=None if motion.origin is None else motion.origin[0],
        basis=None if motion.basis is None else motion.basis[0],
        matrix=motion.matrix,
    )
