"""A-contrario tests of tracks: do they move together more than chance explains?

Two null hypotheses are sampled from the tracks themselves. A *chimera* takes its position in each
frame from another track: chimeras lie where tracks lie, but move like no object. A *random walk*
starts where a track starts and takes each step from another track, with a random sign: walks move
as smoothly and as far as tracks do, but not together.

A track is meaningful if the expected number of chimeras that fit their neighbourhood as well as the
track fits its own, the number of false alarms, is below one.

References
----------
Desolneux, Moisan and Morel, From Gestalt Theory to Image Analysis, 2008.
Moisan and Stival, A probabilistic criterion to detect rigid point matches between two images and
estimate the fundamental matrix, IJCV 57, 2004.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from mssegment.models import Flags
from mssegment.neighbours import nearest, nearest_others
from mssegment.records import Floats, Integers

FLATS_PER_TRACK = 4
"""Affine flats of which each track is the seed."""
SEED_NEIGHBOURS = 12
"""A flat is fitted to its seed and others of this many nearest tracks."""
FLAT_DIMENSION = 3
"""Tracks of a rigid object under an affine camera lie on an affine 3-flat."""
TESTED_NEIGHBOURS = 20
"""A track is tested against the flats of this many nearest tracks."""
GOOD_SHARE = 0.05
"""The residual of a track is this quantile over the flats around it, since most flats mix objects
or hold an outlier where an object is small or outliers are many."""
TAIL = 0.1
"""Quantile of the residuals of a null hypothesis below which its tail is extrapolated, and with
which tracks are compared with random walks."""
ROUNDS = 2
"""Comparisons with random walks, each without the outliers of the one before."""
MIN_SAMPLES, MAX_SAMPLES = 200, 500
"""Bounds of the number of chimeras or walks; in between, one for each track."""
WALK_RESIDUAL = 3.0
"""A track is like random walks only if its residual exceeds that of the good tracks by this factor;
otherwise noise hides how it moves."""
LUCKY_WALKS = 0.02
"""Share of random walks that seem to move along with an object."""
GOOD_TRACKS = 0.25
"""Quantile of the residuals that stands for the good tracks: three quarters may be outliers."""
BLOCK = 50_000
"""Pairs of a track and a seed that are treated at a time, to bound the memory."""


def log_false_alarms(points: Floats, rng: np.random.Generator) -> Floats:
    """Logarithm of the expected number of false alarms of each track.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Complete tracks in pixels.
    rng : numpy.random.Generator
        Draws the flats and the samples of the null hypotheses.

    Returns
    -------
    ndarray [P]
        Nats; below 0 the track is meaningful. Infinite for tracks that fit no better than random
        walks do.
    """
    tracks = len(points)
    if tracks <= FLAT_DIMENSION + 1:
        return np.full(tracks, np.inf)
    flats = LocalFlats(points, rng)
    own = flats.own_residuals()
    log_nfa = np.log(tracks) + log_tail(
        own, flats.residuals_of(draw_chimeras(points, flats.samples, rng))
    )
    # without the walks, the flats around the other tracks hold fewer outliers
    for _ in range(ROUNDS):
        meaningful = np.flatnonzero(log_nfa < 0)
        if len(meaningful) <= FLAT_DIMENSION + 1:
            break
        walks = meaningful[like_walks(points[meaningful], rng)]
        log_nfa[walks] = np.inf
        if not len(walks):
            break
    return np.asarray(log_nfa)


def like_walks(points: Floats, rng: np.random.Generator) -> Flags:
    """Which tracks [P, F, 2] move like random walks among others that do not, [P].

    What is not quite rigid but moves with an object, as a neck does with a head, deviates from the
    object smoothly and by less than it moves. Such tracks are not like walks.
    """
    flats = LocalFlats(points, rng)
    own = flats.own_residuals()
    samples = draw_walks(points, flats.samples, rng)
    walks = flats.residuals_of(samples)
    good = float(np.quantile(own, GOOD_TRACKS))
    poor = own > max(float(np.quantile(walks, TAIL)), WALK_RESIDUAL * good)
    moves_along = own / spread_of_tracks(points) <= np.quantile(
        walks / spread_of_tracks(samples), LUCKY_WALKS
    )
    smooth = own > WALK_RESIDUAL * noise_of_tracks(points)
    return np.asarray(poor & ~(moves_along & smooth))


def spread_of_tracks(points: Floats) -> Floats:
    """Root mean square distance of tracks [P, F, 2] from their mean positions, [P].

    Over the frames in which a track is visible.
    """
    seen = np.isfinite(points)
    frames = np.maximum(seen.all(axis=2).sum(axis=1), 1)
    middle = np.where(seen, points, 0.0).sum(axis=1) / frames[:, None]
    squared = np.where(seen, points - middle[:, None], 0.0) ** 2
    return np.asarray(np.sqrt(squared.sum(axis=2).sum(axis=1) / frames) + 1e-12)


def noise_of_tracks(points: Floats) -> Floats:
    """Standard deviation [P] of the noise that second differences of tracks [P, F, 2] show.

    Infinite for tracks without three frames in a row.
    """
    bends = np.diff(points, n=2, axis=1)
    seen = np.isfinite(bends)
    known = seen.sum(axis=(1, 2))
    squared = (np.where(seen, bends, 0.0) ** 2).sum(axis=(1, 2)) / np.maximum(known, 1)
    return np.where(known > 0, np.sqrt(squared / 6), np.inf)


def draw_chimeras(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Tracks [count, F, 2] whose position in each frame is that of a random track."""
    tracks, frames = points.shape[:2]
    return np.asarray(points[rng.integers(tracks, size=(count, frames)), np.arange(frames)])


