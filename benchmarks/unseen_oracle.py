"""The oracle: what is achievable by one who knows every true motion.

A motion is known with the mean plane of its body and the scatter of depths about it, but not where
the body ends. The misfit of a track is the least, over all 3-D points, of its squared residuals
over the noise plus the squared deviation of the depth over its scatter.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.unseen_bodies import Body
from mssegment.records import Floats, Integers

LINEAR_STEPS, STEPS = 5, 10
"""Steps of the triangulation that are linear, at first, and all of its steps."""
LEAST_NOISE = 0.01
"""Pixels; tracks without noise must not divide by zero."""
LEAST_SCATTER = 0.01
"""Scatter of depth of a flat body, over its radius."""
NEAREST = 0.2
"""Least depth that is tried, over the depth of the body's centre."""
RIDGE = 1e-12
"""Keeps the normal equations of a start far off regular, over their trace."""
MARGIN = 9.0
"""A motion explains a track as well as its own one if its misfit is larger by less than this."""


def misfits(bodies: Sequence[Body], points: Floats, noise: float) -> Floats:
    """Misfit [m, P] of the tracks [P, F, 2] (NaN where not visible), pixels, under each motion."""
    return np.stack([_misfit(body, points, max(noise, LEAST_NOISE)) for body in bodies])


def achievable(
    bodies: Sequence[Body], points: Floats, labels: Integers, noise: float
) -> tuple[Integers, float]:
    """The oracle's labels [P] and misclassification, a fraction.

    Each track belongs to the motion of least misfit, or is an outlier above the threshold that is
    best for this very scene.
    """
    visible = np.isfinite(points).all(axis=2).sum(axis=1)
    found = misfits(bodies, points, noise) / np.maximum(2 * visible, 1)
    nearest, least = found.argmin(axis=0) + 1, found.min(axis=0)
    order = np.argsort(least, kind="stable")
    # right answers if the first k tracks are inliers, k = 0 .. P
    gain = np.where(nearest == labels, 1, 0)[order] - (labels == 0)[order]
    right = (labels == 0).sum() + np.concatenate([[0], np.cumsum(gain)])
    best = int(right.argmax())
    answer = np.zeros(len(labels), dtype=np.int64)
    answer[order[:best]] = nearest[order[:best]]
    return answer, 1.0 - float(right[best]) / max(len(labels), 1)


def confusions(bodies: Sequence[Body], noise: float) -> Floats:
    """Share of each body's tracks [m] that another body's motion explains as well as its own."""
    shares = np.zeros(len(bodies))
    for k, body in enumerate(bodies):
        found = misfits(bodies, body.tracks, noise)
        others = np.delete(found, k, axis=0).min(axis=0, initial=np.inf)
        shares[k] = float((others < found[k] + MARGIN).mean())
    return shares


def affine_body(tracks: Floats) -> Body:
    """The body of exact tracks [n, F, 2] under affine cameras, by factorization."""
    vectors = tracks.reshape(len(tracks), -1)
    mean = vectors.mean(axis=0)
    left, size, right = np.linalg.svd(vectors - mean, full_matrices=False)
    rank = min(3, len(size))
    points = np.zeros((len(tracks), 3))
    points[:, :rank] = left[:, :rank] * size[:rank]
    projections = np.zeros((tracks.shape[1], 3, 4))
    projections[:, 2, 3] = 1.0
    projections[:, :2, 3] = mean.reshape(-1, 2)
    projections[:, :2, :rank] = np.moveaxis(right[:rank].reshape(rank, -1, 2), 0, -1)
    return Body(points, projections)


def _misfit(body: Body, points: Floats, noise: float) -> Floats:
    """Misfit [P] under one motion: the least of all steps of the triangulation.

    The first steps are those of linear triangulation weighted by the depths before (Hartley and
    Sturm, Triangulation, 1997), the others are Gauss-Newton steps.
    """
    visible = np.asarray(np.isfinite(points).all(axis=2))
    observed = np.where(visible[..., None], points, 0.0)
    centre, spread = _prior(body, points)
    projections = body.projections @ np.block([[spread, centre[:, None]], [np.zeros(3), 1.0]])
    whitened = Body(np.zeros((0, 3)), projections)
    floor = NEAREST * projections[:, 2, 3]
    place = np.zeros((len(points), 3))
    best = np.full(len(points), np.inf)
    for step in range(STEPS):
        seen = whitened.homogeneous(place)
        depth = np.maximum(seen[..., 2], floor)[..., None]
        pixels = seen[..., :2] / depth
        residual = np.where(visible[..., None], observed - pixels, 0.0) / noise
        best = np.minimum(best, (residual**2).sum(axis=(1, 2)) + (place**2).sum(axis=1))
        along = (observed if step < LINEAR_STEPS else pixels)[..., None]
        slope = projections[:, :2, :3] - along * projections[:, 2:, :3]
        slope /= depth[..., None] * noise
        slope = np.where(visible[..., None, None], slope, 0.0)
        normal = np.einsum("pfik,pfil->pkl", slope, slope)
        ridge = 1 + RIDGE * np.trace(normal, axis1=1, axis2=2)
        normal += ridge[:, None, None] * np.eye(3)
        gradient = np.einsum("pfik,pfi->pk", slope, residual) - place
        place = place + np.linalg.solve(normal, gradient[..., None])[..., 0]
    return np.asarray(best)


def _prior(body: Body, points: Floats) -> tuple[Floats, Floats]:
    """Mean [3] and a square root [3, 3] of the covariance of where the body's points may be.

    Anywhere across the picture; along the line of sight as far from its mean plane as its points.
    """
    centre = body.points.mean(axis=0)
    own = body.points - centre
    radius = max(float(np.sqrt((own**2).sum(axis=1).mean())), 1e-9)
    corners = np.array([[0, 0, 0], [radius, 0, 0], [0, radius, 0]])
    first = body.project(centre + corners)[:, 0]
    pixels = float(np.linalg.norm(first[1:] - first[0], axis=1).max()) / radius
    extent = float(np.hypot(*np.nanstd(points.reshape(-1, 2), axis=0)))
    across = max(2 * extent / max(pixels, 1e-9), 2 * radius)
    slope = np.linalg.lstsq(own[:, :2], own[:, 2], rcond=None)[0]
    scatter = float((own[:, 2] - own[:, :2] @ slope).std())
    scatter = max(scatter, LEAST_SCATTER * radius)
    return centre, np.array([[across, 0, 0], [0, across, 0], [*(across * slope), scatter]])
