"""The affine 3-flat of tracks that are not visible in all frames.

A point X of a rigid object is seen by an affine camera at A_f (X, 1) in frame f, with A_f of 2 x 4.
Points and maps follow from each other by least squares over the frames in which each track is
visible, and are estimated in turn. Nothing is filled in.

References
----------
Buchanan and Fitzgibbon, Damped Newton algorithms for matrix factorization with missing data, CVPR
2005 (alternation, section 2.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mssegment.geometry.robust import geman_mcclure_weights
from mssegment.records import Floats

Flags = npt.NDArray[np.bool_]

FLAT_DIMENSION = 3
"""Of the points, which no residual is left of."""
PATH_ROUNDS = 10
"""Rounds in which the common path and the places of the tracks about it are estimated in turn."""
ROUNDS = 15
"""Rounds of the maps, the points and the weights."""
LARGEST_POINT = 10.0
"""Points are kept within this many standard deviations, where outliers have none."""
MOST_LEVERAGE = 0.95
"""A track of higher leverage says nothing about its own residual."""
RIDGE = 1e-6
"""Keeps least squares regular where a track or a frame leaves some direction free, over the trace
of the normal equations."""
TINY = 1e-18
"""Keeps divisions regular for exact data; coordinates here are of the order of 1."""


@dataclass(frozen=True)
class IncompleteFlat:
    """The tracks of one rigid object under affine cameras.

    Coordinates are those of the picture less ``middle``, over ``scale``.

    Attributes
    ----------
    middle : ndarray [2]
        Mean position, pixels.
    scale : float
        Root mean square coordinate about it, pixels.
    maps : ndarray [F, 2, 4]
        The affine camera of each frame.
    shape : ndarray [n, 3]
        The points of the tracks that were fitted.
    weights : ndarray [n]
        Their weights.
    """

    middle: Floats
    scale: float
    maps: Floats
    shape: Floats
    weights: Floats

    def residuals(self, points: Floats) -> Floats:
        """Root mean square residual per free coordinate of any tracks [m, F, 2], pixels [m].

        NaN where a track is visible in a single frame.
        """
        seen, visible = _normalized(points, self.middle, self.scale)
        return self._per_free_coordinate(_misfits(seen, visible, self.maps), visible)

    def own_residuals(self, points: Floats) -> Floats:
        """``residuals`` of the tracks [n, F, 2] that were fitted, from the flat without them, [n].

        Divided by 1 - leverage in each frame, that of the maps.
        """
        seen, visible = _normalized(points, self.middle, self.scale)
        full = np.column_stack([self.shape, np.ones(len(seen))])
        weights = visible * self.weights[:, None]
        normal = _regular(_scatters(full, weights))
        solved = np.swapaxes(np.linalg.solve(normal, full.T), 1, 2)
        leverage = weights * np.einsum("pi,fpi->pf", full, solved)
        kept = 1 - np.minimum(leverage, MOST_LEVERAGE)
        return self._per_free_coordinate(
            _misfits(seen, visible, self.maps) / kept[..., None], visible
        )

    def _per_free_coordinate(self, misfits: Floats, visible: Flags) -> Floats:
        free = 2 * visible.sum(axis=1) - FLAT_DIMENSION
        mean = (misfits**2).sum(axis=(1, 2)) / np.maximum(free, 1)
        return np.where(free > 0, self.scale * np.sqrt(mean), np.nan)


def incomplete_flat(points: Floats, *, good: float = 0.5) -> IncompleteFlat:
    """Fit the tracks of one object; outliers have small weights.

    Parameters
    ----------
    points : ndarray [n, F, 2]
        Tracks in pixels, NaN where a point is not visible; each is visible in two frames or more.
    good : float
        Share of the tracks of which it is known that they are of the object.
    """
    count = len(points)
    middle = np.nanmean(points, axis=(0, 1))
    scale = float(np.sqrt(np.nanmean((points - middle) ** 2))) + TINY
    seen, visible = _normalized(points, middle, scale)
    free = np.maximum(2 * visible.sum(axis=1) - FLAT_DIMENSION, 1)
    weights = np.ones(count)
    shape = _start(seen, visible)
    for _ in range(ROUNDS):
        maps = _maps(shape, seen, visible * weights[:, None])
        shape = _shapes(seen, visible, maps)
        misfits = np.where(visible[..., None], seen - _projected(maps, shape), 0.0)
        squared = (misfits**2).sum(axis=(1, 2)) / free
        weights = geman_mcclure_weights(squared, 4 * float(np.quantile(squared, good)) + TINY)
        shape = _whitened(shape, weights)
    maps = _maps(shape, seen, visible * weights[:, None])
    return IncompleteFlat(middle, scale, maps, shape, weights)


def _normalized(points: Floats, middle: Floats, scale: float) -> tuple[Floats, Flags]:
    """Normalized tracks, 0 where they are not visible, and where they are visible [n, F]."""
    visible: Flags = np.asarray(np.isfinite(points).all(axis=2))
    return np.where(visible[..., None], (points - middle) / scale, 0.0), visible


def _start(seen: Floats, visible: Flags) -> Floats:
    """Points [n, 3]: the place about the common path, and the leading motion about its affine map.

    The path is that of the mean of the tracks, each about a place of its own, since other tracks
    are visible in other frames.
    """
    known, shown = visible.sum(axis=1)[:, None], visible.sum(axis=0)[:, None]
    path = np.zeros(seen.shape[1:])
    for _ in range(PATH_ROUNDS):
        place = np.where(visible[..., None], seen - path, 0.0).sum(axis=1) / np.maximum(known, 1)
        about = np.where(visible[..., None], seen - place[:, None], 0.0)
        path = about.sum(axis=0) / np.maximum(shown, 1)
    ones = np.ones(len(seen))
    flat = _whitened(place, ones)
    maps = _maps(flat, seen, visible.astype(np.float64))
    rest = np.where(visible[..., None], seen - _projected(maps, flat), 0.0).reshape(len(seen), -1)
    depth = rest @ np.linalg.eigh(rest.T @ rest)[1][:, -1]
    return _whitened(np.column_stack([place, depth]), ones)


def _projected(maps: Floats, shape: Floats) -> Floats:
    """Where the maps [F, 2, k + 1] see the points [n, k], [n, F, 2]."""
    return np.asarray(np.einsum("fck,pk->pfc", maps[:, :, :-1], shape) + maps[:, :, -1])


def _misfits(seen: Floats, visible: Flags, maps: Floats) -> Floats:
    """Of tracks from where the maps see the best point of each, 0 where not visible, [n, F, 2]."""
    shape = _shapes(seen, visible, maps)
    return np.where(visible[..., None], seen - _projected(maps, shape), 0.0)


def _maps(shape: Floats, seen: Floats, weights: Floats) -> Floats:
    """The affine camera of each frame [F, 2, k + 1], with weights [n, F]."""
    full = np.column_stack([shape, np.ones(len(shape))])
    right = np.einsum("pk,pfc->fkc", full, seen * weights[..., None])
    return np.swapaxes(np.linalg.solve(_regular(_scatters(full, weights)), right), 1, 2)


def _shapes(seen: Floats, visible: Flags, maps: Floats) -> Floats:
    """The point of each track, [n, k]."""
    own, size = maps[:, :, :-1], maps.shape[2] - 1
    squares = np.einsum("fck,fcl->fkl", own, own).reshape(len(maps), -1)
    normal = (visible @ squares).reshape(len(seen), size, size)
    gaps = np.where(visible[..., None], seen - maps[:, :, -1], 0.0)
    right = np.einsum("fck,pfc->pk", own, gaps)
    return np.asarray(np.linalg.solve(_regular(normal), right[..., None])[..., 0])


def _scatters(full: Floats, weights: Floats) -> Floats:
    """Weighted sums [F, k, k] of the products of vectors [n, k] with themselves."""
    pairs = (full[:, :, None] * full[:, None]).reshape(len(full), -1)
    return np.asarray((weights.T @ pairs).reshape(weights.shape[1], full.shape[1], -1))


def _regular(normal: Floats) -> Floats:
    """Normal equations [..., k, k] with a ridge."""
    ridge = RIDGE * np.trace(normal, axis1=-2, axis2=-1) + TINY
    return np.asarray(normal + ridge[..., None, None] * np.eye(normal.shape[-1]))


def _whitened(shape: Floats, weights: Floats) -> Floats:
    """Points [n, k] of mean 0 and covariance 1, which the maps leave free."""
    centred = shape - np.average(shape, axis=0, weights=weights)
    scatter = (centred * weights[:, None]).T @ centred / weights.sum()
    values, axes = np.linalg.eigh(scatter)
    spread = np.sqrt(np.maximum(values, 1e-9 * values[-1] + TINY))
    return np.asarray(np.clip(centred @ axes / spread, -LARGEST_POINT, LARGEST_POINT))
