"""Description length of a track, with and without a motion.

A track that belongs to a motion is described by its residual. The noise has heavy tails: most
corners are accurate to a fraction of a pixel, a few are several pixels off and still belong to the
motion. A multivariate Student t distribution models this with one more parameter; with a Gaussian
the same tracks would make a false motion or increase the scale of a true one. A track without a
motion is described by a uniform distribution. Everything is in nats, and a common scale of all
coordinates changes no difference.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.records import Floats, Record

DEGREES_OF_FREEDOM = 2.5
"""Of the Student t distribution of the residuals; infinity is Gaussian."""
MEDIANS_OF_COORDINATE = (0.785, 0.6745)
"""Medians of the size of such a Student t variable, and of a normal one."""
MAX_SCALE_OF_PARALLAX = 2.5
"""Largest scale of a motion, relative to the parallax that is noise."""
SCALE_ROUNDS = 4
"""Rounds of the fixed-point iteration for a scale, which converges by a factor of about 4 a
round."""


class Noise(Record, frozen=True):
    """The distribution of the residuals of one model.

    Attributes
    ----------
    dimension : int
        Dimension c of the residual vectors.
    residual_terms : int
        See ``MotionModel.residual_terms``.
    floor, cap : float
        Bounds in pixels of the scale of a motion.
    log_free_extent : float
        Nats to describe what the model leaves free.
    outlier_cost : float
        Nats to describe a track without a motion.
    parallax : ndarray [P]
        Parallax in pixels that is noise; its root mean square over the inliers is a lower bound of
        the scale, and ``MAX_SCALE_OF_PARALLAX`` times it an upper bound.
    degrees_of_freedom : float
        Of the Student t distribution.
    """

    dimension: int
    residual_terms: int
    floor: float
    cap: float
    log_free_extent: float
    outlier_cost: float
    parallax: Floats
    degrees_of_freedom: float = DEGREES_OF_FREEDOM

    def gains(self, residuals: Floats, scales: Floats) -> Floats:
        """Nats that each motion saves on each track, [B, P]; negative where it does not explain it.

        ``residuals`` [B, P] and ``scales`` [B] are in pixels.
        """
        nu, c = self.degrees_of_freedom, self.dimension
        spread = residuals**2
        if np.isinf(nu):
            spread *= self.residual_terms / (2.0 * scales[:, None] ** 2)
        else:
            spread *= self.residual_terms / (nu * scales[:, None] ** 2)
            spread += 1.0  # log is several times faster than log1p, and accurate enough here
            np.log(spread, out=spread)
            spread *= (nu + c) / 2
        return np.asarray(self.max_gain(scales)[:, None] - spread)

    def max_gain(self, scales: Floats) -> Floats:
        """Nats that motions with ``scales`` [B] save on a track that they fit exactly, [B]."""
        nu, c = self.degrees_of_freedom, self.dimension
        if np.isinf(nu):
            normalizer = c / 2 * np.log(2 * np.pi)
        else:
            normalizer = math.lgamma(nu / 2) - math.lgamma((nu + c) / 2)
            normalizer += c / 2 * np.log(nu * np.pi)
        return np.asarray(
            self.outlier_cost - self.log_free_extent - c * np.log(scales) - normalizer
        )

    def residual_at_half_gain(self, scales: Floats) -> Floats:
        """The residual in pixels at which a motion saves half of its ``max_gain``, [B]."""
        nu, gain = self.degrees_of_freedom, self.max_gain(scales)
        square = gain if np.isinf(nu) else nu * np.expm1(gain / (nu + self.dimension))
        return np.asarray(scales * np.sqrt(np.maximum(square, 0.0) / self.residual_terms))

    @property
    def log_extent(self) -> float:
        """Natural log of the extent in pixels of a residual coordinate without a motion."""
        return (self.outlier_cost - self.log_free_extent) / self.dimension

    def weights(self, residuals: Floats, scales: Floats) -> Floats:
        """Weights [B, P] with which a least-squares fit maximizes the likelihood."""
        if np.isinf(self.degrees_of_freedom):
            return np.ones_like(residuals)
        square = self.residual_terms * residuals**2 / scales[:, None] ** 2
        return np.asarray(
            (self.degrees_of_freedom + self.dimension) / (self.degrees_of_freedom + square)
        )

    def quantile(self, share: float) -> float:
        """The residual, over the scale of its motion, that a ``share`` of the tracks exceeds.

        For residual vectors of dimension 2; infinite for others.
        """
        nu = self.degrees_of_freedom
        if self.dimension != 2:
            return math.inf
        squared = -2 * math.log(share) if np.isinf(nu) else nu * (share ** (-2 / nu) - 1)
        return math.sqrt(squared / self.residual_terms)

    @property
    def median_of_coordinate(self) -> float:
        """The median size of one coordinate of a residual, over the scale of its motion."""
        return MEDIANS_OF_COORDINATE[int(np.isinf(self.degrees_of_freedom))]

    @property
    def middle(self) -> float:
        """The scale in the middle, in logarithms, between ``floor`` and ``cap``."""
        return math.sqrt(self.floor * self.cap)

    def standard_deviation(self, residuals: Floats) -> float:
        """Standard deviation in pixels of one coordinate, for tracks with these residuals [n]."""
        return float(np.sqrt(self.residual_terms * np.mean(residuals**2) / self.dimension))

    def scales(self, residuals: Floats, inliers: Floats, start: Floats | None = None) -> Floats:
        """Most likely scale of each motion [B], in pixels, given its inliers [B, P] (0 or 1)."""
        tracks = np.maximum(inliers.sum(axis=1), 1.0)
        square = self.residual_terms * inliers * residuals**2
        parallax = np.sqrt(inliers @ self.parallax**2 / tracks)
        floor = np.maximum(self.floor, parallax)
        cap = np.maximum(self.cap, MAX_SCALE_OF_PARALLAX * parallax)
        count = tracks * self.dimension
        if start is None or np.isinf(self.degrees_of_freedom):
            start = np.sqrt(square.sum(axis=1) / count)
        scales = np.clip(start, floor, cap)
        if np.isinf(self.degrees_of_freedom):
            return scales
        nu = self.degrees_of_freedom
        for _ in range(SCALE_ROUNDS):
            weighted = square / (square + (nu * scales**2)[:, None])
            mean = weighted.sum(axis=1) * (nu + self.dimension) * scales**2 / count
            scales = np.clip(np.sqrt(mean), floor, cap)
        return scales

    def free_scale(self, residuals: Floats) -> float:
        """Most likely scale of residuals [n] of one motion, in pixels, without any bounds."""
        square = self.residual_terms * residuals**2
        count = len(residuals) * self.dimension
        scale = math.sqrt(float(square.sum()) / count)
        nu = self.degrees_of_freedom
        for _ in range(0 if np.isinf(nu) or scale == 0 else SCALE_ROUNDS):
            weighted = square / (square + nu * scale**2)
            scale *= math.sqrt(float(weighted.sum()) * (nu + self.dimension) / count)
        return scale

    def initial_scales(self) -> Floats:
        """Scales at which a motion may select its first inliers, in pixels [2].

        The smallest scale, and one two thirds of the way, in logarithms, to the largest.
        """
        parallax = float(np.sqrt(np.mean(self.parallax**2))) if len(self.parallax) else 0.0
        return np.geomspace(self.floor, max(self.cap, MAX_SCALE_OF_PARALLAX * parallax), 4)[::2]


def uniform_cost(points: Floats) -> float:
    """Nats to describe a track [P, F, 2] by the extent of all tracks alone.

    In each frame, the shorter of two codes: uniform over the bounding box of all points, or over
    the disc of displacements since the previous frame up to the longest. (The bounding box of the
    displacements would depend on the motion that all tracks share.) For two views, the position in
    the first is given; for more, it is described too.
    """
    frames = points.shape[1]
    cost = sum(
        min(_log_area(points[:, f]), _log_disc(points[:, f] - points[:, f - 1]))
        for f in range(1, frames)
    )
    return cost + (_log_area(points[:, 0]) if frames > 2 else 0.0)


def _log_disc(displacements: Floats) -> float:
    """Log of the area of the disc with the longest displacement as radius."""
    longest = float(np.linalg.norm(displacements, axis=-1).max(initial=1.0))
    return float(np.log(np.pi) + 2 * np.log(longest))


def _log_area(points: Floats) -> float:
    """Log of the area of the bounding box."""
    return float(np.log(np.maximum(np.ptp(points, axis=0), 1.0)).sum())
