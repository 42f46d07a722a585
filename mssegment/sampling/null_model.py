"""How many points fit a structure by chance: an a-contrario test without a threshold.

There are two null hypotheses, both sampled from the data. A *chimera* takes each of its
coordinates, along randomly rotated axes, from another point; with several views, its position in
each view from another point: chimeras lie where the data lie, but on no structure. A *blurred*
point is a point of the data moved by the bandwidth of a normal kernel density: blurred points keep
clusters and edges, but no structure that is sharper. What is near a structure by chance is what the
denser of both makes expect.

A structure with k of P points within the distance r is meaningful if the expected number of
structures with as many points of the null that near, the number of false alarms, is below one. The
k that makes it least says which points are inliers, whatever the noise.

References
----------
Moisan and Stival, A probabilistic criterion to detect rigid point matches between two images and
estimate the fundamental matrix, IJCV 57, 2004.
Silverman, Density estimation for statistics and data analysis, 1986.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.models import Flags, MotionModel
from mssegment.neighbours import nearest
from mssegment.records import Floats, Normalization, Record
from mssegment.special import binomial_log_tail

SAMPLES = 1000
"""Number of chimeras, and of blurred points."""
NEAR_SHARE = 0.1
"""Share of them, those nearest to a structure, that say how dense they are near it: with a hundred
the relative error is 10 %. Points further away are not called inliers."""
ROTATIONS = 8
"""Random rotations of the axes, each for an eighth of the chimeras: along a single one, a structure
may happen to lie across an axis."""
CLUSTER, LEAST_IN_CLUSTER = 0.03, 12
"""A cluster has at least this share of the points, and this number of them; smaller ones may look
like structures."""
RESOLUTION = 1e-9
"""Distances below this, over the extent of the data, are rounding errors."""


class NullModel(Record, frozen=True):
    """Samples of both null hypotheses as a model observes them, each [M, F, d].

    ``log_tests`` is the logarithm of the number of tests.
    """

    model: MotionModel
    chimeras: Floats
    blurred: Floats
    log_tests: float

    @classmethod
    def of(cls, model: MotionModel, observed: Floats, rng: np.random.Generator) -> NullModel:
        """Draw the samples for data [P, F, d], normalized."""
        return cls(
            model,
            draw_chimeras(observed, SAMPLES, rng),
            draw_blurred(observed, SAMPLES, rng),
            most_log_tests(len(observed), model.subset_size),
        )

    def radii(self, points: Floats) -> Floats:
        """The distance [B] within which ``NEAR_SHARE`` of a null are of each structure."""
        unit = Normalization(np.zeros(self.chimeras.shape[1:]), 1.0)
        radii = np.full(len(points), np.inf)
        for samples in (self.chimeras, self.blurred):
            residuals = self.model.residuals(points, samples, unit)
            nearest = int(NEAR_SHARE * len(samples)) - 1
            radii = np.minimum(radii, np.partition(residuals, nearest, axis=1)[:, nearest])
        return np.asarray(np.maximum(radii, RESOLUTION))

    def log_density(self, points: Floats) -> Floats:
        """Log of the density [B] of the null near each structure.

        Per unit of volume in the space of residual vectors.
        """
        c = self.model.residual_dimension
        log_unit_ball = 0.5 * c * math.log(math.pi) - math.lgamma(0.5 * c + 1.0)
        return np.asarray(math.log(NEAR_SHARE) - log_unit_ball - c * np.log(self.radii(points)))

    def inliers(self, points: Floats, residuals: Floats) -> tuple[Flags, Floats]:
        """The inliers of each structure, and its number of false alarms.

        Parameters
        ----------
        points : ndarray [B, ...]
            The structures.
        residuals : ndarray [B, P]
            Distances of the data from them, normalized.

        Returns
        -------
        inliers : ndarray [B, P] of bool
        log_nfa : ndarray [B]
            Natural logarithm of the expected number of false alarms.
        """
        if not len(points):
            return np.zeros(residuals.shape, dtype=bool), np.zeros(0)
        m, count = self.model.subset_size, residuals.shape[1]
        ordered = np.maximum(np.sort(residuals, axis=1), RESOLUTION)
        sizes = np.arange(1, count + 1)
        radii = self.radii(points)[:, None]
        log_share = math.log(NEAR_SHARE) + self.model.residual_dimension * np.log(ordered / radii)
        log_nfa = self.log_tests + binomial_log_tail(sizes - m, max(count - m, 1), log_share)
        # further away the density of the null is not known
        log_nfa[ordered > radii] = np.inf
        # twice the elemental subset is the least that a selection accepts
        log_nfa[:, : min(2 * m, count) - 1] = np.inf
        best = log_nfa.argmin(axis=1)
        limits = np.take_along_axis(ordered, best[:, None], axis=1)
        return np.asarray(residuals <= limits), log_nfa[np.arange(len(points)), best]


def log_nfa_in_clusters(
    null: NullModel,
    observed: Floats,
    points: Floats,
    inliers: Flags,
    rng: np.random.Generator,
) -> Floats:
    """The logarithm of the number of false alarms [B] where clusters may be however tight.

    The null are points of the data [P, F, d] that are moved about within clusters: how many of them
    are as near to a structure as its ``inliers`` [B, P]. Three tight clusters lie on a plane, and
    so does what is moved within them.
    """
    if not len(points):
        return np.zeros(0)
    model, unit = null.model, Normalization(np.zeros(observed.shape[1:]), 1.0)
    samples = draw_in_clusters(observed, SAMPLES, rng)
    residuals = model.residuals(points, observed, unit)
    limits = np.where(inliers, residuals, 0.0).max(axis=1, keepdims=True)
    near = (model.residuals(points, samples, unit) <= limits).sum(axis=1)
    log_share = np.log((near + 1.0) / (SAMPLES + 1.0))
    count, m = len(observed), model.subset_size
    hits = inliers.sum(axis=1) - m
    tail = binomial_log_tail(hits, max(count - m, 1), log_share[None])[0]
    return np.asarray(null.log_tests + tail)


def draw_chimeras(observed: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Draw ``count`` chimeras of data [P, F, d]."""
    size, frames, d = observed.shape
    if frames > 1:
        chosen = rng.integers(size, size=(count, frames))
        return np.asarray(observed[chosen, np.arange(frames)])
    parts = []
    for _ in range(ROTATIONS):
        axes, _ = np.linalg.qr(rng.standard_normal((d, d)))
        turned = observed[:, 0] @ axes
        chosen = rng.integers(size, size=(-(-count // ROTATIONS), d))
        parts.append(turned[chosen, np.arange(d)] @ axes.T)
    return np.concatenate(parts)[:count, None]


def draw_blurred(observed: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Draw ``count`` points of the kernel density of data [P, F, d], with a round kernel.

    The bandwidth is Silverman's, P^(-1 / (n + 4)) standard deviations for n = F d. Normalized data
    have the median distance 1 from their median, so that the standard deviation is d^(-1/2).
    """
    chosen = rng.integers(len(observed), size=count)
    return _moved(observed[chosen], np.full(count, _silverman(observed)), rng)


def draw_in_clusters(observed: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Draw ``count`` points of data [P, F, d] that are moved about within their clusters.

    As ``draw_blurred``, but by no more than the standard deviation of a ball about the point with
    as many of the data as the smallest cluster.
    """
    size = len(observed)
    flat = observed.reshape(size, -1)
    chosen = rng.integers(size, size=count)
    neighbour = min(max(round(CLUSTER * size), LEAST_IN_CLUSTER), size - 1)
    reach = nearest(flat, flat[chosen], neighbour + 1)[0][:, -1]
    bandwidth = np.minimum(_silverman(observed), reach / math.sqrt(flat.shape[1] + 2.0))
    return _moved(observed[chosen], bandwidth, rng)


def _silverman(observed: Floats) -> float:
    size, frames, d = observed.shape
    return float(size ** (-1.0 / (frames * d + 4.0)) / math.sqrt(d))


def _moved(points: Floats, bandwidth: Floats, rng: np.random.Generator) -> Floats:
    return np.asarray(points + bandwidth[:, None, None] * rng.standard_normal(points.shape))


def most_log_tests(count: int, m: int) -> float:
    """Log of a bound of the number of tests: elemental subsets times numbers of inliers."""
    subsets = math.lgamma(count + 1) - math.lgamma(m + 1) - math.lgamma(max(count - m, 0) + 1)
    return subsets + math.log(max(count - m, 1))
