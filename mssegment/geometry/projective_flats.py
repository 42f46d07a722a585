"""Rigid objects under perspective: tracks as an affine 3-flat, bent by one linear form per frame.

A point X = (x, y, d) of a rigid object, with its place (x, y) in a reference view and its inverse
depth d, is seen in frame f at

    u_f = A_f (X, 1) / (1 + l_f . X),

where A_f is 2 x 4 and l_f has 3 entries (Hartley and Zisserman, Multiple View Geometry, 2nd ed.,
section 18.2). Under an affine camera l_f = 0, and the tracks lie on an affine 3-flat of R^2F;
otherwise u_f + (l_f . X) u_f = A_f (X, 1) does. The forms are linear unknowns once X is known, and
X follows from the forms, so that both are estimated in turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.records import Floats

ROUNDS = 8
"""Most rounds of the forms, the weights and the inverse depths."""
SETTLED = 0.03
"""The last round is the one that moves a median track by less than this share of the noise."""
RELAXATION = 1.5
"""Steps of the inverse depths are longer by this factor, which halves the rounds; above 2 they
diverge."""
LARGEST_DEPTH = 10.0
"""Inverse depths are kept within this many standard deviations, where outliers have none."""
FLAT_DIMENSION = 3
"""Of the place and the inverse depth of a track, which no residual is left of."""
MOST_LEVERAGE = 0.95
"""A track of higher leverage says nothing about its own residual."""
TINY = 1e-18
"""Keeps divisions regular for exact data; coordinates here are of the order of 1."""


@dataclass(frozen=True)
class BentFlat:
    """The tracks of one rigid object: an affine 3-flat, bent by one linear form per frame.

    Coordinates are those of the picture less ``middle``, over ``scale``.

    Attributes
    ----------
    middle : ndarray [2]
        Mean position, pixels.
    scale : float
        Root mean square coordinate about it, pixels.
    forms : ndarray [F, 3]
        The form of each frame, of place and inverse depth.
    maps : ndarray [4, 2F]
        The affine maps of (1, place, inverse depth) to the motion in each frame.
    weights, depth : ndarray [n]
        Of the tracks that were fitted.
    level : ndarray [n, F, 2]
        These tracks as an affine camera would see them, pixels.
    """

    middle: Floats
    scale: float
    forms: Floats
    maps: Floats
    weights: Floats
    depth: Floats
    level: Floats

    def residuals(self, points: Floats) -> Floats:
        """Root mean square residual per free coordinate of any tracks [m, F, 2], pixels [m].

        The place of a track is its mean, its inverse depth the best one, which is linear in what
        is left.
        """
        count, frames = points.shape[:2]
        seen = (points - self.middle) / self.scale
        place = seen.mean(axis=1)
        bend = (seen * (place @ self.forms[:, :2].T)[..., None]).reshape(count, -1)
        motion = (seen - place[:, None]).reshape(count, -1)
        rest = motion + bend - np.column_stack([np.ones(count), place]) @ self.maps[:3]
        slope = self.maps[3] - (seen * self.forms[:, 2, None]).reshape(count, -1)
        along = (rest * slope).sum(axis=1) / ((slope**2).sum(axis=1) + TINY)
        rest = rest - np.clip(along, -LARGEST_DEPTH, LARGEST_DEPTH)[:, None] * slope
        free = max(2 * frames - FLAT_DIMENSION, 1)
        return np.asarray(self.scale * np.sqrt((rest**2).sum(axis=1) / free))

    def own_residuals(self, points: Floats) -> Floats:
        """``residuals`` of the tracks [n, F, 2] that were fitted, from the flat without them, [n].

        Divided by 1 - leverage, that of the affine maps.
        """
        place = ((points - self.middle) / self.scale).mean(axis=1)
        root = np.sqrt(self.weights)[:, None]
        basis = np.linalg.qr(root * np.column_stack([np.ones(len(place)), place, self.depth]))[0]
        leverage = np.minimum((basis**2).sum(axis=1), MOST_LEVERAGE)
        return np.asarray(self.residuals(points) / (1 - leverage))


def bent_flat(
    points: Floats,
    noise: float,
    *,
    perspective: bool = True,
    good: float = 0.5,
    weights: Floats | None = None,
) -> BentFlat:
    """Fit the tracks of one object.

    The reference view is the mean of all views, and the inverse depth starts as the leading
    direction in which motion is not affine in the place. Outliers have small weights.

    Parameters
    ----------
    points : ndarray [n, F, 2]
        Complete tracks of one object in pixels, n of at least 5.
    noise : float
        Residual in pixels below which a track is no outlier.
    perspective : bool
        Whether the flat may be bent; otherwise all forms are 0.
    good : float
        Share of the tracks of which it is known that they are of the object.
    weights : ndarray [n], optional
        Weights of the tracks at first.
    """
    count, frames = points.shape[:2]
    middle = points.mean(axis=(0, 1))
    scale = float(np.sqrt(((points - middle) ** 2).mean())) + TINY
    seen = (points - middle) / scale
    place = seen.mean(axis=1)
    motion = (seen - place[:, None]).reshape(count, -1)
    depth = _standardized(_start(place, motion), np.ones(count))
    weights = np.ones(count) if weights is None else weights
    forms = np.zeros((frames, 3))
    for _ in range(ROUNDS):
        shape = np.column_stack([place, depth])
        affine = np.column_stack([np.ones(count), shape])
        if perspective:
            forms = _linear_forms(affine, seen, motion.reshape(seen.shape), weights)
        level = motion + (seen * (shape @ forms.T)[..., None]).reshape(count, -1)
        root = np.sqrt(weights)[:, None]
        maps = np.linalg.lstsq(root * affine, root * level, rcond=None)[0]
        residuals = level - affine @ maps
        squared = (residuals**2).sum(axis=1)
        floor = 2 * frames * (noise / scale) ** 2 + TINY
        weights = geman_mcclure_weights(squared, 4 * float(np.quantile(squared, good)) + floor)
        # one Gauss-Newton step of each inverse depth
        slope = (maps[3].reshape(frames, 2) - seen * forms[:, 2, None]).reshape(count, -1)
        step = (residuals * slope).sum(axis=1) / ((slope**2).sum(axis=1) + 1e-12)
        depth = _standardized(depth + RELAXATION * step, weights)
        moved = step**2 * (slope**2).sum(axis=1)
        if float(np.median(moved)) < 2 * frames * (SETTLED * noise / scale) ** 2:
            break
    straight = (place[:, None] + level.reshape(count, frames, 2)) * scale + middle
    return BentFlat(middle, scale, forms, maps, weights, depth, np.asarray(straight))


def _start(place: Floats, motion: Floats) -> Floats:
    """The leading component [n] of the motion [n, 2F] that is not affine in the place [n, 2]."""
    affine = np.column_stack([np.ones(len(place)), place])
    rest = motion - affine @ np.linalg.lstsq(affine, motion, rcond=None)[0]
    squared = (rest**2).sum(axis=1)
    weights = geman_mcclure_weights(squared, 4 * float(np.median(squared)) + TINY)
    return np.asarray(rest @ np.linalg.eigh((rest * weights[:, None]).T @ rest)[1][:, -1])


def _standardized(depth: Floats, weights: Floats) -> Floats:
    """Inverse depths [n] of mean 0 and mean square 1, which the forms and maps leave free."""
    centred = depth - np.average(depth, weights=weights)
    spread = float(np.sqrt(np.average(centred**2, weights=weights)))
    return np.asarray(np.clip(centred / (spread + TINY), -LARGEST_DEPTH, LARGEST_DEPTH))


def _linear_forms(affine: Floats, seen: Floats, motion: Floats, weights: Floats) -> Floats:
    """The forms [F, 3] of weighted least squares, together with any affine maps of each frame.

    ``affine`` [n, 4] is (1, X). Motion plus bend, -(l_f . X) u_f, is to be affine in X: the affine
    part is projected out, and the normal equations of each frame are sums over the tracks.
    """
    count, frames = seen.shape[:2]
    shape = affine[:, 1:]
    basis = np.linalg.qr(np.sqrt(weights)[:, None] * affine)[0] * np.sqrt(weights)[:, None]
    target, flat = motion.reshape(count, -1), seen.reshape(count, -1)
    # inner products of the basis with the bends [F, 4, 3, 2] and with the motion [F, 4, 2]
    pairs = (basis[:, :, None] * shape[:, None]).reshape(count, -1)
    of_bend = -(pairs.T @ flat).reshape(4, 3, frames, 2).transpose(2, 0, 1, 3)
    of_motion = (basis.T @ target).reshape(4, frames, 2).transpose(1, 0, 2)
    squares = (weights[:, None, None] * shape[:, :, None] * shape[:, None]).reshape(count, -1)
    normal = (squares.T @ (seen**2).sum(axis=2)).T.reshape(frames, 3, 3)
    normal = normal - np.einsum("fqkc,fqlc->fkl", of_bend, of_bend)
    right = -((weights[:, None] * shape).T @ (seen * motion).sum(axis=2)).T
    right = right - np.einsum("fqkc,fqc->fk", of_bend, of_motion)
    # a plane or a pure rotation leaves some forms free; they stay small
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2) + TINY
    normal = normal + ridge[:, None, None] * np.eye(3)
    return np.asarray(np.linalg.solve(normal, right[..., None])[..., 0])
