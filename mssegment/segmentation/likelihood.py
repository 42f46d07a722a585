"""What a track costs: the length of its description with and without a motion.

A track that belongs to a motion is described by its residual, whose noise has heavy tails: most
corners are found to a fraction of a pixel, a few are several pixels off and still belong to the
body. A multivariate Student t distribution says so with one more constant; under a Gaussian the
same tracks make a false motion or widen a true one. A track that belongs to none is described as
uniform. Everything is in nats, and a common scaling of all coordinates changes no difference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from mssegment.records import Floats

DEGREES_OF_FREEDOM = 2.5
"""Of the Student t distribution of the residuals; infinity would be Gaussian."""
PARALLAX_CAP = 2.5
"""Largest scale of a motion, over the parallax that is noise."""
SCALE_ROUNDS = 4
"""Rounds of the fixed point of a motion's scale; it converges by a factor of about 4 a round."""


@dataclass(frozen=True)
class Noise:
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
        square = self.terms * residuals**2 / scales[:, None] ** 2
        if np.isinf(nu):
            spread = c / 2 * np.log(2 * np.pi) + square / 2
        else:
            normaliser = gammaln(nu / 2) - gammaln((nu + c) / 2) + c / 2 * np.log(nu * np.pi)
            spread = normaliser + (nu + c) / 2 * np.log1p(square / nu)
        return np.asarray(self.outlier - self.free - c * np.log(scales)[:, None] - spread)

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
        count = np.maximum(inliers.sum(axis=1), 1.0) * self.dimension
        square = np.where(inliers > 0, self.terms * residuals**2, 0.0)
        rms = np.sqrt(square.sum(axis=1) / count)
        parallax = np.sqrt((inliers > 0) @ self.parallax**2 / np.maximum(inliers.sum(axis=1), 1.0))
        floor = np.maximum(self.floor, parallax)
        cap = np.maximum(self.cap, PARALLAX_CAP * parallax)
        scales = np.clip(rms if start is None else start, floor, cap)
        for _ in range(SCALE_ROUNDS):
            weighted = np.where(inliers > 0, self.weights(residuals, scales), 0.0) * square
            scales = np.clip(np.sqrt(weighted.sum(axis=1) / count), floor, cap)
        return scales


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
