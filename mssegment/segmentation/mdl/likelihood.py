"""What a track costs: the length of its description with and without a motion.

A track that belongs to a motion is described by its residual, whose noise has heavy tails: most
corners are found to a fraction of a pixel, a few are several pixels off and still belong to the
body. A multivariate Student t distribution says so with one more constant; under a Gaussian the
same tracks make a false motion or widen a true one. A track that belongs to none is described as
uniform. Everything is in nats, and a common scaling of all coordinates changes no difference.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.records import Floats, Record

DEGREES_OF_FREEDOM = 2.5
"""Of the Student t distribution of the residuals; infinity would be Gaussian."""
PARALLAX_CAP = 2.5
"""Largest scale of a motion, over the parallax that is noise."""
SCALE_ROUNDS = 4
"""Rounds of the fixed point of a motion's scale; it converges by a factor of about 4 a round."""


class Noise(Record, frozen=True):
    """The residuals of one model, vectors of ``dimension`` coordinates.

    The scale of a motion lies between ``floor`` and ``cap`` pixels, and is not less than the
    ``parallax`` [P] (root mean square over its inliers), which then bounds it, too.
    ``terms`` squared residuals make the squared residual vector (``MotionModel.residual_terms``);
    ``free`` is the description of what the model leaves open, ``outlier`` that of a track without
    motion.
    """

    dimension: int
    terms: int
    floor: float
    cap: float
    free: float
    outlier: float
    parallax: Floats
    freedom: float = DEGREES_OF_FREEDOM

    def gains(self, residuals: Floats, scales: Floats) -> Floats:
        """Nats that each motion saves on each track, [B, P]; negative where it explains nothing."""
        nu, c = self.freedom, self.dimension
        spread = residuals**2
        if np.isinf(nu):
            spread *= self.terms / (2.0 * scales[:, None] ** 2)
        else:
            spread *= self.terms / (nu * scales[:, None] ** 2)
            spread += 1.0  # log is several times as fast as log1p, and this needs no more digits
            np.log(spread, out=spread)
            spread *= (nu + c) / 2
        return np.asarray(self.perfect(scales)[:, None] - spread)

    def perfect(self, scales: Floats) -> Floats:
        """Nats that motions of these ``scales`` [B] save on a track that they fit exactly, [B]."""
        nu, c = self.freedom, self.dimension
        if np.isinf(nu):
            normaliser = c / 2 * np.log(2 * np.pi)
        else:
            normaliser = math.lgamma(nu / 2) - math.lgamma((nu + c) / 2)
            normaliser += c / 2 * np.log(nu * np.pi)
        return np.asarray(self.outlier - self.free - c * np.log(scales) - normaliser)

    def half_gain(self, scales: Floats) -> Floats:
        """The residual (pixels) at which half of what a perfect fit saves is saved, [B]."""
        nu, best = self.freedom, self.perfect(scales)
        square = best if np.isinf(nu) else nu * np.expm1(best / (nu + self.dimension))
        return np.asarray(scales * np.sqrt(np.maximum(square, 0.0) / self.terms))

    @property
    def extent(self) -> float:
        """Natural log of the pixels over which a residual's coordinate spreads without a motion."""
        return (self.outlier - self.free) / self.dimension

    def weights(self, residuals: Floats, scales: Floats) -> Floats:
        """Weights of the least-squares fit that maximizes the likelihood, [B, P]."""
        if np.isinf(self.freedom):
            return np.ones_like(residuals)
        square = self.terms * residuals**2 / scales[:, None] ** 2
        return np.asarray((self.freedom + self.dimension) / (self.freedom + square))

    def deviation(self, residuals: Floats) -> float:
        """Standard deviation of one coordinate, pixels, of tracks with these residuals [n]."""
        return float(np.sqrt(self.terms * np.mean(residuals**2) / self.dimension))

    def scales(self, residuals: Floats, inliers: Floats, start: Floats | None = None) -> Floats:
        """Most likely scale of each motion [B], given its inliers [B, P] (0 or 1)."""
        tracks = np.maximum(inliers.sum(axis=1), 1.0)
        square = self.terms * inliers * residuals**2
        parallax = np.sqrt(inliers @ self.parallax**2 / tracks)
        floor = np.maximum(self.floor, parallax)
        cap = np.maximum(self.cap, PARALLAX_CAP * parallax)
        count = tracks * self.dimension
        if start is None or np.isinf(self.freedom):
            start = np.sqrt(square.sum(axis=1) / count)
        scales = np.clip(start, floor, cap)
        if np.isinf(self.freedom):
            return scales
        nu = self.freedom
        for _ in range(SCALE_ROUNDS):
            weighted = square / (square + (nu * scales**2)[:, None])
            mean = weighted.sum(axis=1) * (nu + self.dimension) * scales**2 / count
            scales = np.clip(np.sqrt(mean), floor, cap)
        return scales

    def first_scales(self) -> Floats:
        """Scales at which a motion may collect its first inliers, pixels [2].

        The least one, and one two thirds of the way (of logarithms) to the largest.
        """
        parallax = float(np.sqrt(np.mean(self.parallax**2))) if len(self.parallax) else 0.0
        return np.geomspace(self.floor, max(self.cap, PARALLAX_CAP * parallax), 4)[::2]


def uniform_cost(points: Floats) -> float:
    """Nats per track [P, F, 2] when nothing predicts it but the extent of all tracks.

    Frame by frame, the shorter of two codes: uniform over the box that holds all points, or over
    the disc of displacements from the frame before that are no longer than the longest. (The box
    that holds the displacements would know where one motion of all tracks goes.) Of two views the
    first is given; of more, every frame is described.
    """
    frames = points.shape[1]
    cost = sum(
        min(_log_area(points[:, f]), _log_disc(points[:, f] - points[:, f - 1]))
        for f in range(1, frames)
    )
    return cost + (_log_area(points[:, 0]) if frames > 2 else 0.0)


def _log_disc(displacements: Floats) -> float:
    longest = float(np.linalg.norm(displacements, axis=-1).max(initial=1.0))
    return float(np.log(np.pi) + 2 * np.log(longest))


def _log_area(points: Floats) -> float:
    return float(np.log(np.maximum(np.ptp(points, axis=0), 1.0)).sum())