def draw_walks(points: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Tracks [count, F, 2] with random starts and steps of random tracks, of random sign."""
    tracks, frames = points.shape[:2]
    steps = np.diff(points, axis=1)
    chosen = steps[rng.integers(tracks, size=(count, frames - 1)), np.arange(frames - 1)]
    signs = rng.choice([-1.0, 1.0], size=(count, frames - 1, 1))
    starts = points[rng.integers(tracks, size=count), 0]
    path = np.cumsum(signs * chosen, axis=1)
    return np.asarray(starts[:, None] + np.concatenate([np.zeros((count, 1, 2)), path], axis=1))


def log_tail(values: Floats, null: Floats) -> Floats:
    """Logarithm of the probability of so small a value under the null hypothesis.

    Empirical above the TAIL quantile q of the ``null`` values, below it a power law
    TAIL (value / q)^alpha. Half of the values below q lie within their median, which gives
    alpha, the dimension in which residuals are small by chance.
    """
    q = float(np.quantile(null, TAIL))
    low = null[(null < q) & (null > 0)]
    alpha = math.log(2) / max(float(np.median(np.log(q / low))), 1e-3) if len(low) else 1.0
    share = np.searchsorted(np.sort(null), values) / len(null)
    relative = np.maximum(values / max(q, 1e-300), 1e-12)
    extrapolated = math.log(TAIL) + alpha * np.log(relative)
    return np.where(values < q, extrapolated, np.log(np.maximum(share, TAIL)))


class LocalFlats:
    """Affine flats through each track and some of its neighbours, in R^2F.

    Parameters
    ----------
    points : ndarray [P, F, 2]
        Complete tracks in pixels.
    rng : numpy.random.Generator
        Draws the neighbours.
    """

    def __init__(self, points: Floats, rng: np.random.Generator) -> None:
        tracks = len(points)
        self._vectors = points.reshape(tracks, -1)
        around = min(SEED_NEIGHBOURS, tracks - 1)
        self._near = nearest_others(self._vectors, max(around, min(TESTED_NEIGHBOURS, tracks - 1)))
        seeds = np.repeat(np.arange(tracks), FLATS_PER_TRACK)
        order = rng.random((len(seeds), around)).argsort(axis=1)[:, : min(FLAT_DIMENSION, around)]
        others = np.take_along_axis(self._near[seeds][:, :around], order, axis=1)
        self._fitted = others.reshape(tracks, FLATS_PER_TRACK, -1)
        edges = self._vectors[others] - self._vectors[seeds][:, None]
        directions = np.linalg.qr(np.swapaxes(edges, 1, 2))[0]
        self._directions = np.swapaxes(directions, 1, 2).reshape(tracks, -1, self._vectors.shape[1])

    def own_residuals(self) -> Floats:
        """Residual [P] of each track from the flats around it that are not fitted to it."""
        return self._residuals(self._vectors, self._near, np.arange(len(self._vectors)))

    @property
    def samples(self) -> int:
        """How many samples of a null hypothesis these tracks need."""
        return int(np.clip(len(self._vectors), MIN_SAMPLES, MAX_SAMPLES))

    def residuals_of(self, samples: Floats) -> Floats:
        """Residuals [n] of other tracks [n, F, 2] from the flats around them."""
        vectors = samples.reshape(len(samples), -1)
        near = nearest(self._vectors, vectors, self._near.shape[1])[1]
        return self._residuals(vectors, near, None)

    def _residuals(self, vectors: Floats, near: Integers, own: Integers | None) -> Floats:
        """Root mean square residual per free coordinate, pixels [n].

        The GOOD_SHARE quantile over the flats seeded by the tracks ``near`` [n, k], without those
        fitted to the track ``own`` [n] itself.
        """
        free = max(vectors.shape[1] - FLAT_DIMENSION, 1)
        squared = self._squared_distances(vectors, near)
        if own is not None:
            fitted = self._fitted[near] == own[:, None, None, None]
            squared[fitted.any(axis=3)] = np.inf
        squared = squared.reshape(len(vectors), -1)
        squared.sort(axis=1)
        usable = np.isfinite(squared).sum(axis=1)
        rank = np.minimum((GOOD_SHARE * usable).astype(int), squared.shape[1] - 1)
        return np.asarray(np.sqrt(squared[np.arange(len(squared)), rank] / free))

    def _squared_distances(self, vectors: Floats, near: Integers) -> Floats:
        """From the flats of the seeds ``near`` [n, k], squared pixels [n, k, flats of a seed].

        One product for each seed, of all vectors that are near it, is several times faster than
        gathering the directions of the flats of every vector.
        """
        seeds = near.ravel()
        order = np.argsort(seeds, kind="stable")
        rows, sorted_seeds = order // near.shape[1], seeds[order]
        squared = np.empty((len(seeds), FLATS_PER_TRACK))
        for start in range(0, len(seeds), BLOCK):
            block = slice(start, start + BLOCK)
            of_block = sorted_seeds[block]
            gap = vectors[rows[block]] - self._vectors[of_block]
            along = np.empty((len(gap), self._directions.shape[1]))
            ends = [0, *(np.flatnonzero(np.diff(of_block)) + 1).tolist(), len(gap)]
            for first, last in pairwise(ends):
                directions = self._directions[of_block[first]]
                np.matmul(gap[first:last], directions.T, out=along[first:last])
            within = (along**2).reshape(len(gap), FLATS_PER_TRACK, -1).sum(axis=2)
            squared[order[block]] = np.einsum("nd,nd->n", gap, gap)[:, None] - within
        return np.maximum(squared, 0.0).reshape(*near.shape, FLATS_PER_TRACK)
