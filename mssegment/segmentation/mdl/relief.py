"""How the misfit of a rigid body that is not flat lies: along the lines to its epipole.

A map of the plane is exact for a flat body. What stands out of its plane is moved along the lines
to the epipole, as far as its depth says; across them there is nothing but noise. Two bodies that
one map fits badly misfit in both directions.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.geometry.projective import homogeneous_rows, transfer
from mssegment.records import Floats, Record
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.mdl.likelihood import Noise
from mssegment.segmentation.mdl.precision import (
    MIN_LENGTH,
    PRECISION_GAIN,
    information,
    scale_cost,
)

ROUNDS = 4
"""Rounds of the epipole, the weights and the scales."""
LARGEST_MISFIT = 1e6
"""Misfits in pixels are at most this."""
TINY = 1e-9
"""Square in pixels, and length, that keep divisions regular."""


class Misfits(Record, frozen=True):
    """Misfits (``right``, ``down``) [B, P] and predicted places (``x``, ``y``) [B, P].

    In pixels of the second view.
    """

    right: Floats
    down: Floats
    x: Floats
    y: Floats

    @classmethod
    def of(cls, observed_set: ObservedSet, points: Floats) -> Misfits:
        """The misfits of maps of the plane, ``points`` [B, 3, 3]."""
        observed = observed_set.observed
        scale = observed_set.hypotheses.normalization.scale
        x, y, depth = transfer(points, homogeneous_rows(observed[:, 0]))
        misfits = [
            np.where(depth > 0, (seen - predicted) * scale, LARGEST_MISFIT)
            for seen, predicted in ((observed[:, 1, 0], x), (observed[:, 1, 1], y))
        ]
        right, down = (np.clip(one, -LARGEST_MISFIT, LARGEST_MISFIT) for one in misfits)
        return cls(right, down, x * scale, y * scale)

    @property
    def lengths(self) -> Floats:
        """Residuals [B, P] in pixels."""
        return np.hypot(self.right, self.down)


class Relief(Record, frozen=True):
    """Scales of misfits in pixels, and the misfits [B, P] in units that make them alike.

    Attributes
    ----------
    across, along : ndarray [B]
        Scales across the lines to the epipole, and along them; the noise and the parallax that
        every body may have are lower bounds.
    free : ndarray [B]
        The scale along the lines without bounds.
    least : ndarray [B]
        Its lower bound.
    told : ndarray [B]
        Nats to tell the epipole, as precisely as the misfits show it.
    residuals : ndarray [B, P]
        Lengths of the misfits, each direction over its scale, times ``scales``.
    """

    across: Floats
    along: Floats
    free: Floats
    least: Floats
    told: Floats
    residuals: Floats

    @property
    def scales(self) -> Floats:
        """Geometric means of both scales [B]: those of the isotropic noise of the same density."""
        return np.sqrt(self.across * self.along)

    @property
    def shapes(self) -> Floats:
        """The scales across, along, along without bounds, and their bound; the epipole [B, 5]."""
        return np.stack([self.across, self.along, self.free, self.least, self.told], axis=1)

    def where_it_pays(self, lengths: Floats, inliers: Floats, noise: Noise) -> Relief:
        """The same, but isotropic where relief saves less on the ``inliers`` than it costs.

        ``lengths`` [B, P] are those of the misfits, in pixels.
        """
        scales = noise.scales(lengths, inliers)
        gains = noise.gains(self.residuals, self.scales) - noise.gains(lengths, scales)
        count = np.maximum(inliers.sum(axis=1), 1.0).astype(np.int64).tolist()
        prices = [relief_cost(*each, noise) for each in zip(self.shapes, count, strict=True)]
        pays = (inliers * gains).sum(axis=1) > np.array(prices)
        return Relief(
            np.where(pays, self.across, scales),
            np.where(pays, self.along, scales),
            np.where(pays, self.free, scales),
            self.least,
            np.where(pays, self.told, 0.0),
            np.where(pays[:, None], self.residuals, lengths),
        )

    @classmethod
    def of(cls, misfits: Misfits, inliers: Floats, noise: Noise) -> Relief:
        """The most likely relief of each motion, given its ``inliers`` [B, P] (0 or 1).

        The epipole is where the lines through the predicted places with the directions of the
        misfits meet, by weighted least squares. Places have their origin at the mean of the
        inliers and unit radius, so that isotropic noise prefers no epipole.
        """
        nu = noise.degrees_of_freedom
        count = np.maximum(inliers.sum(axis=1), 1.0)
        places = _centred(misfits, inliers, count)
        right, down = misfits.right, misfits.down
        square = right**2 + down**2
        lines = np.stack([-down, right, down * places[0] - right * places[1]], axis=1)
        least = np.maximum(noise.floor, np.sqrt(inliers @ noise.parallax**2 / count))
        start = np.maximum(np.sqrt((inliers * square).sum(axis=1) / (2 * count)), noise.floor)
        scaled = square / start[:, None] ** 2
        for _ in range(ROUNDS):
            weights = inliers * _weights(scaled, nu)
            normal = (weights[:, None] * lines) @ np.swapaxes(lines, 1, 2)
            values, vectors = np.linalg.eigh(normal)
            across_square, distances = _across(lines, places, vectors[:, :, 0])
            along_square = np.maximum(square - across_square, 0.0)
            free = np.sqrt((weights * along_square).sum(axis=1) / count)
            across = np.sqrt((weights * across_square).sum(axis=1) / count)
            across = np.clip(across, noise.floor, noise.cap)
            along = np.maximum(np.maximum(free, least), across)
            scaled = across_square / across[:, None] ** 2 + along_square / along[:, None] ** 2
        distance = (inliers * distances).sum(axis=1) / count
        told = _epipole_cost((values - values[:, :1])[:, 1:], across**-2 - along**-2, distance)
        residuals = np.sqrt(scaled * (across * along)[:, None])
        return cls(across, along, free, least, told, residuals)


def relief_cost(shape: Floats, count: int, noise: Noise) -> float:
    """Nats to code the scales of ``count`` tracks (a row of ``Relief.shapes``), and the epipole.

    The scale along the lines is anything up to the extent of the scene, or, in another code, its
    lower bound, which loses what the scale beyond it saves; which code it is costs ln 2.
    """
    across, _, free, least, told = shape.tolist()
    nu = noise.degrees_of_freedom
    total = math.log(2.0) + scale_cost((noise.floor, noise.cap), 1, count, nu)
    beyond = max(math.log(max(free, MIN_LENGTH) / max(least, across)), 0.0)
    total += min(
        scale_cost((noise.floor, math.exp(noise.log_extent)), 1, count, nu),
        0.5 * count * information(1, nu) * beyond**2,
    )
    return float(total + told)


def misfit_across(shape: Floats, residuals: Floats, lengths: Floats) -> Floats:
    """Misfits [n] in pixels across the lines of a motion with relief (a row of ``Relief.shapes``).

    From the ``residuals`` [n], each direction over its scale, and the ``lengths`` [n].
    """
    across, along = shape[0], shape[1]
    square = residuals**2 / (across * along) - lengths**2 / along**2
    return np.asarray(np.sqrt(np.maximum(square / (across**-2 - along**-2), 0.0)))


def _weights(scaled: Floats, freedom: float) -> Floats:
    """Weights of squared misfits of two dimensions, over the squared scale."""
    if np.isinf(freedom):
        return np.ones_like(scaled)
    return (freedom + 2) / (freedom + scaled)


def _centred(misfits: Misfits, inliers: Floats, count: Floats) -> tuple[Floats, Floats]:
    """Predicted places (x, y) [B, P] about those of the inliers, in units of their radius."""
    x, y = (
        each - ((inliers * each).sum(axis=1) / count)[:, None] for each in (misfits.x, misfits.y)
    )
    radius = np.sqrt((inliers * (x**2 + y**2)).sum(axis=1) / (2 * count) + TINY)[:, None]
    return x / radius, y / radius


def _epipole_cost(curvatures: Floats, precision: Floats, distance: Floats) -> Floats:
    """Nats to tell epipoles: points of the half-sphere, to the precision of the misfits.

    ``curvatures`` [B, 2] are those of the squared misfits across the lines, times the squared
    ``distance`` [B] from the epipole; ``precision`` [B] is their factor in the log-likelihood. Of a
    flat motion any epipole will do.
    """
    known = curvatures * (precision / np.maximum(distance, TINY))[:, None]
    each = 0.5 * math.log(2.0 * math.pi) + 0.5 * np.log(np.maximum(known, TINY)) - PRECISION_GAIN
    return np.asarray(np.maximum(each, 0.0).sum(axis=1))


def _across(
    lines: Floats, places: tuple[Floats, Floats], epipoles: Floats
) -> tuple[Floats, Floats]:
    """Squared misfits [B, P] across the lines to the ``epipoles`` [B, 3], squared distances."""
    algebraic = (epipoles[:, None] @ lines)[:, 0]
    x = epipoles[:, :1] - epipoles[:, 2:] * places[0]
    y = epipoles[:, 1:2] - epipoles[:, 2:] * places[1]
    square = x**2 + y**2 + TINY
    return np.asarray(algebraic**2 / square), np.asarray(square)
