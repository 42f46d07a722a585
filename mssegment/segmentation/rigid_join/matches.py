"""Which matches belong to a rigid body, given its epipolar geometry and its depths.

The motions that a body was joined from are those of planes, as wide as the relief about them: what
is within reach of one of them may be a mismatch. Across its epipolar line a match of the body is
as precise as the noise; along it, it is about where its neighbours are, or at least within the
depths of the body.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.geometry.epipolar import sampson
from mssegment.geometry.epipolar_fit import fit_epipolar
from mssegment.geometry.projective import homogeneous
from mssegment.models import Flags
from mssegment.neighbours import nearest, without
from mssegment.records import Floats, Integers
from mssegment.segmentation.rigid_join.depths import NORMAL_DEVIATION, EpipolarCoordinates
from mssegment.segmentation.rigid_join.epipoles import FREEDOM, SCALE_OF_NOISE
from mssegment.segmentation.rigid_join.residuals import noise_of_groups
from mssegment.special import median

NEIGHBOURS = 8
"""Nearest matches of the body whose depth predicts that of a match; as for labels."""
SAMPLED_MATCHES = 200
"""Matches of the body whose depths predict that of any match."""
WIDTHS = 2.0 ** np.arange(9)
"""Widths of the kernels of depth about neighbours, over the scale of the noise."""
WIDE = 4
"""Every second one of the widths from this one on is also one about all depths of the body."""
MIXTURE_ROUNDS = 50
"""Rounds of expectation and maximization of the shares of the kernels."""


def body_gains(points: Floats, members: Flags, noise: float, outlier_cost: float) -> Floats:
    """Nats that a rigid body saves on each match, relative to a match without a motion.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.
    members : ndarray [P] of bool
        The matches of the body, to which its epipolar geometry is fitted.
    noise : float
        Noise of the matches in pixels (``preprocessing.noise``); less where the epipolar geometry
        of the body leaves less.
    outlier_cost : float
        Nats to describe where a match without a motion is in the second view.

    Returns
    -------
    ndarray [P]

    Notes
    -----
    Across the line the density is a Student t distribution at the scale of the noise, or of the
    matches of the body if that is larger. Along it, it is a mixture of kernels of several widths
    about the inverse depths of the nearest matches of the body and of all of them; the shares are
    the most likely ones for the matches of the body.
    """
    own = np.flatnonzero(members)
    noise = noise_of_groups(points, [members], noise)
    centres = points[own].mean(axis=0)
    unit = math.sqrt(float(((points[own] - centres) ** 2).sum(axis=-1).mean()) / 2)
    matches, scale = (points - centres) / unit, SCALE_OF_NOISE * noise / unit
    first, second = matches[:, 0], matches[:, 1]
    fit = fit_epipolar(first[own], second[own], np.ones(len(own)), scale)
    coordinates = EpipolarCoordinates.of(fit, first[own], second[own], scale)
    found = coordinates.inverse_depth(first, second)
    log_along = _log_density(first, found.values, own, scale) - np.log(found.distances)
    # a Sampson distance spreads the error over both views
    error = sampson(fit.matrix[None], homogeneous(first), homogeneous(second)).error[0]
    across = math.sqrt(2.0) * np.abs(error)
    width = max(scale, SCALE_OF_NOISE * NORMAL_DEVIATION * median(across[own]))
    log_across = _log_student(across / width) - math.log(width)
    return np.asarray(outlier_cost + log_across + log_along - 2 * math.log(unit))


def _log_density(first: Floats, depths: Floats, own: Integers, scale: float) -> Floats:
    """Log-density [P] of inverse depths, predicted by those of the matches ``own`` of the body."""
    index = nearest(first[own], first, min(NEIGHBOURS + 1, len(own)))[1]
    near = depths[without(own[index], np.arange(len(first)))]
    sample = own[np.linspace(0, len(own) - 1, min(len(own), SAMPLED_MATCHES)).round().astype(int)]
    kernels = [(near, width) for width in WIDTHS]
    kernels += [(depths[sample][None], width) for width in WIDTHS[WIDE::2]]
    densities = np.stack(
        [
            np.exp(_log_student((depths[:, None] - about) / (width * scale))).mean(axis=1) / width
            for about, width in kernels
        ]
    )
    shares = np.full(len(densities), 1.0 / len(densities))
    for _ in range(MIXTURE_ROUNDS):
        parts = shares[:, None] * densities[:, own]
        shares = (parts / parts.sum(axis=0)).mean(axis=1)
    return np.asarray(np.log(shares @ densities) - math.log(scale))


def _log_student(values: Floats) -> Floats:
    """Log-density of the Student t distribution."""
    normalizer = math.lgamma((FREEDOM + 1) / 2) - math.lgamma(FREEDOM / 2)
    normalizer -= 0.5 * math.log(FREEDOM * math.pi)
    return np.asarray(normalizer - (FREEDOM + 1) / 2 * np.log1p(values**2 / FREEDOM))
