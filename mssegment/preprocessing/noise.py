"""The noise of matches, measured in the matches themselves.

The nearest matches of a match mostly lie on one surface, and a small piece of a surface moves by an
affine map. What remains of a robust affine fit to them is the noise of the match, or more where
there is a border or a mismatch. The lower tenth of these local scales is that of neighbourhoods
without either, as long as one match in five has one.
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.projective import homogeneous
from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.neighbours import nearest_others
from mssegment.records import Floats, Integers
from mssegment.special import quantile

NEIGHBOURS = 12
"""Nearest matches to which a local affine map is fitted; twice what determines it three times."""
FEW_MATCHES = 100
"""With fewer matches, smaller neighbourhoods are tried too."""
QUANTILE = 0.1
"""Share of the local scales that are below the noise."""
QUANTILE_OF_NORMAL = {6: 0.27, 8: 0.42, 12: 0.58}
"""That quantile of the local scales for normal noise, over its standard deviation, by the number of
neighbours (simulated; a test repeats it)."""
LEAST_OF_ESTIMATES = 0.88
"""The least of the estimates by several numbers of neighbours, over the standard deviation."""
RELATIVE_ERROR = 1.3
"""Standard deviation of an estimate from n matches, times the root of n, over the estimate."""
LEAST_NOISE = 0.26
"""Standard deviation in pixels that no matcher goes below. The errors of neighbouring matches of
one picture are alike, so that their local scale, 0.03 to 0.06 pixels, is far below their error."""
LEAST_OF_EXTENT = LEAST_NOISE / 800.0
"""The same over the diagonal of the picture, for coordinates that are no pixels."""
FIT_ROUNDS = 5
"""Rounds of reweighting of the affine fits."""
ROBUST_SCALES = 2.0
"""Residual, in robust standard deviations, at which a weight has fallen to a quarter."""
MEDIAN_OF_RAYLEIGH = 1.1774
"""Median of the norm of a normal vector in the plane, over its standard deviation."""
RIDGE = 1e-9
"""Keeps the normal equations of collinear neighbours regular, over their trace."""


def measured_noise(points: Floats) -> float:
    """Measure the noise of matches.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.

    Returns
    -------
    float
        Standard deviation of one coordinate of the difference between a match and the motion of
        its surface, in pixels, as measured: 0 for exact data. NaN with fewer than 8 matches.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> first = rng.uniform(0, 400, (300, 2))
    >>> second = first + [9.0, 2.0] + rng.normal(0, 0.5, (300, 2))
    >>> 0.35 < measured_noise(np.stack([first, second], axis=1)) < 0.7
    True
    """
    sizes = [NEIGHBOURS] if len(points) >= FEW_MATCHES else list(QUANTILE_OF_NORMAL)
    sizes = [size for size in sizes if size < len(points)]
    if len(points) < 8:
        return float("nan")
    near = nearest_others(points.reshape(len(points), 4), max(sizes))
    estimates = [
        float(quantile(local_scales(points, near[:, :size]), QUANTILE)) / QUANTILE_OF_NORMAL[size]
        for size in sizes
    ]
    least = min(estimates)
    return least if len(sizes) == 1 else least / LEAST_OF_ESTIMATES


def reference_noise(points: Floats) -> float:
    """The noise of matches [P, 2, 2] in pixels, but at least that of the best matchers.

    With too few matches to measure it, that of the best matchers.
    """
    least = least_noise(points)
    measured = measured_noise(points) * (1 + RELATIVE_ERROR / np.sqrt(max(len(points), 1)))
    return max(measured, least) if np.isfinite(measured) else least


def least_noise(points: Floats) -> float:
    """The noise in pixels that no matcher goes below, for matches [P, 2, 2]."""
    extent = float(np.hypot(*np.ptp(points.reshape(-1, 2), axis=0))) if len(points) else 1.0
    return min(LEAST_NOISE, LEAST_OF_EXTENT * extent)


def local_scales(points: Floats, near: Integers) -> Floats:
    """Robust standard deviation [P], in pixels, of matches about the affine map of each place.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.
    near : ndarray [P, k] of int
        The matches to which each map is fitted, k > 3.
    """
    first = points[near, 0] - points[:, None, 0]
    second = points[near, 1] - points[:, None, 1]
    radius = np.sqrt((first**2).sum(axis=-1).mean(axis=1))[:, None, None]
    rows = homogeneous(first / np.where(radius > 0, radius, 1.0))
    weights = np.ones(near.shape)
    correction = np.sqrt(near.shape[1] / (near.shape[1] - 3.0)) / MEDIAN_OF_RAYLEIGH
    for _ in range(FIT_ROUNDS):
        weighted = np.swapaxes(rows, 1, 2) * weights[:, None]
        normal = weighted @ rows
        ridge = RIDGE * np.trace(normal, axis1=1, axis2=2)
        normal += ridge[:, None, None] * np.eye(3)
        residual = np.linalg.norm(
            rows @ np.linalg.solve(normal, weighted @ second) - second, axis=-1
        )
        scale = correction * quantile(residual, 0.5)[:, None]
        limit = (ROBUST_SCALES * scale) ** 2
        weights = geman_mcclure_weights(residual**2, np.where(limit > 0, limit, 1.0))
    return np.asarray(scale[:, 0])
