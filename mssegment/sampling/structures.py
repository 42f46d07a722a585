"""Hypotheses of structures in data that is no picture: guided sampling without a threshold.

The share of a structure may be small, and a clean elemental subset rare: of three hyperplanes of
R^5 among 50 % outliers, 0.04 % of the subsets are of one. So each subset is only a start. Its
hypothesis is refitted to the inliers that the a-contrario test finds (``null_model``), which makes
about thirty times as many of them good; those that remain meaningful are kept. Half of the subsets
are a seed and some of its neighbours, half are drawn from all points; half of each start where no
meaningful structure is yet.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.errors import DataError
from mssegment.models import Flags, MotionModel
from mssegment.neighbours import nearest_others
from mssegment.progress import track
from mssegment.records import Floats, HypothesisSet, Integers, Normalization, Record, State, replace
from mssegment.sampling.neighbourhoods import random_subset
from mssegment.sampling.null_model import (
    NullModel,
    draw_blurred,
    draw_chimeras,
    log_nfa_in_clusters,
)
from mssegment.sampling.options import Sampling, SamplingOptions
from mssegment.special import median

SUBSETS_PER_BATCH = 500
"""Subsets drawn and optimized at a time."""
OPTIMIZATION_ROUNDS = 4
"""Refits of a hypothesis to the inliers that the test finds."""
MAX_LOG_NFA = math.log(0.01)
"""Largest logarithm of the expected number of false alarms: one in a hundred sets of data."""
FINAL_ROUNDS = 10
"""The same for those that are kept."""
DOMINATED = 0.5
"""A hypothesis that is less meaningful than this share of the best one of its points is dropped."""
MIN_DRAWS, MAX_DRAWS = 4000, 20000
"""Bounds of an automatic number of subsets: at 1 s a few thousand of them. Below the upper one,
sampling goes on while it finds something new."""
SPARSE_DRAWS = 12000
"""The least number where some structure was found, but few hypotheses: others may be as rare."""
MIN_HYPOTHESES = 300
"""So many meaningful hypotheses are enough, if the last batch found nothing new."""
NOTHING_NEW = 3
"""Sampling ends after this many batches that hardly make the points more meaningful."""
NEIGHBOURS = 12
"""Nearest points from which a local subset is drawn, if its model needs no more."""
NULL_SETS = 4
"""Sets of data of the null in which the number of tests is measured."""
MAX_POINTS = 4000
"""Points that are sampled; of more, a random subset."""


class _Data(Record, frozen=True):
    """The points as the model observes them, and what the sampler needs to know about them."""

    model: MotionModel
    observed: Floats
    neighbours: Integers
    null: NullModel

    @classmethod
    def of(cls, model: MotionModel, observed: Floats, rng: np.random.Generator) -> _Data:
        """The neighbours and the null of data [P, F, d], normalized."""
        count = len(observed)
        near = nearest_others(observed.reshape(count, -1), _neighbours(model, count))
        return cls(model, observed, near, NullModel.of(model, observed, rng))


def sample_structures(
    points: Floats,
    model: MotionModel,
    options: SamplingOptions,
    *,
    eligible: Flags | None = None,
    rng: np.random.Generator,
) -> HypothesisSet:
    """Sample hypotheses of structures, and keep the meaningful ones.

    Parameters
    ----------
    points : ndarray [P, F, d]
        The data; points that are not finite are not sampled.
    model : MotionModel
        The model, for this F and d.
    options : SamplingOptions
        Number of hypotheses, and whether subsets are only drawn uniformly.
    eligible : ndarray [P] of bool, optional
        Points that may be sampled; all by default.
    rng : numpy.random.Generator
        Source of random numbers.

    Returns
    -------
    HypothesisSet
        Without hypotheses if no structure is meaningful.

    Raises
    ------
    DataError
        If there are too few points, or all elemental subsets are degenerate.

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.models import make
    >>> rng = np.random.default_rng(0)
    >>> points = rng.uniform(-1, 1, (90, 1, 2))
    >>> points[:40, 0, 1] = 0.3 * points[:40, 0, 0] + 0.01 * rng.standard_normal(40)
    >>> found = sample_structures(points, make("line"), SamplingOptions(), rng=rng)
    >>> found.manifold, len(found.points) > 100
    ('grassmann(3,1)', True)
    """
    complete = np.asarray(np.isfinite(points).all(axis=(1, 2)))
    usable = complete if eligible is None else complete & eligible
    indices = np.flatnonzero(random_subset(usable, MAX_POINTS, rng))
    needed = 2 * model.subset_size
    if len(indices) < needed:
        raise DataError(
            f"model {model.name} needs at least {needed} points, twice an elemental subset; found "
            f"{len(indices)}"
        )
    normalization = model.normalization(points[indices])
    observed = model.observe(points[indices], normalization)
    data = _Data.of(model, observed, rng)
    data = replace(data, null=replace(data.null, log_tests=measured_log_tests(data, options, rng)))
    subsets, found, drawn = _sample(data, options, rng)
    found, kept = finished(data.null, observed, found, rng)
    subsets, found = subsets[kept], found[kept]
    return HypothesisSet(
        model=model.name,
        manifold=model.manifold.name,
        frames=tuple(range(points.shape[1])),
        normalization=normalization,
        subsets=indices[subsets],
        points=found,
        drawn=drawn,
    )


def measured_log_tests(data: _Data, options: SamplingOptions, rng: np.random.Generator) -> float:
    """The logarithm of the number of tests, from what a run finds in data of the null.

    The bound that counts all elemental subsets is far too large, as most hypotheses are nearly the
    same. With this number the best hypothesis of a run on data without structures has about one
    false alarm: the median of ``NULL_SETS`` of them, each with one batch of subsets.
    """
    size, most = len(data.observed), data.null.log_tests
    lowest = []
    for draw in (draw_chimeras, draw_blurred) * (NULL_SETS // 2):
        other = _Data.of(data.model, draw(data.observed, size, rng), rng)
        chosen = _draw(other, options.sampling, np.ones(size, dtype=bool), rng)
        points, regular = data.model.minimal_fit(other.observed[chosen])
        _, _, log_nfa = optimized(other.null, other.observed, points[regular])
        lowest.append(float(log_nfa.min(initial=most)) - most)
    return min(most, math.log(MIN_DRAWS / SUBSETS_PER_BATCH) - median(np.array(lowest)))


def _neighbours(model: MotionModel, count: int) -> int:
    return min(max(NEIGHBOURS, 2 * model.subset_size), count - 1)


def _sample(
    data: _Data, options: SamplingOptions, rng: np.random.Generator
) -> tuple[Integers, Floats, int]:
    """Elemental subsets [n, k], meaningful hypotheses [n, ...], and the number of subsets drawn."""
    model, automatic = data.model, options.count == "auto"
    target = MIN_HYPOTHESES if options.count == "auto" else options.count
    progress = _Progress(np.zeros(len(data.observed)))
    subsets: list[Integers] = []
    found: list[Floats] = []
    drawn = valid = kept = unchanged = 0
    limit = MAX_DRAWS if automatic else max(SUBSETS_PER_BATCH, 20 * target)
    for _ in track(range(math.ceil(limit / SUBSETS_PER_BATCH)), "batches"):
        chosen = _draw(data, options.sampling, progress.largest == 0.0, rng)
        points, regular = model.minimal_fit(data.observed[chosen])
        chosen, points = chosen[regular], points[regular]
        points, inliers, log_nfa = optimized(data.null, data.observed, points)
        meaningful = log_nfa < MAX_LOG_NFA
        drawn, valid = drawn + SUBSETS_PER_BATCH, valid + len(chosen)
        kept += int(meaningful.sum())
        subsets.append(chosen[meaningful])
        found.append(points[meaningful])
        stalled = progress.add(inliers[meaningful], -log_nfa[meaningful])
        unchanged = unchanged + 1 if stalled else 0
        if (
            automatic
            and unchanged
            and (
                kept >= MIN_HYPOTHESES
                or (drawn >= (SPARSE_DRAWS if kept else MIN_DRAWS) and unchanged >= NOTHING_NEW)
            )
        ):
            break
        if not automatic and kept >= target:
            break
    if not valid:
        raise DataError(
            f"all {drawn} elemental subsets are degenerate for model {model.name}: the points lie "
            "on a structure of fewer dimensions; choose another model"
        )
    most = len(np.concatenate(subsets)) if automatic else target
    return np.concatenate(subsets)[:most], np.concatenate(found)[:most], drawn


def optimized(
    null: NullModel, observed: Floats, points: Floats, rounds: int = OPTIMIZATION_ROUNDS
) -> tuple[Floats, Flags, Floats]:
    """Refit hypotheses [B, ...] to their inliers, as long as that makes them more meaningful.

    Returns the hypotheses, their inliers [B, P], and the logarithm of their number of false alarms.
    """
    model = null.model
    unit = Normalization(np.zeros(observed.shape[1:]), 1.0)
    points = points.copy()
    inliers, log_nfa = null.inliers(points, model.residuals(points, observed, unit))
    active = np.arange(len(points))
    for _ in range(rounds):
        if not len(active):
            break
        fitted, valid = model.algebraic_fit(observed, inliers[active].astype(np.float64))
        rows, fitted = active[valid], fitted[valid]
        now, nfa = null.inliers(fitted, model.residuals(fitted, observed, unit))
        better = nfa < log_nfa[rows]
        active = rows[better]
        points[active], inliers[active], log_nfa[active] = fitted[better], now[better], nfa[better]
    return points, inliers, log_nfa


def finished(
    null: NullModel, observed: Floats, points: Floats, rng: np.random.Generator
) -> tuple[Floats, Flags]:
    """Refit hypotheses [B, ...] to the end, and say which are good ones of a structure.

    A mixture of two structures may be meaningful too, but less than each of them is to its own
    points. A hypothesis is kept if it is at least half as meaningful as the best one of its median
    inlier, and meaningful also where the data are clusters.
    """
    points, inliers, log_nfa = optimized(null, observed, points, FINAL_ROUNDS)
    evidence = np.maximum(-log_nfa, 0.0)
    if not len(points):
        return points, np.zeros(0, dtype=bool)
    best = (inliers * evidence[:, None]).max(axis=0)
    usual = np.array([median(best[own]) if own.any() else np.inf for own in inliers])
    kept = evidence >= DOMINATED * usual
    in_clusters = log_nfa_in_clusters(null, observed, points[kept], inliers[kept], rng)
    kept[kept] = in_clusters < MAX_LOG_NFA
    return points, np.asarray(kept)


def _draw(data: _Data, sampling: Sampling, left: Flags, rng: np.random.Generator) -> Integers:
    """Elemental subsets [SUBSETS_PER_BATCH, k] of distinct points, a quarter of each kind."""
    k, count = data.model.subset_size, len(data.observed)
    rest = np.flatnonzero(left)
    if len(rest) <= 2 * k:
        rest = np.arange(count)
    half = SUBSETS_PER_BATCH // 2
    parts = []
    for pool in (np.arange(count), rest):
        local = 0 if sampling == "uniform" else half // 2
        parts.append(pool[_distinct(len(pool), k, half - local, rng)])
        seeds = rng.choice(pool, size=local)
        columns = _distinct(data.neighbours.shape[1], k - 1, local, rng)
        near = np.take_along_axis(data.neighbours[seeds], columns, axis=1)
        parts.append(np.concatenate([seeds[:, None], near], axis=1))
    return np.concatenate(parts)


def _distinct(count: int, k: int, size: int, rng: np.random.Generator) -> Integers:
    """``size`` rows of ``k`` distinct numbers below ``count``."""
    chosen = rng.integers(count, size=(size, k))
    while True:
        repeated = (np.diff(np.sort(chosen, axis=1), axis=1) == 0).any(axis=1)
        if not repeated.any():
            return np.asarray(chosen, dtype=np.int64)
        if 2 * k > count:
            order = rng.random((size, count)).argsort(axis=1)
            return np.asarray(order[:, :k], dtype=np.int64)
        chosen[repeated] = rng.integers(count, size=(int(repeated.sum()), k))


class _Progress(State):
    """How meaningful the best structure of each point is, [P]; 0 for none."""

    largest: Floats

    def add(self, inliers: Flags, evidence: Floats) -> bool:
        """Add hypotheses; whether they make the points hardly more meaningful, by 1 %."""
        before = self.largest.mean()
        if len(inliers):
            self.largest = np.maximum(self.largest, (inliers * evidence[:, None]).max(axis=0))
        return bool(self.largest.mean() <= 1.01 * before)
